"""Disks on the fake: only what rarms made is deleted, and only as the plan knew it."""

import re
from collections.abc import Callable
from dataclasses import replace

import pytest

from rarms_iac.model.plan import Purpose
from tests.effort import every_few
from tests.fake_powershell.cell import apply, apply_script, undo
from tests.fake_powershell.cells import IMAGE, a_stranger, fresh, removal
from tests.fake_powershell.host import WindowsHost
from tests.fake_powershell.hyperv import CHILD
from tests.fake_powershell.run import run


def disk_of(host: WindowsHost) -> str:
    (path,) = host.machine("planning").disks
    return path


def test_disk_is_deleted_with_machine_on_request() -> None:
    prepared = removal()
    host = prepared.copy()
    path = disk_of(host)

    ran = apply(host, prepared.plan)

    assert ran.code == 0, ran.says
    assert host.file(path) is None
    assert host.file(IMAGE) is not None
    assert [finding.code for finding in prepared.plan.findings] == ["RARMS253"]
    assert prepared.cell.on(host).plan(purpose=Purpose.DESTROY, remove_disks=True).hosts[0].steps == ()


def test_disk_stays_unasked_and_is_told() -> None:
    cell = removal().cell
    host = cell.host.copy()
    plan = cell.plan(purpose=Purpose.DESTROY)

    ran = apply(host, plan)

    assert ran.code == 0, ran.says
    assert host.file(disk_of(cell.host)) is not None
    (told,) = [finding for finding in plan.findings if finding.code == "RARMS224"]
    assert disk_of(cell.host) in told.detail


def _checkpoint(host: WindowsHost) -> None:
    vm = host.machine("planning")
    vm.checkpoint_count = 1


def _another_machine(host: WindowsHost) -> None:
    other = a_stranger("borrower", 5, state="Off", start_action="Nothing", disks=[disk_of(host).upper()])
    host.vms[other.id] = other


def _a_child(host: WindowsHost) -> None:
    host.write_file("D:\\lab\\child.vhdx", CHILD + disk_of(host).replace("\\", "/").encode())
    other = a_stranger("borrower", 5, state="Off", start_action="Nothing", disks=["D:\\lab\\child.vhdx"])
    host.vms[other.id] = other


def _a_checkpoint_of_another(host: WindowsHost) -> None:
    other = a_stranger("borrower", 5, state="Off", start_action="Nothing")
    host.vms[other.id] = replace(other, checkpoint_count=1, checkpoint_disks=[disk_of(host)])


def _another_parent(host: WindowsHost) -> None:
    host.write_file(disk_of(host), CHILD + b"D:\\images\\other.vhdx")


def _no_child(host: WindowsHost) -> None:
    host.write_file(disk_of(host), b"everything of its own")


MOVES: list[Callable[[WindowsHost], None]] = [
    _checkpoint,
    _another_machine,
    _a_child,
    _a_checkpoint_of_another,
    _another_parent,
    _no_child,
]


@pytest.mark.parametrize("move", MOVES, ids=lambda move: move.__name__.strip("_"))
def test_changed_disk_is_not_deleted(move: Callable[[WindowsHost], None]) -> None:
    prepared = removal()
    host = prepared.copy()
    path = disk_of(host)
    move(host)

    ran = apply(host, prepared.plan)

    assert ran.code == 3, ran.says
    assert host.file(path) is not None


def test_disk_named_like_a_pattern_is_refused() -> None:
    prepared = removal()
    host = prepared.copy()
    path = disk_of(host)
    host.write_file("D:\\lab\\a[1].vhdx", b"a disk")
    other = a_stranger("borrower", 5, state="Off", start_action="Nothing", disks=["D:\\lab\\a[1].vhdx"])
    host.vms[other.id] = other

    ran = apply(host, prepared.plan)

    assert ran.code == 1, ran.says
    assert "D:\\\\lab\\\\a[1].vhdx: Get-VHD reads this name as a pattern; rename the file" in ran.says
    assert host.file(path) is not None


# What another machine's checkpoints need only the step sees; another parent makes it a child all the same.
SEEN = [move for move in MOVES if move not in (_a_checkpoint_of_another, _another_parent)]


@pytest.mark.parametrize("move", SEEN, ids=lambda move: move.__name__.strip("_"))
def test_next_plan_leaves_moved_disk(move: Callable[[WindowsHost], None]) -> None:
    prepared = removal()
    host = prepared.copy()
    path = disk_of(host)
    move(host)

    plan = prepared.cell.on(host).plan(purpose=Purpose.DESTROY, remove_disks=True)
    ran = apply(host, plan)

    assert ran.code == 0, ran.says
    assert host.file(path) is not None
    assert [finding.code for finding in plan.findings] == ["RARMS254"]


def below(host: WindowsHost, folder: str = "D:\\vms\\") -> set[str]:
    """Files and folders there, without the plan's id."""
    return {re.sub("-[0-9a-f]{12}", "", file.path) for file in host.files.values() if file.path.startswith(folder)}


def test_undo_leaves_no_partition_folder() -> None:
    prepared = fresh()
    whole = prepared.effects()
    made: set[str] = set()
    for number in (*every_few(len(whole), 3), len(whole)):
        host = prepared.copy(kill_after=number)
        apply(host, prepared.plan)
        made = below(host)
        host = host.copy()

        ran = undo(host, prepared.plan)

        where = whole[number] if number < len(whole) else "done"
        assert ran.code == 0 or (ran.code == 3 and "undo that run first" in ran.says), f"{where}\n{ran.says}"
        assert below(host) == set(), where
    assert made == {"D:\\vms\\planning", "D:\\vms\\planning\\planning.vhdx"}


@pytest.mark.parametrize("content", [CHILD + b"D:\\images\\other.vhdx", b"everything of its own"])
def test_foreign_file_is_not_taken_for_the_disk(content: bytes) -> None:
    prepared = fresh()
    host = prepared.copy()
    path = f"D:\\vms\\planning\\planning-{prepared.plan.id}.vhdx"
    host.write_file(path, content)

    ran = apply(host, prepared.plan)

    assert ran.code == 3, ran.says
    assert ran.status_of("partition/planning/disk")[-1] == "refused"
    assert not any(path in vm.disks for vm in host.vms.values())


def test_child_disk_matches_parent_in_any_case() -> None:
    prepared = fresh()
    made = prepared.effect("New-VHD")
    host = prepared.after_a_run(kill_after=made)
    path = f"D:\\vms\\planning\\planning-{prepared.plan.id}.vhdx"
    host.write_file(path, CHILD + IMAGE.upper().replace("\\", "/").encode())

    ran = run(host, apply_script(prepared.plan))

    assert ran.code == 0, ran.says
    assert disk_of(host) == path
