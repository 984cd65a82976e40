"""What only a Linux host behind a shell does: who may connect, who holds it, and what of it is not believed."""

import os
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from rarms_iac.applying.run_report import RunEnding
from rarms_iac.model.host import Connect
from rarms_iac.model.journal import Closing, RunClosed, StepRecorded, StepStatus
from rarms_iac.model.operations import (
    CreatePartition,
    RenamePartition,
    SetActions,
    StartPartition,
    StopPartition,
    WriteMark,
)
from rarms_iac.model.plan import Scope
from rarms_iac.model.state import StartAction
from rarms_iac.providers.cgroups import effects, remote
from rarms_iac.providers.cgroups.condition import ORPHANS
from rarms_iac.providers.cgroups.effects import LinuxEffects, LocalEffects
from rarms_iac.providers.cgroups.machine import read_machine
from rarms_iac.providers.cgroups.provider import LinuxHostProvider
from rarms_iac.providers.cgroups.remote import RemoteEffects, through_channel
from rarms_iac.providers.channel import CommandResult, ProgramChannel
from rarms_iac.providers.interface import (
    HostDamaged,
    HostError,
    HostFailed,
    HostLocked,
    HostRefused,
    HostTakenOver,
    HostUnreachable,
)
from tests import builders
from tests.contracts.benches import (
    forget_groups,
    groups_of,
    on_linux,
    open_remote,
    open_slice_here,
    opened_bench,
    shell_channel,
)
from tests.contracts.runs import a_run
from tests.contracts.test_apply_crashes import SECOND, Lab, apply_again, go_on
from tests.effort import LONG, Attempt, examples, tried

PROGRAM = Path("templates/shell/effects.sh").read_text(encoding="ascii")
SCOPE = Scope(application="robot", plan="0123456789ab")


@pytest.fixture
def host(tmp_path: Path) -> Iterator[LinuxHostProvider]:
    """A host with one partition that runs."""
    for _ in opened_bench("linux-remote"):
        here = open_slice_here(builders.a_host(), tmp_path)
        for operation in (
            CreatePartition(partition="vision", generation=0, memory=2**26),
            WriteMark(partition="vision", application="robot", name="vision", set="0" * 12),
            RenamePartition(partition="vision", name="vision"),
            StartPartition(partition="vision"),
        ):
            here.execute(operation, SCOPE)
        yield open_remote(builders.a_host(), tmp_path)


@pytest.fixture
def lab() -> Iterator[Lab]:
    """Hosts behind a shell."""
    for bench in opened_bench("linux-remote"):
        yield Lab(bench)


def behind(*words: str) -> LinuxHostProvider:
    """A host that this program leads to."""
    return through_channel(on_linux(builders.a_host()), shell_channel(*words))


def answering(lines: str) -> LinuxHostProvider:
    """A host of root that answers every batch with these lines."""
    return behind("sh", "-c", f"printf 'rarms: user 0\\nrarms: ready\\n{lines}\\nend\\n'")


def effects_there(folder: Path) -> LinuxEffects:
    return RemoteEffects(on_linux(builders.a_host()), shell_channel(), folder / "state")


def host_files(folder: Path) -> dict[str, bytes]:
    """What the host of this folder keeps, but for who holds it."""
    return {path.name: path.read_bytes() for path in folder.rglob("*.json*")}


@pytest.mark.needs("control-groups")
def test_a_machine_is_the_same_from_here_and_from_there() -> None:
    described = on_linux(builders.a_host())

    there = behind()

    assert there.observe() == LinuxHostProvider(described).observe()
    assert there.machine == read_machine(LocalEffects())


@pytest.mark.parametrize(
    ("words", "message", "kind"),
    [
        (
            ("sh", "-c", "echo Host key verification failed. >&2; exit 255"),
            "ssh does not reach ann@onboard: Host key",
            HostUnreachable,
        ),
        (("sh", "-c", "exit 255"), "ssh does not reach ann@onboard: it said nothing", HostUnreachable),
        (("sh", "-c", "echo sh: not found >&2; exit 127"), "`sh` does not start on ann@onboard: sh: not", HostFailed),
        (("rarms-no-such-program",), "rarms-no-such-program cannot be started", HostUnreachable),
    ],
)
@pytest.mark.needs("posix")
def test_who_is_not_reached_is_told_with_what_to_do(
    words: tuple[str, ...], message: str, kind: type[HostFailed]
) -> None:
    with pytest.raises(HostFailed, match=message) as failure:
        behind(*words).observe()

    assert failure.value.advice
    assert type(failure.value) is kind


@pytest.mark.needs("root", "linux")
def test_a_user_who_is_not_root_and_has_no_sudo_is_refused(tmp_path: Path) -> None:
    (tmp_path / "sudo").write_text("#!/bin/sh\necho a password is required >&2\nexit 1\n", encoding="utf-8")
    (tmp_path / "sudo").chmod(0o755)
    tmp_path.chmod(0o755)
    path = f"PATH={tmp_path}:{os.environ['PATH']}"

    with pytest.raises(HostFailed, match=r"`sudo -n sh` is refused: .*(password|Permission|not found)"):
        behind("setpriv", "--reuid", "65534", "--clear-groups", "env", path, "sh", "-c").observe()


@pytest.mark.needs("control-groups")
def test_a_user_with_sudo_is_root_where_sh_reads_in_blocks(tmp_path: Path) -> None:
    programs = {"sudo": 'shift\nUSER_THERE=0 exec "$@"', "id": 'echo "${USER_THERE:-1000}"'}
    for name, text in programs.items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{text}\n", encoding="ascii")
        (tmp_path / name).chmod(0o755)

    host = behind("env", f"PATH={tmp_path}:{os.environ['PATH']}", "dash", "-c")

    assert host.observe() == LinuxHostProvider(on_linux(builders.a_host())).observe()


@pytest.mark.needs("posix")
def test_a_host_that_says_nothing_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remote, "ANSWER_SECONDS", 0.2)

    with pytest.raises(HostFailed, match="the connection to ann@onboard broke: it said nothing for 0 s"):
        behind("sh", "-c", "sleep 5").observe()


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("f /../../etc/passwd", "impossible name"),
        ("f etc/passwd", "impossible name"),
        ("f /etc/machine-id", "cannot be read"),
        ("f /proc/meminfo\\n MemTotal: many kB", "cannot be read"),
        ("", "control groups need these, which are missing: .* /sys/fs/cgroup"),
        ("x", "control groups need these, which are missing"),
    ],
)
@pytest.mark.needs("posix")
def test_what_cannot_be_so_is_not_believed(lines: str, message: str) -> None:
    shown = "w /sys/fs/cgroup\\nf /sys/fs/cgroup/cgroup.controllers\\n cpuset memory cpu\\n"
    everything = shown + "f /sys/fs/cgroup/cpuset.cpus.effective\\n 0-1"
    groups = "" if "control groups" in message else f"{everything}\\n"

    with pytest.raises((HostFailed, HostRefused), match=message):
        answering(f"{groups}{lines}").observe()


@pytest.mark.needs("posix")
def test_an_answer_without_end_is_cut_off() -> None:
    words = ("sh", "-c", "echo 'rarms: ready'; while :; do echo ' noise'; done")
    channel = ProgramChannel(host="onboard", target="ann@onboard", words=words, most_bytes=10_000)

    with pytest.raises(HostFailed, match="its answer has more than 10,000 bytes") as failed:
        through_channel(on_linux(builders.a_host()), channel).observe()
    assert "Look at what the host prints" in str(failed.value.advice)


@pytest.mark.needs("posix")
@pytest.mark.parametrize("effects_in", [lambda _: LocalEffects(), effects_there], ids=["here", "there"])
def test_a_group_is_made_in_one_that_exists(effects_in: Callable[[Path], LinuxEffects], tmp_path: Path) -> None:
    effects_of_host = effects_in(tmp_path)
    for _ in range(2):
        _make_and_commit(effects_of_host, tmp_path / "group")
    assert (tmp_path / "group").is_dir()

    with pytest.raises(OSError, match="no-slice/group"):
        _make_and_commit(effects_of_host, tmp_path / "no-slice" / "group")


def _make_and_commit(effects_of_host: LinuxEffects, group: Path) -> None:
    effects_of_host.make(group)
    effects_of_host.commit()


def test_a_held_host_is_held_for_everybody_until_the_connection_ends(host: LinuxHostProvider, tmp_path: Path) -> None:
    other = open_remote(builders.a_host(), tmp_path)
    with host.lock("ann@lab"), pytest.raises(HostLocked, match="held by ann@lab"), other.lock("ben@lab"):
        pass

    with other.lock("ben@lab"):
        assert other.observe().partitions[0].settings.running


def test_a_run_that_a_break_tore_in_the_journal_goes_on(host: LinuxHostProvider, tmp_path: Path) -> None:
    with host.lock("ann@lab"):
        host.start_run(a_run(host.observe()))
    (journal,) = tmp_path.rglob("journal.jsonl")
    whole = journal.read_bytes()
    journal.write_bytes(whole + b'{"number":0,"sta')

    assert host.journal() is not None
    with host.lock("ann@lab"):
        host.record(StepRecorded(number=0, status=StepStatus.BEGUN))

    assert journal.read_bytes().startswith(whole + b'{"number":0,"status":"begun"')


def test_a_journal_whose_first_record_is_torn_is_damaged(host: LinuxHostProvider, tmp_path: Path) -> None:
    with host.lock("ann@lab"):
        host.start_run(a_run(host.observe()))
    (journal,) = tmp_path.rglob("journal.jsonl")
    journal.write_bytes(journal.read_bytes()[:-1])

    with pytest.raises(HostDamaged, match="damaged in line 1"):
        host.journal()


def test_a_folder_that_others_may_write_to_is_not_trusted(host: LinuxHostProvider, tmp_path: Path) -> None:
    (definition,) = tmp_path.rglob("*.json")
    definition.parent.chmod(0o777)

    with pytest.raises(HostDamaged, match=f"others than root may write to {definition.parent}"):
        host.observe()
    with pytest.raises(HostDamaged, match="others than root may write"), host.lock("ann@lab"):
        pass
    assert definition.parent.stat().st_mode & 0o777 == 0o777


def test_the_doctor_names_processes_that_no_rarms_ends(host: LinuxHostProvider, tmp_path: Path) -> None:
    with subprocess.Popen(["sleep", "60"]) as sleep:
        for file in groups_of(tmp_path).place("vision").join:
            file.write_text(str(sleep.pid), encoding="ascii")
        found = [finding for finding in host.examined().findings if finding.code == ORPHANS.code]
        sleep.kill()

    assert f"{sleep.pid} (sleep)" in found[0].detail


def test_after_a_restart_the_doctor_says_that_only_an_apply_starts_a_host_over_ssh(
    host: LinuxHostProvider, tmp_path: Path
) -> None:
    host.execute(SetActions(partition="vision", start=StartAction.START), SCOPE)
    groups_of(tmp_path).remove("vision")
    reached = replace(host._host, connect=Connect(ssh="ann@onboard"))

    found = through_channel(reached, shell_channel(), tmp_path).examined().findings

    (advice,) = (str(finding.advice) for finding in found if finding.code == "RARMS316")
    assert advice.startswith(
        "`rarms apply` starts what is off. Nothing else does on a host that is only reached over ssh"
    )


def test_a_group_of_any_name_is_a_partition(host: LinuxHostProvider, tmp_path: Path) -> None:
    for name in ("a\\tb", "it's $(reboot)", "\x1b[2J", " "):
        groups_of(tmp_path).make(name)

    names = [partition.settings.name for partition in host.observe().partitions]

    assert names == ["\x1b[2J", " ", "a\\tb", "it's $(reboot)", "vision"]


def test_two_processes_of_a_supervisor_are_no_orphans(host: LinuxHostProvider, tmp_path: Path) -> None:
    script = "import subprocess\ntwo = [subprocess.Popen(['sleep', '60']) for _ in '12']\n"
    script += "print(*(sleep.pid for sleep in two), flush=True)\ninput()\n[sleep.kill() for sleep in two]"
    words = [sys.executable, "-c", script, "supervisor_process.py"]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as supervisor:
        assert supervisor.stdout is not None
        for process in supervisor.stdout.readline().split():
            for file in groups_of(tmp_path).place("vision").join:
                file.write_text(process, encoding="ascii")
        found = [finding.detail for finding in host.examined().findings if finding.code == ORPHANS.code]
        supervisor.communicate("\n")

    assert found == []


@pytest.mark.needs("linux")
def test_what_goes_while_it_is_shown_ends_no_batch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sed").write_text('#!/bin/sh\n[ $# = 1 ] || exit 2 # the file is gone\nexec /bin/sed "$@"\n')
    (tmp_path / "sed").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    calls = 'FOLDER=/tmp\nshow_processes\nshow_whole "$0" /proc/version\necho on\n'

    answered = subprocess.run(["sh"], input=PROGRAM + calls, capture_output=True, text=True)

    assert answered.stdout.splitlines()[-1] == "on", answered.stderr


# Batches: what is done of one, who holds the host between two, and who has lost it.


@dataclass
class Recording:
    """A channel that counts effects, and breaks at one of them: the host is killed before it, or the answer is lost."""

    at: int = -1
    is_unheard: bool = False
    target: str = "ann@onboard"
    effects: list[str] = field(default_factory=list)
    batches: int = 0

    def run(self, command: str, data: bytes, silence_s: float) -> CommandResult:
        self.batches += 1
        program, begin, calls = data.decode("ascii").partition("batch() {\n")
        lines: list[str] = []
        for line in calls.splitlines(keepends=True):
            if line.startswith("effect "):
                self.effects.append(line)
                if len(self.effects) - 1 == self.at and not self.is_unheard:
                    lines.append("kill -KILL $$\n")
            lines.append(line)
        was_cut = self.is_unheard and 0 <= self.at < len(self.effects)
        result = shell_channel().run(command, (program + begin + "".join(lines)).encode("ascii"), silence_s)
        if was_cut:
            self.at = -1
            return CommandResult(code=255, output="rarms: user 0\nrarms: ready\n", error="Connection closed")
        return result


@pytest.mark.parametrize("is_unheard", [False, True])
@pytest.mark.thorough
def test_an_apply_that_breaks_at_any_effect_reaches_the_same_end_when_it_is_run_again(
    lab: Lab, tmp_path: Path, is_unheard: bool
) -> None:
    counting = Recording()
    undisturbed = open_remote(builders.a_host(), lab.settled(tmp_path / "undisturbed"), counting)
    assert apply_again(lab.system(SECOND), undisturbed).ending is RunEnding.DONE
    end, run = undisturbed.observe(), undisturbed.journal()
    assert run is not None
    assert counting.batches < len(run.started.steps) + 12, "a step is one batch"

    for at in range(0, len(counting.effects), 1 if LONG else 31):
        folder = lab.settled(tmp_path / str(at))
        breaking = open_remote(builders.a_host(), folder, Recording(at, is_unheard))
        with suppress(HostError):
            assert apply_again(lab.system(SECOND), breaking).ending is RunEnding.FAILED
        tried(Attempt.CUT)
        host = lab.host(folder)
        go_on(lab, host)
        assert host.observe() == end, counting.effects[at]
        forget_groups(folder)


@dataclass
class CutAtByte:
    """A channel that is cut after so many bytes, of what is sent or of what comes back, and stays so."""

    at: int = 2**62
    cuts_answers: bool = False
    target: str = "ann@onboard"
    passed: int = 0

    def run(self, command: str, data: bytes, silence_s: float) -> CommandResult:
        remaining = self.at - self.passed
        if remaining <= 0:
            return CommandResult(code=255, output="", error="Connection refused")
        result = shell_channel().run(command, data if self.cuts_answers else data[:remaining], silence_s)
        self.passed += len(result.output) if self.cuts_answers else len(data)
        if self.passed < self.at:
            return result
        heard = result.output[:remaining] if self.cuts_answers else result.output
        return CommandResult(code=255, output=heard, error="Connection closed")


@pytest.mark.parametrize("cuts_answers", [False, True])
@pytest.mark.thorough
def test_an_apply_whose_connection_is_cut_at_any_byte_reaches_the_same_end(
    lab: Lab, tmp_path: Path, cuts_answers: bool
) -> None:
    counting = CutAtByte(cuts_answers=cuts_answers)
    undisturbed = open_remote(builders.a_host(), lab.settled(tmp_path / "undisturbed"), counting)
    assert apply_again(lab.system(SECOND), undisturbed).ending is RunEnding.DONE
    end, dice = undisturbed.observe(), random.Random(counting.passed)

    for number in range(examples(5)):
        folder = lab.settled(tmp_path / str(number))
        channel = CutAtByte(dice.randrange(1, counting.passed), cuts_answers)
        with suppress(HostError):
            assert apply_again(lab.system(SECOND), open_remote(builders.a_host(), folder, channel)).ending in {
                RunEnding.FAILED,
                RunEnding.DONE,  # the last batch gave the host back
            }
        tried(Attempt.CUT)
        host = lab.host(folder)
        go_on(lab, host)
        assert host.observe() == end, channel.at
        forget_groups(folder)


@pytest.mark.needs("linux")
def test_half_a_batch_does_nothing(host: LinuxHostProvider, tmp_path: Path) -> None:
    before = host.observe()
    (definition,) = tmp_path.rglob("*.json")
    sent: list[bytes] = []

    class Cut(Recording):
        def run(self, command: str, data: bytes, silence_s: float) -> CommandResult:
            if b"\neffect " not in data:
                return super().run(command, data, silence_s)
            sent.append(data)
            return shell_channel().run(command, data[: data.rindex(b"}")], silence_s)

    with pytest.raises(HostFailed, match="the connection to ann@onboard broke"):
        open_remote(builders.a_host(), tmp_path, Cut()).execute(StopPartition(partition="vision", grace_ms=0), SCOPE)

    assert sent
    assert host.observe() == before
    assert not [*definition.parent.glob(".*.new")]


def age(folder: Path, seconds: float) -> None:
    """Let the last batch of a run have come so long ago."""
    (lease,) = folder.rglob("lease")
    then = time.time() - seconds
    os.utime(lease, (then, then))


def on_another_computer(patch: pytest.MonkeyPatch) -> None:
    """No other machine can tell by its process whether a run has ended."""
    patch.setattr(remote, "has_ended", lambda _: False)


def test_between_batches_the_lease_keeps_others_out_until_no_batch_came_for_a_minute(
    host: LinuxHostProvider, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    on_another_computer(monkeypatch)
    monkeypatch.setattr(remote, "FRESH_SECONDS", 0.0)
    there, here = open_remote(builders.a_host(), tmp_path), open_slice_here(builders.a_host(), tmp_path)
    with host.lock("ann@lab, process 7"):
        for other in (there, here):
            age(tmp_path, 50)
            with pytest.raises(HostLocked, match="held by ann@lab, process 7"), other.lock("ben@lab"):
                pass
        age(tmp_path, 59)
        host.observe()  # an empty batch renews the lease
        age_now = time.time() - next(tmp_path.rglob("lease")).stat().st_mtime
        assert age_now < 30

        age(tmp_path, 61)
        with there.lock("ben@lab"):
            before = host_files(tmp_path)
            with pytest.raises(HostTakenOver, match="held by ben@lab"):
                host.execute(StopPartition(partition="vision", grace_ms=0), SCOPE)
            assert host_files(tmp_path) == before
            assert there.observe().partitions[0].settings.running


@dataclass
class Stalling(Recording):
    """Before its second record of a step, the run is away for more than a minute, and another one comes."""

    meanwhile: Callable[[], None] = lambda: None

    def run(self, command: str, data: bytes, silence_s: float) -> CommandResult:
        self.at -= b"step_recorded" in data
        if b"step_recorded" in data and self.at == -3:
            self.meanwhile()
        return super().run(command, data, silence_s)


@pytest.mark.parametrize("is_closed", [False, True])
def test_an_owner_that_comes_back_changes_nothing_and_is_refused(
    lab: Lab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_closed: bool
) -> None:
    on_another_computer(monkeypatch)
    folder = lab.settled(tmp_path / "host")
    left: dict[str, bytes] = {}

    def take_over() -> None:
        age(folder, 61)
        here = open_slice_here(builders.a_host(), folder)
        with here.lock("ben@lab"):
            if is_closed:
                here.record(RunClosed(closing=Closing.ABANDONED))
        left.update(host_files(folder))

    report = apply_again(lab.system(SECOND), open_remote(builders.a_host(), folder, Stalling(meanwhile=take_over)))

    assert report.ending is RunEnding.REFUSED
    assert "took it over" in report.findings[0].detail
    assert host_files(folder) == left
    go_on(lab, lab.host(folder))


def test_a_host_whose_clock_went_back_is_free_a_minute_later_and_not_at_once(
    host: LinuxHostProvider, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    on_another_computer(monkeypatch)
    (folder,) = {path.parent for path in tmp_path.rglob("*.json")}
    for other in (open_remote(builders.a_host(), tmp_path), open_slice_here(builders.a_host(), tmp_path)):
        (folder / "lease").write_text("ann@lab\nelsewhere 7 0123\n", encoding="ascii")
        age(tmp_path, -86_400)
        with pytest.raises(HostLocked, match="held by ann@lab"), other.lock("ben@lab"):
            pass
        assert abs(time.time() - (folder / "lease").stat().st_mtime) < 30
        age(tmp_path, 61)
        with other.lock("ben@lab"):
            assert other.observe().partitions[0].settings.running


ENDED = 2**22 + 1
"""More than the kernel's largest id of a process."""


def leave_lease(folder: Path, computer: str) -> None:
    """Let a run of a computer have ended without a word."""
    (folder / "lease").write_text(f"ann@lab, process {ENDED}\n{computer} {ENDED} 0123\n", encoding="ascii")


def test_a_run_whose_process_on_this_computer_ended_is_taken_over_at_once(
    host: LinuxHostProvider, tmp_path: Path
) -> None:
    (folder,) = {path.parent for path in tmp_path.rglob("*.json")}
    for other in (open_remote(builders.a_host(), tmp_path), open_slice_here(builders.a_host(), tmp_path)):
        leave_lease(folder, effects.this_computer())
        with other.lock("ben@lab"):
            assert other.observe().partitions[0].settings.running
        assert not (folder / "lease").exists()


def test_of_a_run_in_another_container_or_off_linux_no_other_run_can_tell_that_it_ended(
    host: LinuxHostProvider, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder,) = {path.parent for path in tmp_path.rglob("*.json")}
    machine, _, container = effects.this_computer().partition("/")
    assert container.startswith("pid:[")
    assert len(machine) == 36
    others = (f"{machine}/pid:[1]", f"{'0' * 36}/{container}")
    with monkeypatch.context() as patch:
        patch.setattr(Path, "readlink", lambda path: (path / "missing").stat())
        no_linux = effects.this_computer()
    for computer in (*others, no_linux):
        leave_lease(folder, computer)
        for other in (open_remote(builders.a_host(), tmp_path), open_slice_here(builders.a_host(), tmp_path)):
            with pytest.raises(HostLocked, match="held by ann@lab"), other.lock("ben@lab"):
                pass


def test_a_batch_that_waits_for_the_systems_lock_in_vain_says_who_holds_it(
    host: LinuxHostProvider, tmp_path: Path
) -> None:
    class Busy(Recording):
        def run(self, command: str, data: bytes, silence_s: float) -> CommandResult:
            if self.at != 1:
                return super().run(command, data, silence_s)
            return CommandResult(code=0, output="rarms: ready\nheld ben@lab\n\n", error="")

    channel = Busy()
    busy = open_remote(builders.a_host(), tmp_path, channel)
    with busy.lock("ann@lab"):
        channel.at = 1
        with pytest.raises(HostLocked, match="held by ben@lab"):
            busy.execute(StopPartition(partition="vision", grace_ms=0), SCOPE)


@pytest.mark.needs("linux", "shellcheck")
def test_what_goes_to_the_host_is_clean_for_shellcheck_and_for_dash(tmp_path: Path) -> None:
    sent = tmp_path / "sent.sh"
    sent.write_text(PROGRAM, encoding="ascii")

    for words in (["shellcheck", "--shell=sh", "--severity=warning", "--exclude=SC2154"], ["dash", "-n"]):
        checked = subprocess.run([*words, str(sent)], capture_output=True, text=True)
        assert (checked.returncode, checked.stdout + checked.stderr) == (0, "")
