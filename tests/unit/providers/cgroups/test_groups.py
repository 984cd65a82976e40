"""Control groups: version 1 against the kernel below a slice of the test's own, version 2's files in a plain folder."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.providers.cgroups.groups import GroupTree, GroupValues
from rarms_iac.providers.cgroups.trees import CONTROL_GROUPS, MissingFeatures, find_tree
from tests.needs import require

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
