"""A shell script of a plan does what `rarms apply` does, on this kernel, and each knows the other's runs."""

import os
import shutil
import stat
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.applying.execute import apply_plan, finish_unfinished
from rarms_iac.applying.run_report import RunEnding, RunReporter
from rarms_iac.applying.undo import undo
from rarms_iac.model.host import Host, LinuxHost, ProviderKind
from rarms_iac.model.plan import Plan
from rarms_iac.model.quantities import Bytes
from rarms_iac.model.state import State
from rarms_iac.model.system import Component, System
from rarms_iac.providers.cgroups.find_tree import CONTROL_GROUPS, SYSTEMD_FOLDER, MissingFeatures, find_tree
from rarms_iac.providers.cgroups.groups import GroupTree, GroupValues
from rarms_iac.providers.cgroups.machine import this_machine
from rarms_iac.providers.cgroups.run import LinuxHostProvider
from rarms_iac.providers.cgroups.script import quote, render_shell_scripts
from rarms_iac.providers.cgroups.systemd import GroupTreeSystemd
from rarms_iac.storage import disk
from rarms_iac.storage.shipped import shipped_text
from tests import builders
from tests.contracts.benches import kernel_effects_on_disk
from tests.contracts.test_apply_crashes import a_plan
from tests.crashing import Crash, CrashingDisk, When
from tests.effort import LONG

FIRST = (
    builders.a_component("vision", reserve="40 %", memory="128 MiB"),
    builders.a_component("speech", reserve="20 %", memory="64 MiB"),
)
SECOND = (
    builders.a_component("vision", reserve="20 %", memory="96 MiB"),
    builders.a_component("driving", reserve="40 %", processors=1, memory="64 MiB"),
)
EFFECTS = ("sync", "mv", "mkdir", "rmdir")
"""The programs by which a script changes what outlives it, but for the kernel's files."""


@dataclass(frozen=True)
class Lab:
    """A Linux host whose slice and folder only this test has."""

    folder: Path
    slice_name: str

    def described(self) -> Host:
        machine = this_machine()
        return replace(
            builders.a_host(keep_processor="10 %"),
            provider=ProviderKind.LINUX,
            settings=LinuxHost(slice=self.slice_name),
            logical_processors=machine.logical_processors,
            memory=Bytes(machine.memory),
        )

    def host(self) -> LinuxHostProvider:
        return LinuxHostProvider(self.described(), self.folder / "state")

    def plan(self, *components: Component) -> Plan:
        return a_plan(builders.a_system(hosts=[self.described()], components=list(components)), self.host())

    def apply(self, plan: Plan) -> None:
        host = self.host()
        with host.lock("ann@lab"):
            report = apply_plan(plan, {host.name: host}, builders.ORIGIN, RunReporter(), lambda: False)
        assert report.ending is RunEnding.DONE, report.diagnostics

    def undo(self) -> None:
        host = self.host()
        with host.lock("ann@lab"):
            assert undo(host, builders.ORIGIN, RunReporter(), lambda: False).ending is RunEnding.DONE

    def finish(self) -> bool:
        """Do what `rarms apply` does first: finish what is unfinished; whether there was anything."""
        host = self.host()
        with host.lock("ann@lab"):
            finished = finish_unfinished([host], RunReporter(), lambda: False)
        assert finished is None or finished.ending is RunEnding.DONE, finished.diagnostics
        return finished is not None

    def run(
        self, plan: Plan, name: str = "onboard.sh", path: str = "", words: tuple[str, ...] = ()
    ) -> subprocess.CompletedProcess[str]:
        scripts = render_shell_scripts(plan.hosts[0], plan, self.folder / "state")
        (self.folder / name).write_text(scripts[name], encoding="ascii")
        environment = {**os.environ, "PATH": f"{path}:{os.environ['PATH']}"} if path else None
        command = ["sh", str(self.folder / name), *words]
        return subprocess.run(command, env=environment, capture_output=True, text=True, start_new_session=True)

    def tree(self) -> GroupTree:
        tree = find_tree(self.slice_name)
        assert isinstance(tree, GroupTree), tree
        return tree

    def slice_limit(self) -> float | None:
        """What all partitions together may have, in per cent of a processor."""
        return self.tree().read("").quota_percent

    def settled(self) -> Plan:
        """Forget everything, apply the first layout with rarms, and plan the second."""
        self.forget()
        self.apply(self.plan(*FIRST))
        return self.plan(*SECOND)

    def forget(self) -> None:
        for name in self.tree().names():
            self.tree().remove(name)
        shutil.rmtree(self.folder / "state", ignore_errors=True)


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[Lab]:
    lab = Lab(tmp_path, f"rarms-test-{os.getpid()}-script")
    yield lab
    lab.forget()


def _changed(state: State) -> State:
    """Without the ids and marks that are new with every partition of a name."""
    return replace(state, partitions=tuple(replace(partition, id="", mark=None) for partition in state.partitions))


@pytest.mark.needs("control-groups")
def test_a_script_does_what_apply_does_and_its_undo_what_undo_does(lab: Lab) -> None:
    plan = lab.settled()
    start = lab.host().observe()
    lab.apply(plan)
    applied = lab.host().observe()
    lab.undo()
    undone = lab.host().observe()
    assert lab.slice_limit() == 180
    assert _changed(replace(undone, serials={})) == _changed(replace(start, serials={}))

    assert lab.settled() == plan
    done = lab.run(plan)

    assert done.returncode == 0, done.stderr
    assert lab.host().observe() == applied
    assert lab.slice_limit() == 180
    assert not lab.plan(*SECOND).has_changes
    assert lab.run(plan, "onboard.undo.sh").returncode == 0
    assert lab.host().observe() == undone
    assert not list(lab.folder.rglob("*.new"))


@pytest.mark.needs("control-groups")
def test_rarms_takes_back_what_a_script_did_and_a_script_what_rarms_did(lab: Lab) -> None:
    plan = lab.settled()
    start = _changed(replace(lab.host().observe(), serials={}))
    assert lab.run(plan).returncode == 0
    lab.undo()
    assert _changed(replace(lab.host().observe(), serials={})) == start

    plan = lab.settled()
    lab.apply(plan)
    assert lab.run(plan, "onboard.undo.sh").returncode == 0
    assert _changed(replace(lab.host().observe(), serials={})) == start
    journal = lab.host().journal()
    assert journal is not None
    assert [str(run.run) for run in journal.started.history] == ["apply", "apply"]


@pytest.mark.needs("control-groups")
def test_a_script_refuses_a_used_plan_a_host_that_moved_and_one_that_is_held(lab: Lab) -> None:
    plan = lab.settled()
    with lab.host().lock("bob@lab"):
        held = lab.run(plan)
    assert (held.returncode, held.stderr) == (
        3,
        "onboard: held by bob@lab: try again later, or wait with --lock-timeout SECONDS\n",
    )

    shares = next(iter(CONTROL_GROUPS.glob(f"**/{lab.slice_name}/vision/cpu.[sw][he][ai][rg][eh]*")))
    before = shares.read_text(encoding="ascii")
    shares.write_text("77", encoding="ascii")
    moved = lab.run(plan)
    assert moved.returncode == 3
    assert "vision" in moved.stderr
    shares.write_text(before, encoding="ascii")
    assert lab.run(plan).returncode == 0
    assert "nothing is to do" in lab.run(plan).stdout
    assert lab.run(plan, "onboard.undo.sh").returncode == 0

    used = lab.run(plan)

    assert (used.returncode, "plan again" in used.stderr) == (3, True)


@pytest.mark.needs("control-groups")
def test_a_script_starts_again_what_ran_when_the_machine_stopped(lab: Lab) -> None:
    plan = lab.settled()
    before = lab.host().observe()
    assert "RARMS316" not in [finding.code for finding in lab.host().examined().findings]
    for name in lab.tree().names():
        lab.tree().remove(name)
    for definition in (lab.folder / "state" / lab.slice_name).glob("*.json"):
        text = definition.read_text(encoding="ascii")
        definition.write_text(text.replace(this_machine().boot, "an earlier start"), encoding="ascii")
    (off,) = (finding for finding in lab.host().examined().findings if finding.code == "RARMS316")
    assert "2 partitions of onboard ran until the machine stopped" in off.detail
    assert "speech and vision" in off.detail

    done = lab.run(plan, words=("--boot",))

    assert (done.returncode, sorted(done.stdout.splitlines())) == (0, ["speech: start it", "vision: start it"])
    assert lab.host().observe() == before
    assert lab.slice_limit() == 180
    assert lab.run(plan, words=("--boot",)).stdout == ""


@pytest.mark.needs("control-groups")
@pytest.mark.parametrize("by_script", [True, False])
@pytest.mark.parametrize(
    "by_hand",
    [
        GroupValues(shares_percent=7.7, memory=128 * 2**20),
        GroupValues(shares_percent=80, quota_percent=30, memory=128 * 2**20),  # less than what is reserved
        GroupValues(shares_percent=80, quota_percent=1.5, period_us=100_000, memory=128 * 2**20),
    ],
)
def test_what_somebody_changed_by_hand_is_repaired_and_the_repair_taken_back(
    lab: Lab, by_hand: GroupValues, by_script: bool
) -> None:
    lab.settled()
    lab.tree().write("vision", by_hand)
    changed = lab.host().observe()
    plan = lab.plan(*FIRST)
    assert plan.has_changes

    if by_script:
        assert lab.run(plan).returncode == 0
    else:
        lab.apply(plan)
    assert not lab.plan(*FIRST).has_changes
    if by_script:
        undone = lab.run(plan, "onboard.undo.sh")
        assert undone.returncode == 0, undone.stderr
    else:
        lab.undo()

    assert replace(lab.host().observe(), serials={}) == replace(changed, serials={})


@pytest.fixture
def killers(tmp_path: Path) -> Path:
    """A folder of programs that kill the script before its n-th effect; n is in its file `left`."""
    folder = tmp_path / "killers"
    folder.mkdir()
    for name in EFFECTS:
        shim = folder / name
        shim.write_text(
            f'#!/bin/sh\nread -r left <"{folder}/left"\necho $((left - 1)) >"{folder}/left"\n'
            f'[ "$left" -gt 1 ] || kill -KILL 0\nexec {shutil.which(name)} "$@"\n',
            encoding="ascii",
        )
        shim.chmod(shim.stat().st_mode | stat.S_IXUSR)
    return folder


@pytest.mark.needs("control-groups")
@pytest.mark.parametrize("script", ["onboard.sh", "onboard.undo.sh"])
def test_a_script_killed_before_any_effect_is_finished_by_itself_and_by_rarms(
    lab: Lab, killers: Path, script: str
) -> None:
    plan = lab.settled()
    lab.apply(plan)
    if script == "onboard.undo.sh":
        lab.undo()
    end = lab.host().observe()

    effects = 0 if LONG else -29  # the 12th is in the middle of a removal
    while True:
        effects += 1 if LONG else 41
        assert lab.settled() == plan
        if script == "onboard.undo.sh":
            lab.apply(plan)
        (killers / "left").write_text(f"{effects}\n", encoding="ascii")
        if lab.run(plan, script, path=str(killers)).returncode == 0:
            break
        if not (effects % 2 and lab.finish()):
            again = lab.run(plan, script)
            assert again.returncode == 0, (effects, again.stderr)
        assert lab.host().observe() == end, effects
        assert not lab.finish(), effects
    assert effects > 40


@pytest.mark.needs("control-groups")
def test_an_apply_killed_at_any_effect_is_finished_by_the_script(lab: Lab) -> None:
    plan = lab.settled()
    with kernel_effects_on_disk():
        counting = CrashingDisk(0)
        with disk.use(counting):
            lab.apply(plan)
        end = lab.host().observe()
        for at in range(1, len(counting.effects) + 1, 1 if LONG else 97):
            assert lab.settled() == plan
            with disk.use(CrashingDisk(at, When.AFTER)), suppress(Crash):
                lab.apply(plan)

            again = lab.run(plan)

            assert again.returncode == 0, (counting.effects[at - 1], again.stderr)
            assert lab.host().observe() == end, counting.effects[at - 1]
            assert not lab.finish(), counting.effects[at - 1]


@pytest.mark.needs("control-groups")
def test_a_script_trusts_no_folder_that_others_may_fill(lab: Lab) -> None:
    plan = lab.settled()
    (lab.folder / "state" / lab.slice_name).chmod(0o777)

    for _ in "12":
        refused = lab.run(plan)
        assert (refused.returncode, "others than root may write to" in refused.stderr) == (3, True)


def in_runtime(commands: str, folder: Path) -> list[str]:
    """What commands print behind the functions of a script, on a machine whose `/` is this folder."""
    text = shipped_text("templates/shell/runtime.sh").replace("/sys/fs/cgroup", f"{folder}/sys/fs/cgroup")
    text = text.replace("/run/systemd/system", f"{folder}/{SYSTEMD_FOLDER}")
    done = subprocess.run(
        ["sh"], input=f"set -eu\nHOST=onboard SLICE=rarms\n{text}\n{commands}\n", capture_output=True, text=True
    )
    return done.stdout.splitlines()


@pytest.mark.needs("root", "linux")
@pytest.mark.parametrize("setting", ["automatic", "v1", "v2"])
@pytest.mark.parametrize("boots_systemd", [True, False])
@pytest.mark.parametrize(
    ("version_1", "version_2", "place"),
    [
        ((), "cpuset cpu io memory", ""),
        (("cpuset", "memory", "cpuacct", "cpu"), "", "unified"),
        (("cpuset", "memory"), "cpu io", "unified"),
    ],
)
def test_a_script_chooses_the_version_that_rarms_chooses(
    tmp_path: Path, setting: str, boots_systemd: bool, version_1: tuple[str, ...], version_2: str, place: str
) -> None:
    root = tmp_path / "sys" / "fs" / "cgroup"
    for folder in (root / place, *(root / name for name in version_1)):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "cgroup.procs").touch()
    (root / place / "cgroup.controllers").write_text(version_2)
    if boots_systemd:
        (tmp_path / SYSTEMD_FOLDER).mkdir(parents=True)
    chosen = find_tree("rarms", setting, root)

    printed = in_runtime(f'CONTROL_GROUPS={setting}\nfind_control_groups\necho "$VERSION" "$ROOT"', tmp_path)

    if isinstance(chosen, MissingFeatures):
        assert printed == []
    else:
        kind = "systemd" if isinstance(chosen, GroupTreeSystemd) else chosen.version
        assert printed == [f"{kind} {root if kind == 'v1' else root / place}"]


@pytest.mark.needs("linux")
def test_the_grace_is_a_time_however_long_a_look_takes(tmp_path: Path) -> None:
    looks = in_runtime("processes() { sleep 0.3; echo look >&2; echo 99999999; }\nask_to_end 10 2>&1", tmp_path)

    assert 1 < len(looks) < 10


@pytest.mark.needs("posix")
@given(st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"])))
def test_any_text_is_one_word_of_a_shell_in_ascii(text: str) -> None:
    word = quote(text)

    assert word.isascii()
    assert subprocess.run(["sh", "-c", f"printf '%s' {word}"], capture_output=True, check=True).stdout == text.encode()


@pytest.mark.needs("linux", "shellcheck")
def test_scripts_are_clean_for_shellcheck_and_for_dash(lab: Lab) -> None:
    host = lab.described()
    system: System = builders.a_system(hosts=[host], components=list(FIRST))
    plan = a_plan(system, lab.host())
    for name, text in render_shell_scripts(plan.hosts[0], plan, Path("/var/lib/rarms")).items():
        (lab.folder / name).write_text(text, encoding="ascii")
        for words in (["shellcheck", "--shell=sh"], ["dash", "-n"]):
            checked = subprocess.run([*words, str(lab.folder / name)], capture_output=True, text=True)
            assert (checked.returncode, checked.stdout + checked.stderr) == (0, "")
