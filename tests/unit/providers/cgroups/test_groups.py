"""Control groups: version 1 against the kernel below a slice of the test's own, version 2's files in a plain folder."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import cast

import pytest

from rarms_iac.app.install_there import WATCHER_PATH, RobotPlaces
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.setting import MachineSpeed
from rarms_iac.model.state import ProcessorKind
from rarms_iac.providers.cgroups import machine
from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.providers.cgroups.groups import GroupTree, GroupValues
from rarms_iac.providers.cgroups.machine import (
    ThreadLooks,
    consumed_ms,
    looking_at,
    orphans,
    read_facts,
    starts_thread_watcher,
)
from rarms_iac.providers.cgroups.measuring import LinuxMeasuringHost
from rarms_iac.providers.cgroups.speed import read_speed
from rarms_iac.providers.cgroups.trees import CONTROL_GROUPS, MissingFeatures, find_tree
from rarms_iac.running.component import ComponentRun
from rarms_iac.running.kernel_files import read_process
from rarms_iac.running.orders import StartContext
from tests.builders import a_host
from tests.contracts.benches import forget_groups, groups_of
from tests.contracts.test_measuring_contract import ready
from tests.needs import require
from tests.unit.running.programs import a_run

MIB = 2**20


@pytest.fixture
def tree() -> Iterator[GroupTree]:
    """The kernel's groups below a slice that only this test has."""
    require("control-groups")
    found = find_tree(f"rarms-test-{os.getpid()}", "automatic")
    assert isinstance(found, GroupTree), found
    yield found
    for name in found.names():
        found.remove(name)


def _sleeper_in(tree: GroupTree, name: str) -> subprocess.Popen[bytes]:
    place = tree.place(name)
    script = "import os, pathlib, sys, time\nfor path in sys.argv[1:]: pathlib.Path(path).write_text(str(os.getpid()))"
    script += "\nmemory = bytearray(16 * 2**20)"
    words = [sys.executable, "-c", f"{script}\nprint(flush=True)\ntime.sleep(60)", *map(str, place.join)]
    process = subprocess.Popen(words, stdout=subprocess.PIPE)
    assert process.stdout is not None
    with process.stdout:
        process.stdout.readline()
    return process


@pytest.mark.parametrize(
    "values",
    [
        GroupValues(shares_percent=140, memory=64 * MIB),
        GroupValues(shares_percent=35, quota_percent=35, period_us=8_800, processors=(0,), memory=128 * MIB),
        GroupValues(shares_percent=200, quota_percent=150, period_us=100_000),
    ],
)
def test_the_kernel_holds_what_was_written(tree: GroupTree, values: GroupValues) -> None:
    tree.make("vision")

    tree.write("vision", values)

    assert tree.read("vision") == values == tree.as_kernel_shows(values)


def test_larger_quotas_shrink_first(tree: GroupTree) -> None:
    tree.limit_slice(180)  # the slice is not there yet
    tree.make("vision")
    tree.write("vision", GroupValues(shares_percent=10, quota_percent=190, period_us=100_000))

    tree.limit_slice(180)

    assert (tree.read("vision").quota_percent, tree.read("").quota_percent) == (180, 180)
    tree.limit_slice(None)
    assert tree.read("").quota_percent is None


def test_larger_quota_gives_way(tree: GroupTree) -> None:
    tree.make("vision")
    tree.write("vision", GroupValues(shares_percent=10, quota_percent=190, period_us=100_000, processors=(1,)))

    tree.write("vision", GroupValues(shares_percent=20))

    assert tree.read("vision") == GroupValues(shares_percent=20)


def test_what_the_kernel_rounds_is_known_beforehand(tree: GroupTree) -> None:
    tree.make("vision")
    values = GroupValues(shares_percent=0, quota_percent=33, period_us=7_777, memory=64 * MIB + 1)

    tree.write("vision", values)

    assert tree.read("vision") == tree.as_kernel_shows(values) != values


def test_asked_program_may_end_within_grace(tree: GroupTree) -> None:
    tree.make("vision")
    process = _sleeper_in(tree, "vision")

    tree.ask_to_end("vision", grace_ms=10_000)

    assert process.wait(10) == -15
    assert tree.processes("vision") == ()


def test_group_is_named_and_slice_goes_last(tree: GroupTree) -> None:
    tree.make("vision")
    tree.make("speech")
    assert tree.names() == ("speech", "vision")

    tree.remove("vision")
    tree.remove("speech")

    assert tree.names() == ()
    assert not list(CONTROL_GROUPS.glob(f"*/rarms-test-{os.getpid()}"))


def test_process_joins_and_is_ended_with_group(tree: GroupTree) -> None:
    tree.make("vision")
    process = _sleeper_in(tree, "vision")
    assert tree.processes("vision") == (process.pid,)
    assert tree.cpu_ms("vision") >= 0
    assert tree.throttled_ms("vision") == 0

    tree.remove("vision")

    assert process.wait(10) == -9
    assert tree.names() == ()


def test_vanished_group_is_gone(tree: GroupTree) -> None:
    tree.make("vision")
    opened = os.open(tree.place("vision").join[0], os.O_RDWR)
    tree.remove("vision")

    for touch in (LinuxEffects().read, lambda file: LinuxEffects().write(file, "0")):
        with pytest.raises(FileNotFoundError):
            touch(Path(f"/proc/self/fd/{opened}"))
    os.close(opened)


def test_removing_ends_foreign_processes_below(tree: GroupTree) -> None:
    tree.make("vision")
    tree.make("vision/inner")
    process = _sleeper_in(tree, "vision/inner")

    tree.remove("vision")

    assert process.wait(10) == -9
    assert tree.names() == ()


def _plain_v2(root: Path, controllers: str = "cpuset cpu io memory pids") -> Path:
    (root / "cgroup.controllers").write_text(f"{controllers}\n")
    for folder in (root, root / "rarms", root / "rarms" / "vision"):
        folder.mkdir(exist_ok=True)
        for file in (
            "cgroup.subtree_control",
            "cpu.weight",
            "cpu.max",
            "cpuset.cpus",
            "memory.max",
            "memory.stat",
            "cgroup.procs",
        ):
            (folder / file).touch()
    return root


def test_version_2_writes_its_own_files(tmp_path: Path) -> None:
    tree = find_tree("rarms", "v2", root=_plain_v2(tmp_path))
    assert isinstance(tree, GroupTree)

    tree.make("vision")
    values = GroupValues(shares_percent=70, quota_percent=70, period_us=8_800, processors=(0, 2), memory=64 * MIB)
    tree.write("vision", values)

    group = tmp_path / "rarms" / "vision"
    written = [(group / file).read_text() for file in ("cpu.weight", "cpu.max", "cpuset.cpus", "memory.max")]
    assert written == ["70", "6160 8800", "0,2", str(64 * MIB)]
    assert (tmp_path / "rarms" / "cpu.weight").read_text() == "10000"
    assert (tmp_path / "rarms" / "cgroup.subtree_control").read_text() == "+cpuset +memory +cpu"
    assert tree.read("vision") == values
    assert tree.place("vision").join == (group / "cgroup.procs",)


def test_version_2_reads_no_limit(tmp_path: Path) -> None:
    tree = find_tree("rarms", "automatic", root=_plain_v2(tmp_path))
    assert isinstance(tree, GroupTree)
    group = tmp_path / "rarms" / "vision"
    for file, text in {"cpu.weight": "100", "cpu.max": "max 100000", "cpuset.cpus": "", "memory.max": "max"}.items():
        (group / file).write_text(f"{text}\n")
    (group / "cpu.stat").write_text("usage_usec 2500\nnr_throttled 3\nthrottled_usec 1500\n")

    assert tree.version == "v2"
    assert tree.read("vision") == GroupValues(shares_percent=100)
    assert (tree.cpu_ms("vision"), tree.throttled_ms("vision")) == (2.5, 1.5)


def test_version_2_takes_no_used_memory(tmp_path: Path) -> None:
    tree = find_tree("rarms", "v2", root=_plain_v2(tmp_path))
    assert isinstance(tree, GroupTree)
    (tmp_path / "rarms" / "vision" / "memory.stat").write_text(f"anon {65 * MIB}\nfile 4096\n")

    with pytest.raises(OSError, match="its processes use 68157440 bytes"):
        tree.write("vision", GroupValues(shares_percent=70, memory=64 * MIB))

    assert (tmp_path / "rarms" / "vision" / "cpu.weight").read_text() == ""


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    found = find_tree("rarms", "v2", root=_plain_v2(tmp_path, controllers="io pids cpu"))

    assert isinstance(found, MissingFeatures)
    assert [name.split(" of ")[0] for name in found.names] == ["the controller cpuset", "the controller memory"]


def test_a_kernel_without_quotas_is_named(tmp_path: Path) -> None:
    (_plain_v2(tmp_path) / "rarms" / "cpu.max").unlink()

    found = find_tree("rarms", "v2", root=tmp_path)

    assert found == MissingFeatures(names=("quotas of processor time (CONFIG_CFS_BANDWIDTH)",))


@pytest.mark.parametrize(
    ("controllers", "version_1", "missing"),
    [
        ("", (), "version 2 of control groups at "),
        ("cpuset cpu io", (), "the controller memory of version 2 at "),
        ("", ("cpu", "memory", "cpuacct"), "the controller cpuset of version 1 at "),
    ],
)
def test_missing_controller_of_both_versions_is_named(
    tmp_path: Path, controllers: str, version_1: tuple[str, ...], missing: str
) -> None:
    (tmp_path / "cgroup.controllers").write_text(controllers)
    for name in version_1:
        (tmp_path / name).mkdir()
        (tmp_path / name / "cgroup.procs").touch()

    found = find_tree("rarms", "automatic", root=tmp_path)

    assert isinstance(found, MissingFeatures)
    assert [name.startswith(missing) for name in found.names] == [True]


BUSY = """
import subprocess, sys, time
quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
helper = subprocess.Popen([sys.executable, "-c", "while True: pass"], **quiet)
while True:
    say('{"ms": 1}')
    time.sleep(0.05)
"""


@pytest.mark.needs("linux")
def test_consumption_counts_all_started_processes(tmp_path: Path) -> None:
    with ComponentRun("busy", a_run(BUSY, until=10_000), StartContext(base=tmp_path)) as run:
        next(run)
        assert run.process is not None
        before, until = consumed_ms(run.process), time.perf_counter() + 30
        while consumed_ms(run.process) < before + 100 and time.perf_counter() < until:
            next(run)
        after = consumed_ms(run.process)

    assert after >= before + 100
    assert consumed_ms(run.process) == 0, "it is gone"


@pytest.mark.needs("linux")
def test_process_is_known_by_its_name_and_parent() -> None:
    own = read_process(os.getpid())

    assert own is not None
    assert own.parent == os.getppid()
    assert read_process(2**22 + 1) is None


def orphan_findings(host: LinuxMeasuringHost) -> list[Diagnostic]:
    return [finding for finding in host.examined("robot").findings if finding.code == "RARMS168"]


@pytest.mark.needs("linux")
@pytest.mark.needs("control-groups")
@pytest.mark.alone
def test_doctor_names_what_killed_supervisor_left_in_partition(tmp_path: Path) -> None:
    described, groups = a_host(provider=ProviderKind.LINUX, keep_processor="5 %"), groups_of(tmp_path)
    host = LinuxMeasuringHost(described, tmp_path, tmp_path / "state", groups)
    with ready(host):
        context = replace(StartContext(base=tmp_path), inside=groups.place("rarms-p1"))
        with ComponentRun("busy", a_run(BUSY, until=10_000), context) as run:
            next(run)
            assert orphans(groups.processes("rarms-p1")) == ()
            assert orphan_findings(host) == []
            os.kill(run.process or 0, signal.SIGKILL)
            until = time.perf_counter() + 20
            while not (left_over := orphan_findings(host)) and time.perf_counter() < until:
                time.sleep(0.02)
    forget_groups(tmp_path)

    (finding,) = left_over
    assert "(python" in finding.detail
    assert groups.names() == ()


def reading(texts: Mapping[str, str]) -> Callable[[Path], str]:
    def read(path: Path) -> str:
        text = texts.get(str(path), "")
        return f"{text} {' '.join('0' * 40)}" if path.name == "stat" and text else text

    return read


@pytest.mark.needs("linux")
def test_process_of_run_exec_is_no_orphan() -> None:
    texts = {
        "/proc/80/stat": "80 (node) S 1",
        "/proc/80/environ": "HOME=/\0RARMS_RUN_EXEC=80:0:robot/node\0",
        "/proc/81/stat": "81 (helper) S 1",
        "/proc/81/environ": "RARMS_RUN_EXEC=80:0:robot/node\0",
        "/proc/82/stat": "82 (left) S 1",
        "/proc/82/environ": "RARMS_RUN_EXEC=80:7:robot/node\0",  # of an earlier process with this id
        "/proc/83/stat": "83 (lost) S 1",
        "/proc/83/environ": "RARMS_RUN_EXEC=79:0:robot/node\0",  # of one that has ended
    }

    assert orphans([80, 81, 82, 83], reading(texts)) == ((82, "left"), (83, "lost"))


@pytest.mark.needs("linux")
@pytest.mark.parametrize("ended", [False, True])
def test_what_a_client_waits_for_is_no_orphan(*, ended: bool) -> None:
    unit, container = "rarms-arm-0a1b2c3d-1.service", f"docker-{'ab' * 32}.scope"
    client, supervisor = os.getppid(), os.getpid()
    texts = {
        "/proc/71/stat": "71 (arm) S 1",
        "/proc/71/cgroup": f"0::/rarms.slice/rarms-arm.slice/{unit}",
        "/proc/72/stat": "72 (eyes) S 70",
        "/proc/72/cgroup": f"0::/rarms.slice/rarms-arm.slice/{container}",
        "/proc/70/stat": "70 (containerd-shim) S 1",
        "/proc/73/stat": "73 (own) S 1",
        "/proc/73/cgroup": "0::/rarms.slice/rarms-arm.slice/own.service",
        f"/proc/{client}/cmdline": "" if ended else f"systemd-run\0--unit={unit}\0--\0docker\0run\0eyes",
        f"/proc/{client}/stat": f"{client} (systemd-run) S {supervisor}",
        f"/proc/{supervisor}/cmdline": "python3\0supervisor_process.py\0",
    }

    read = reading(texts)
    own = ((73, "own"),)
    assert orphans([71, 72, 73], read) == (((71, "arm"), (72, "eyes"), *own) if ended else own)


ALWAYS_BUSY, IDLE = "print(flush=True)\nwhile True: pass", "import time; print(flush=True); time.sleep(600)"


class Group:
    """A control group that has these processes, as far as it is asked here."""

    def __init__(self, processes: list[int]) -> None:
        self._processes = tuple(processes)

    def processes(self, _name: str) -> tuple[int, ...]:
        return self._processes

    def used_memory(self, _name: str) -> None:
        return


@contextmanager
def running(*programs: str) -> Iterator[Group]:
    started = [subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) for program in programs]
    try:
        for process in started:
            assert process.stdout is not None
            assert process.stdout.readline()
        yield Group([process.pid for process in started])
    finally:
        for process in started:
            process.kill()
            process.communicate()


def looked_at(group: Group) -> ThreadLooks:
    with looking_at(cast("GroupTree", group), "rarms-p1") as looks:
        time.sleep(0.5)
    return looks


@pytest.mark.needs("linux")
@pytest.mark.parametrize(("programs", "most"), [((ALWAYS_BUSY, IDLE), 1), ((ALWAYS_BUSY, ALWAYS_BUSY, IDLE), 2)])
def test_running_and_waiting_threads_count(programs: tuple[str, ...], most: int) -> None:
    with running(*programs) as group:
        looks = looked_at(group)

    assert looks.most(500.0) == most


@pytest.mark.needs("linux")
def test_unseen_or_rare_use_does_not_count() -> None:
    with running(ALWAYS_BUSY) as group:
        looks = looked_at(group)

    assert ThreadLooks(cast("GroupTree", group), "rarms-p1").most(1.0) is None
    assert looks.most(1_000_000.0) == 1


class _Copy(LinuxEffects):
    """This machine, with other files about its processors."""

    def __init__(self, files: dict[str, str]) -> None:
        self._files = {Path("/sys/devices/system/cpu") / name: text for name, text in files.items()}

    def has_file(self, path: Path) -> bool:
        return path in self._files if "cpu" in path.parts else super().has_file(path)

    def read(self, path: Path) -> str:
        return self._files[path] if "cpu" in path.parts else super().read(path)


FOUR = {"online": "0-3"}
PAIR = {f"cpu{number}/topology/thread_siblings_list": "0-1" for number in (0, 1)}
SINGLE = {f"cpu{number}/topology/thread_siblings_list": str(number) for number in (2, 3)}


@pytest.mark.needs("linux")
@pytest.mark.parametrize(
    ("files", "kinds"),
    [
        ({}, ()),
        ({f"cpu{number}/cpu_capacity": "1024" for number in range(4)}, ()),
        (PAIR | SINGLE, (ProcessorKind(processors=2, threads=1), ProcessorKind(processors=2, threads=2))),
        (
            {f"cpu{number}/cpu_capacity": "446" if number else "1024" for number in range(4)},
            (ProcessorKind(processors=1, capacity=1024), ProcessorKind(processors=3, capacity=446)),
        ),
        (
            {f"cpu{number}/cpufreq/base_frequency": "2400000" if number else "3200000" for number in range(4)},
            (ProcessorKind(processors=1, base_mhz=3200), ProcessorKind(processors=3, base_mhz=2400)),
        ),
    ],
    ids=["unknown", "alike", "threads", "capacity", "frequency"],
)
def test_processors_that_differ_are_told_by_kind(files: dict[str, str], kinds: tuple[ProcessorKind, ...]) -> None:
    assert read_facts(a_host(), _Copy(FOUR | files)).processor_kinds == kinds


@pytest.mark.needs("linux")
def test_watcher_runs_or_will_be_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    effects, boot_file, rules = LinuxEffects(), tmp_path / "rarms-threads.path", tmp_path / "rarms.threads"
    monkeypatch.setattr(machine, "STARTS_OF_WATCHER", (boot_file,))
    assert not starts_thread_watcher(effects, tmp_path)
    boot_file.touch()
    assert starts_thread_watcher(effects, tmp_path)

    rules.touch()
    assert starts_thread_watcher(effects, tmp_path), "the system may still start it"
    os.utime(rules, (0, 0))
    assert not starts_thread_watcher(effects, tmp_path), "somebody stopped it"

    other = tmp_path / "other"
    other.mkdir()
    (other / "rarms.threads").touch()
    os.utime(other / "rarms.threads", (0, 0))
    words = [sys.executable, "-c", "print(flush=True); input()", "rarms_iac.running.thread_watcher", str(tmp_path)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as watcher:
        assert watcher.stdout is not None
        watcher.stdout.readline()
        assert starts_thread_watcher(effects, tmp_path)
        assert not starts_thread_watcher(effects, other)
        watcher.communicate(b"\n")
    assert not starts_thread_watcher(effects, tmp_path)


def test_boot_files_of_the_watcher_are_installed() -> None:
    places = RobotPlaces()

    assert (Path(places.units, WATCHER_PATH), Path(places.cron, "rarms")) == machine.STARTS_OF_WATCHER


@pytest.mark.needs("linux")
def test_speed_comes_from_all_processors() -> None:
    frequencies = {
        f"cpu{number}/cpufreq/{name}": value
        for number in range(4)
        for name, value in (
            ("scaling_cur_freq", f"{2000 + 100 * number}000"),
            ("scaling_max_freq", "3400000"),
            ("scaling_governor", "powersave" if number == 3 else "performance"),
        )
    }
    heat = {"cpu0/thermal_throttle/core_throttle_count": "2", "cpu1/thermal_throttle/package_throttle_count": "3"}

    assert read_speed(_Copy(FOUR | frequencies | heat)) == MachineSpeed(
        governor="performance, powersave", mhz=2150, limit_mhz=3400, throttled=5
    )
    assert read_speed(LinuxEffects()).throttled >= 0, "of this machine, whatever it has"


def test_used_memory_leaves_out_copies_of_files(tree: GroupTree) -> None:
    tree.make("vision")
    tree.write("vision", GroupValues(shares_percent=100, memory=256 * MIB))

    sleeper = _sleeper_in(tree, "vision")

    assert 16 * MIB <= (tree.used_memory("vision") or 0) < 64 * MIB
    tree.remove("vision")
    sleeper.wait()
