"""What only a Linux host behind a shell does: who may connect, who holds it, and what it shows that nobody believes."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from rarms_iac.applying.run_report import RunEnding
from rarms_iac.model.host import Connect
from rarms_iac.model.operations import CreatePartition, RenamePartition, StartPartition, WriteMark
from rarms_iac.model.plan import Scope
from rarms_iac.providers.cgroups import remote
from rarms_iac.providers.cgroups.remote import RemoteLinuxHost, RemoteShell
from rarms_iac.providers.cgroups.run import ORPHANS, LinuxHostProvider
from rarms_iac.providers.channel import Channel
from rarms_iac.providers.interface import HostDamaged, HostError, HostFailed, HostLocked, HostRefused
from tests import builders
from tests.contracts.benches import forget_groups, groups_of, on_linux, open_remote, opened_bench
from tests.contracts.runs import a_run
from tests.contracts.test_apply_crashes import SECOND, Lab, apply_again, go_on
from tests.effort import LONG

SCOPE = Scope(application="robot", plan="0123456789ab")


@pytest.fixture
def host(tmp_path: Path) -> Iterator[RemoteLinuxHost]:
    """A host with one partition that runs."""
    for _ in opened_bench("linux-remote"):
        host = open_remote(builders.a_host(), tmp_path)
        for operation in (
            CreatePartition(partition="vision", generation=0, memory=2**26),
            WriteMark(partition="vision", application="robot", name="vision", set="0" * 12),
            RenamePartition(partition="vision", name="vision"),
            StartPartition(partition="vision"),
        ):
            host.execute(operation, SCOPE)
        yield host


def behind(*words: str) -> RemoteLinuxHost:
    """A host that this program leads to."""
    return RemoteLinuxHost(on_linux(builders.a_host()), Connect(ssh="ann@onboard"), words=words)


def answering(lines: str) -> RemoteLinuxHost:
    """A host of root that answers every call with these lines."""
    answer = f"echo 'rarms: user 0'; while read -r word; do [ \"$word\" != look ] || printf '{lines}\\nend 0\\n'; done"
    return behind("sh", "-c", answer)


@pytest.mark.needs("control-groups")
def test_a_machine_is_the_same_from_here_and_from_there() -> None:
    described = on_linux(builders.a_host())

    assert behind("sh").observe() == LinuxHostProvider(described).observe()
    assert behind("sh").machine == LinuxHostProvider(described).machine


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("sh", "-c", "echo Host key verification failed. >&2; exit 255"), "ssh does not reach ann@onboard: Host key"),
        (("sh", "-c", "exit 255"), "ssh does not reach ann@onboard: it said nothing"),
        (("sh", "-c", "echo sh: not found >&2; exit 127"), "`sh` does not start on ann@onboard: sh: not found"),
        (("rarms-no-such-program",), "rarms-no-such-program cannot be started"),
    ],
)
@pytest.mark.needs("posix")
def test_who_is_not_reached_is_told_with_what_to_do(words: tuple[str, ...], message: str) -> None:
    with pytest.raises(HostFailed, match=message) as failure:
        behind(*words).observe()

    assert failure.value.advice


@pytest.mark.needs("root", "linux")
def test_a_user_who_is_not_root_and_has_no_sudo_is_refused(tmp_path: Path) -> None:
    (tmp_path / "sudo").write_text("#!/bin/sh\necho a password is required >&2\nexit 1\n", encoding="utf-8")
    (tmp_path / "sudo").chmod(0o755)
    tmp_path.chmod(0o755)
    path = f"PATH={tmp_path}:{os.environ['PATH']}"

    with pytest.raises(HostFailed, match=r"`sudo -n sh` is refused: .*(password|Permission|not found)"):
        behind("setpriv", "--reuid", "65534", "--clear-groups", "env", path, "sh").observe()


@pytest.mark.needs("control-groups")
def test_a_user_with_sudo_is_root_where_sh_reads_in_blocks(tmp_path: Path) -> None:
    programs = {"sudo": 'shift\nUSER_THERE=0 exec "$@"', "id": 'echo "${USER_THERE:-1000}"'}
    for name, text in programs.items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{text}\n", encoding="ascii")
        (tmp_path / name).chmod(0o755)

    host = behind("env", f"PATH={tmp_path}:{os.environ['PATH']}", "dash")

    assert host.observe() == LinuxHostProvider(on_linux(builders.a_host())).observe()


@pytest.mark.needs("posix")
def test_after_a_call_without_an_answer_nothing_more_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remote, "ANSWER_SECONDS", 0.2)
    with Channel(("sh",)) as channel:
        shell = RemoteShell("onboard", "ann@onboard", channel)
        with pytest.raises(HostFailed, match="it said nothing"):
            shell.ask("sleep", "1")
        channel.send(b"echo late; echo end 0\n")

        with pytest.raises(HostFailed, match="it said nothing"):
            shell.ask("true", seconds=10)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("f /../../etc/passwd", "impossible name"),
        ("f etc/passwd", "impossible name"),
        ("f /etc\\nf /etc/machine-id", "cannot be read"),
        ("v page 4096\\nv pages many", "cannot be read"),
        ("v page 4096", "control groups need what is missing here: .* /sys/fs/cgroup"),
        ("x", "control groups need what is missing"),
    ],
)
@pytest.mark.needs("posix")
def test_what_cannot_be_so_is_not_believed(lines: str, message: str) -> None:
    everything = (
        "f /sys/fs/cgroup/cgroup.controllers\\n cpuset memory cpu\\nf /sys/fs/cgroup/cpuset.cpus.effective\\n 0-1"
    )
    groups = "" if "control groups" in message else f"{everything}\\n"

    with pytest.raises((HostFailed, HostRefused), match=message):
        answering(f"v computer cell\\n{groups}{lines}").observe()


@pytest.mark.needs("posix")
def test_an_answer_without_end_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remote, "STATE_LIMIT", 10_000)

    with pytest.raises(HostFailed, match="its answer has more than 10,000 bytes"):
        behind("sh", "-c", "echo 'rarms: user 0'; while :; do echo ' noise'; done").observe()


def test_a_held_host_is_held_for_everybody_until_the_connection_ends(host: RemoteLinuxHost, tmp_path: Path) -> None:
    other = open_remote(builders.a_host(), tmp_path)
    with host.lock("ann@lab"), pytest.raises(HostLocked, match="held by ann@lab"), other.lock("ben@lab"):
        pass

    with other.lock("ben@lab"):
        assert other.observe().partitions[0].settings.running


def test_a_run_that_a_break_tore_in_the_journal_goes_on(host: RemoteLinuxHost, tmp_path: Path) -> None:
    with host.lock("ann@lab"):
        host.start_run(a_run(host.observe()))
    (journal,) = tmp_path.rglob("journal.jsonl")
    whole = journal.read_bytes()
    for torn in (whole + b'{"number":0,"sta', whole[:-1]):
        journal.write_bytes(torn)
        read = host.journal()
        assert (read is None) == (torn == whole[:-1])
        with host.lock("ann@lab"):
            host.start_run(a_run(host.observe()))
        assert journal.read_bytes() == whole


def test_a_folder_that_others_may_write_to_is_not_trusted(host: RemoteLinuxHost, tmp_path: Path) -> None:
    (definition,) = tmp_path.rglob("*.json")
    definition.parent.chmod(0o777)

    with pytest.raises(HostDamaged, match=f"others than root may write to {definition.parent}"):
        host.observe()
    with pytest.raises(HostDamaged, match="others than root may write"), host.lock("ann@lab"):
        pass
    assert definition.parent.stat().st_mode & 0o777 == 0o777


def test_the_doctor_names_processes_that_nobody_ends(host: RemoteLinuxHost, tmp_path: Path) -> None:
    with subprocess.Popen(["sleep", "60"]) as sleep:
        for file in groups_of(tmp_path).place("vision").join:
            file.write_text(str(sleep.pid), encoding="ascii")
        found = [finding for finding in host.examined().findings if finding.code == ORPHANS.code]
        sleep.kill()

    assert f"{sleep.pid} (sleep)" in found[0].detail


def test_a_group_of_any_name_is_a_partition(host: RemoteLinuxHost, tmp_path: Path) -> None:
    for name in ("a\\tb", "it's $(reboot)", "\x1b[2J", " "):
        groups_of(tmp_path).make(name)

    names = [partition.settings.name for partition in host.observe().partitions]

    assert names == ["\x1b[2J", " ", "a\\tb", "it's $(reboot)", "vision"]


def test_two_processes_of_a_supervisor_are_no_orphans(host: RemoteLinuxHost, tmp_path: Path) -> None:
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
def test_what_goes_while_it_is_shown_ends_no_shell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sed").write_text('#!/bin/sh\n[ $# = 1 ] || exit 2 # the file is gone\nexec /bin/sed "$@"\n')
    (tmp_path / "sed").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    calls = 'show_processes "$$"\nshow_whole "$0" /proc/version\necho on\n'
    sent = open_remote(builders.a_host(), tmp_path)._preamble() + f"\n{calls}"

    answered = subprocess.run(["sh"], input=sent, capture_output=True, text=True)

    assert answered.stdout.splitlines()[-1] == "on", answered.stderr


def break_at(patch: pytest.MonkeyPatch, at: int) -> list[bytes]:
    """Break the connection at what is sent as the n-th, from 0: half of it is sent, or all and the host begins it.

    Returns:
        What was sent.
    """
    sent: list[bytes] = []
    real = Channel.send

    def send(channel: Channel, data: bytes) -> None:
        sent.append(data)
        if len(sent) - 1 != at:
            real(channel, data)
        elif at % 2:
            real(channel, data[: len(data) // 2])
            channel.close()
        else:
            real(channel, data)
            time.sleep(0.002 * (at % 8))
            channel._kill()

    patch.setattr(Channel, "send", send)
    return sent


def test_an_apply_whose_connection_breaks_reaches_the_same_end_when_it_is_run_again(tmp_path: Path) -> None:
    for bench in opened_bench("linux-remote"):
        lab = Lab(bench)
        undisturbed = lab.host(lab.settled(tmp_path / "undisturbed"))
        with pytest.MonkeyPatch.context() as patch:
            sent = break_at(patch, -1)
            assert apply_again(lab.system(SECOND), undisturbed).ending is RunEnding.DONE
        end = undisturbed.observe()

        for at in range(3, len(sent), 1 if LONG else len(sent) // 2):
            host = lab.host(lab.settled(tmp_path / str(at)))
            with pytest.MonkeyPatch.context() as patch, suppress(HostError):
                break_at(patch, at)
                assert apply_again(lab.system(SECOND), host).ending is RunEnding.FAILED
            go_on(lab, host)
            assert host.observe() == end, sent[at]
            forget_groups(tmp_path / str(at))


@pytest.mark.needs("linux", "shellcheck")
def test_what_goes_to_the_host_is_clean_for_shellcheck_and_for_dash(tmp_path: Path) -> None:
    sent = tmp_path / "sent.sh"
    sent.write_text(open_remote(builders.a_host(), tmp_path)._preamble(), encoding="ascii")

    for words in (["shellcheck", "--shell=sh", "--severity=warning"], ["dash", "-n"]):
        checked = subprocess.run([*words, str(sent)], capture_output=True, text=True)
        assert (checked.returncode, checked.stdout + checked.stderr) == (0, "")
