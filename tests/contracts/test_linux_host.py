"""What only a Linux host does: its settings are the kernel's, by any writer, and a restart ends every one."""

import json
import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from rarms_iac.model.changes import Address
from rarms_iac.model.host import LinuxHost, ProviderKind
from rarms_iac.model.operations import (
    CreatePartition,
    RenamePartition,
    StartPartition,
    StopPartition,
    WriteMark,
    set_to,
)
from rarms_iac.model.plan import Scope
from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.providers.cgroups.groups import GroupTree
from rarms_iac.providers.cgroups.provider import LinuxHostProvider
from rarms_iac.providers.cgroups.trees import CONTROL_GROUPS, find_tree
from rarms_iac.providers.interface import HostDamaged, HostFailed, HostRefused
from tests import builders
from tests.contracts.benches import groups_of, open_linux, opened_bench
from tests.contracts.runs import a_run
from tests.laws.test_damaged_file_laws import IRREGULAR_FILES, ODD_VALUES, changed, in_time, paths_in

MIB = 2**20
SCOPE = Scope(application="robot", plan="0123456789ab")
VISION = Address(partition="vision")


@pytest.fixture
def host(tmp_path: Path) -> Iterator[LinuxHostProvider]:
    """A host of two processors with one partition that runs: 40 % of both, 64 MiB."""
    for _ in opened_bench("linux"):
        host = open_linux(builders.a_host(), tmp_path)
        for operation in (
            CreatePartition(partition="vision", generation=0, memory=64 * MIB),
            WriteMark(partition="vision", application="robot", name="vision", set="0" * 12),
            set_to("vision", processors=2),
            set_to("vision", reserve=40, limit=100, weight=100),
            RenamePartition(partition="vision", name="vision"),
            StartPartition(partition="vision"),
        ):
            host.execute(operation, SCOPE)
        yield host


def by_hand(folder: Path, file: str, text: str) -> None:
    """Write a file of the kernel, as a person at a terminal would; version 1 only."""
    (path,) = CONTROL_GROUPS.glob(f"*/{groups_of(folder)._slices['cpu'].name}/vision/{file}")
    path.write_text(text)


@pytest.mark.parametrize(
    ("file", "text", "expected"),
    [
        ("cpu.shares", "805", {"reserve": 41}),
        ("cpu.shares", "795", {"reserve": 39}),
        ("cpu.cfs_quota_us", "50000", {"limit": 25, "quota_period_us": 100_000}),
        ("cpuset.cpus", "1", {"processors": 1, "reserve": 80}),
        ("memory.limit_in_bytes", "-1", {"memory": 0}),
    ],
)
def test_a_value_that_another_tool_wrote_is_seen(
    host: LinuxHostProvider, tmp_path: Path, file: str, text: str, expected: dict[str, int]
) -> None:
    if groups_of(tmp_path).version != "v1":
        pytest.skip("needs control-groups: the files are those of version 1")
    before = host.read(VISION, SCOPE)

    by_hand(tmp_path, file, text)

    assert host.read(VISION, SCOPE) == {**before, **expected}
    host.execute(set_to("vision", reserve=40, limit=100, weight=100), SCOPE)
    assert host.read(VISION, SCOPE) == before


def test_after_reboot_partitions_are_off_and_start(host: LinuxHostProvider, tmp_path: Path) -> None:
    host.execute(set_to("vision", start_action="start"), SCOPE)
    groups_of(tmp_path).remove("vision")
    restarted = open_linux(builders.a_host(), tmp_path, boot="another start")

    (partition,) = restarted.observe().partitions
    assert not partition.settings.running
    assert partition.mark is not None
    assert [finding.code for finding in restarted.examined("robot").findings] == ["RARMS316", "RARMS317"]
    restarted.execute(StartPartition(partition="vision"), SCOPE)

    assert restarted.read(VISION, SCOPE)["running"] is True
    assert restarted.read(VISION, SCOPE)["reserve"] == 40
    assert [finding.code for finding in restarted.examined("robot").findings] == ["RARMS317"]


def test_foreign_group_is_unmanaged_until_imported(host: LinuxHostProvider, tmp_path: Path) -> None:
    groups_of(tmp_path).make("logging")
    logging = next(found for found in host.observe().partitions if found.settings.name == "logging")
    assert (logging.mark, logging.settings.running) == (None, True)

    mark = WriteMark(partition="logging", application="robot", name="logging", set="1" * 12, machine=logging.id)
    host.execute(mark, SCOPE)

    taken = next(found for found in host.observe().partitions if found.settings.name == "logging")
    assert taken.id == logging.id
    assert taken.mark is not None
    assert taken.settings == logging.settings


def test_memory_the_kernel_keeps_is_refused(host: LinuxHostProvider, monkeypatch: pytest.MonkeyPatch) -> None:
    before = host.read(VISION, SCOPE)
    real, failing = type(host.tree).write, [True]

    def refuse_once(*arguments: object) -> None:
        if failing.pop():
            failing.append(False)
            raise OSError(16, "Device or resource busy")
        failing.append(False)
        real(*arguments)  # type: ignore[arg-type]  # as it was called

    monkeypatch.setattr(type(host.tree), "write", refuse_once)

    with pytest.raises(HostRefused, match="the kernel refuses: Device or resource busy"):
        host.execute(set_to("vision", memory=32 * MIB), SCOPE)

    assert host.read(VISION, SCOPE) == before


def test_what_control_groups_do_not_have_is_refused(host: LinuxHostProvider) -> None:
    with pytest.raises(HostRefused, match="a control group cannot do this"):
        host.execute(set_to("vision", secure_boot="off"), SCOPE)
    with pytest.raises(HostRefused, match="do not have dynamic memory"):
        host.execute(set_to("vision", memory=32 * MIB, dynamic_memory=True), SCOPE)


def test_what_others_may_write_is_not_believed(host: LinuxHostProvider, tmp_path: Path) -> None:
    (tmp_path / "rarms").chmod(0o777)

    with pytest.raises(HostDamaged, match="users other than root may write"):
        host.observe()


def test_held_host_has_folder_for_root_alone(host: LinuxHostProvider, tmp_path: Path) -> None:
    with host.lock("ann@lab"):
        assert (tmp_path / "rarms").stat().st_mode & 0o777 == 0o700


def test_folder_open_to_others_is_refused(host: LinuxHostProvider, tmp_path: Path) -> None:
    (tmp_path / "rarms").chmod(0o777)

    for _ in "12":
        with pytest.raises(HostDamaged, match="users other than root may write"), host.lock("ann@lab"):
            pass


def test_refused_removal_of_leftover_is_told(
    host: LinuxHostProvider, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (file,) = (tmp_path / "rarms").glob("*.json")
    document = json.loads(file.read_bytes())
    file.write_text(json.dumps({**document, "boot": ""}), encoding="ascii")

    def refuse(*_: object) -> None:
        raise OSError(16, "Device or resource busy")

    with monkeypatch.context() as patch:
        patch.setattr(type(host.tree), "remove", refuse)
        with pytest.raises(HostFailed, match="vision: the kernel refuses: Device or resource busy"):
            host.lock("ann@lab").__enter__()


@pytest.mark.needs("control-groups")
def test_slice_that_rarms_did_not_make_is_refused(tmp_path: Path) -> None:
    for _ in opened_bench("linux"):
        groups_of(tmp_path).make("services")
        before = groups_of(tmp_path).read("")
        for use in (
            lambda: open_linux(builders.a_host(), tmp_path).observe(),
            lambda: open_linux(builders.a_host(), tmp_path).examined("robot"),
            lambda: open_linux(builders.a_host(keep_processor="10 %"), tmp_path).lock("ann@lab").__enter__(),
        ):
            with pytest.raises(HostRefused, match="has no record that rarms created it"):
                use()

        assert groups_of(tmp_path).names() == ("services",)
        assert groups_of(tmp_path).read("") == before


def test_what_the_machine_lacks_is_named_first(tmp_path: Path) -> None:
    described = builders.a_host(provider=ProviderKind.LINUX, settings=LinuxHost(control_groups="v2"))
    if isinstance(find_tree("rarms", "v2"), GroupTree):
        pytest.skip("needs control-groups: this machine lacks nothing of version 2")

    with pytest.raises(HostRefused, match="version 2 of control groups at "):
        LinuxHostProvider(described, tmp_path).observe()


def test_unwritten_definition_is_read_or_refused(host: LinuxHostProvider, tmp_path: Path) -> None:
    (file,) = (tmp_path / "rarms").glob("*.json")
    document = json.loads(file.read_bytes())
    for path in paths_in(document):
        for value in ODD_VALUES:
            with suppress(ValueError, TypeError):  # JSON has no such value
                file.write_text(json.dumps(changed(document, path, value)), encoding="utf-8")
            with in_time(), suppress(HostDamaged, HostFailed, HostRefused), host.lock("ann@lab"):
                host.execute(set_to("vision", reserve=40, limit=90, weight=100), SCOPE)

    file.write_text(json.dumps({**document, "settings": {}}), encoding="utf-8")
    with pytest.raises(HostDamaged):
        host.observe()


@pytest.mark.parametrize("answer", ["", "abc", "0-99999999999", "max", "9" * 30])
def test_odd_kernel_files_are_the_hosts_failure(
    host: LinuxHostProvider, monkeypatch: pytest.MonkeyPatch, answer: str
) -> None:
    real, odd, files = LinuxEffects.read, [Path()], dict[Path, None]()

    def read(effects: LinuxEffects, path: Path) -> str:
        files[path] = None
        return answer if path == odd[0] else real(effects, path)

    def use() -> None:
        with host.lock("ann@lab"):
            host.examined("robot")
            host.execute(set_to("vision", reserve=40, limit=90, weight=100), SCOPE)
            host.execute(set_to("vision", memory=64 * MIB), SCOPE)

    monkeypatch.setattr(host, "_described_facts", None)  # the machine's own files, too
    monkeypatch.setattr(LinuxEffects, "read", read)
    use()

    refused = 0
    for odd[0] in tuple(files):
        with in_time():
            try:
                use()
            except (HostFailed, HostRefused):
                refused += 1
    assert refused > 5, sorted(files)


@pytest.mark.parametrize("place", IRREGULAR_FILES)
def test_definition_that_is_no_file_is_refused(
    host: LinuxHostProvider, tmp_path: Path, place: Callable[[Path], None]
) -> None:
    (file,) = (tmp_path / "rarms").glob("*.json")
    file.unlink()
    place(file)

    with in_time(), pytest.raises((HostDamaged, HostFailed), match=file.name):
        host.observe()


@pytest.mark.needs("root")
def test_state_folder_of_another_user_is_refused(tmp_path: Path) -> None:
    os.chown(tmp_path, 65534, 65534)
    host = open_linux(builders.a_host(), tmp_path)

    for use in (host.journal, host.unfinished, lambda: host.lock("ann@lab").__enter__()):
        with pytest.raises(HostDamaged, match=f"users other than root may write to {tmp_path}"):
            use()

    assert list(tmp_path.iterdir()) == []


def test_host_files_ignore_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        for _ in opened_bench("linux"):
            host = open_linux(builders.a_host(), tmp_path / "state")
            with host.lock("ann@lab"):
                host.start_run(a_run(host.observe()))
    finally:
        os.umask(before)

    made = [path for path in (tmp_path / "state").rglob("*") if not path.is_symlink()]
    assert made
    assert [path.name for path in made if path.stat().st_mode & 0o022] == []


def test_rules_of_threads_are_there_while_group_runs(host: LinuxHostProvider, tmp_path: Path) -> None:
    assert [*tmp_path.glob("*.threads")] == []
    host.execute(set_to("vision", threads="controller* at 21"), SCOPE)
    (file,) = tmp_path.glob("*.threads")
    (group,) = json.loads(file.read_bytes())
    assert json.loads(file.read_bytes()) == {group: "controller* at 21"}
    assert (Path(group) / "cgroup.procs").is_file()
    budget = groups_of(tmp_path)._slices["cpu"] / "vision" / "cpu.rt_runtime_us"
    if budget.exists():
        assert budget.read_text(encoding="ascii") == "40000\n"

    file.unlink()  # a kill came before it was written
    with host.lock("the next run"):
        assert file.exists()
    host.execute(StopPartition(partition="vision", grace_ms=0), SCOPE)
    assert not file.exists()
    host.execute(StartPartition(partition="vision"), SCOPE)
    assert file.exists()
    host.execute(set_to("vision", threads=""), SCOPE)
    assert not file.exists()
