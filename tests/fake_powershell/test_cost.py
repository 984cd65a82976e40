"""What a script costs its reader and its host: lines, and calls of Hyper-V's cmdlets (figures in docs/scripts.md)."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace

import pytest

from rarms_iac.model.plan import Plan, Purpose
from rarms_iac.model.system import HypervPartition, System
from tests.builders import a_component, a_partition
from tests.fake_powershell import cmdlets, hyperv
from tests.fake_powershell.cell import Cell, apply, apply_script, scripts_of, undo, undo_script
from tests.fake_powershell.cells import IMAGE, a_cell_system, a_stranger, a_windows
from tests.fake_powershell.host import WindowsHost
from tests.fake_powershell.observing import document_of
from tests.fake_powershell.scopes import Scope
from tests.fake_powershell.values import Value

PARTITIONS = 3
Calls = Counter[str]


def a_system(count: int, reserve: int = 5, others: int = 5) -> System:
    """So many partitions, the first with this reserve in per cent, the others with theirs."""
    reserves = [reserve, *([others] * (count - 1))]
    return a_cell_system(
        *(
            a_component(f"part-{number:02}", reserve=f"{share} %", processors=1, memory="256 MiB")
            for number, share in enumerate(reserves)
        )
    )


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Calls:
    """How often each of Hyper-V's cmdlets was called; `get-vm` without an id lists all machines."""
    counted: Calls = Counter()

    def counting(name: str, cmdlet: Callable[[Scope, Mapping[str, Value]], Value]) -> object:
        def call(scope: Scope, given: Mapping[str, Value]) -> Value:
            counted[f"{name} -id" if name == "get-vm" and "id" in given else name] += 1
            return cmdlet(scope, given)

        return call

    for name in (*hyperv.CMDLETS, "receive-job", "remove-job"):
        monkeypatch.setitem(cmdlets.CMDLETS, name, counting(name, cmdlets.CMDLETS[name]))
    return counted


def counted_run(calls: Calls, host: WindowsHost, plan: Plan) -> tuple[int, int]:
    """The steps of a plan, of which a script joins those that it can, and the calls that its run made."""
    calls.clear()
    ran = apply(host, plan)
    assert ran.code == 0, ran.says
    return len(plan.hosts[0].steps), calls.total()


@pytest.mark.parametrize("count", [1, PARTITIONS])
def test_creation_takes_four_calls_a_step(count: int, calls: Calls) -> None:
    host = a_windows()
    plan = Cell(a_system(count), host.copy()).plan()

    steps, made = counted_run(calls, host, plan)
    assert made <= 4 * steps
    _, looked = counted_run(calls, host, plan)

    assert calls["get-vm"] <= 2
    assert looked <= 2 + 4 * count


def test_a_changed_reserve_takes_four_calls_a_step(calls: Calls) -> None:
    host = a_windows()
    apply(host, Cell(a_system(PARTITIONS), host.copy()).plan())
    plan = Cell(a_system(PARTITIONS, reserve=8), host.copy()).plan()

    steps, made = counted_run(calls, host, plan)

    assert (steps, calls["get-vm"], calls["get-vmsecurity"]) == (2, 1, 1)
    assert made - calls["get-vmsecurity"] <= 4 * steps
    _, looked = counted_run(calls, host, plan)
    assert (looked, calls["get-vmsecurity"]) == (3, 0)


def test_swapped_reserves_take_four_calls_a_step(calls: Calls) -> None:
    def halves(first: int) -> System:
        shares = {"first": first, "second": 90 - first}
        return a_cell_system(*(a_component(name, reserve=f"{share} %", processors=4) for name, share in shares.items()))

    host = a_windows()
    apply(host, Cell(halves(60), host.copy()).plan())
    plan = Cell(halves(30), host.copy()).plan()

    steps, made = counted_run(calls, host, plan)

    assert (steps, {vm.name: vm.reserve for vm in host.vms.values()}) == (4, {"first": 30, "second": 60})
    assert made <= 4 * steps


def test_a_removal_takes_five_calls_a_step(calls: Calls) -> None:
    host = a_windows()
    apply(host, Cell(a_system(PARTITIONS), host.copy()).plan())
    for vm in host.vms.values():
        vm.needs_ms = 500
    plan = Cell(a_system(PARTITIONS), host.copy()).plan(purpose=Purpose.DESTROY)

    steps, made = counted_run(calls, host, plan)

    assert (steps, host.vms) == (2 * PARTITIONS, {})
    assert (calls["get-vm"], calls["get-vm -id"]) == (4, 6)  # what was listed after one removal serves the next
    assert made - calls["get-vmsecurity"] - calls["remove-job"] <= 5 * steps


@pytest.mark.parametrize("count", [1, 30])
def test_observing_takes_at_most_twelve_calls(count: int, calls: Calls) -> None:
    host = a_windows(*(a_stranger(f"m{number}", number, disks=[IMAGE]) for number in range(count)))

    document_of(host)

    assert calls.total() <= 12
    assert len(document_of(host)["virtual_disks"]["value"]) == count


def test_unreadable_machine_hides_no_others(calls: Calls) -> None:
    host = a_windows(*(a_stranger(f"m{number}", number) for number in range(5)))
    host.refusals["Get-VMMemory m3"] = ("InvalidState,GetVMMemory", "InvalidOperation", "it is busy")

    document = document_of(host)

    assert [machine["name"] for machine in document["machines"]["value"]] == ["m0", "m1", "m2", "m4"]
    assert [machine["name"] for machine in document["unread_machines"]["value"]] == ["m3"]
    assert calls["get-vmprocessor"] == 1


def test_long_reading_reports_every_ten_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    host = a_windows()
    plan = Cell(a_system(PARTITIONS), host.copy()).plan()
    apply(host, plan)

    def slow(scope: Scope, given: Mapping[str, Value]) -> Value:
        scope.session.host.clock += 20_000
        return hyperv.CMDLETS["get-vmsecurity"](scope.session, given)

    monkeypatch.setitem(cmdlets.CMDLETS, "get-vmsecurity", slow)
    changed = Cell(a_system(PARTITIONS, reserve=8, others=8), host.copy()).plan()

    ran = apply(host, changed)

    assert ran.code == 0, ran.says
    assert ran.status_of("partition/part-01")[0] == "reading"


def lines_of(system: System) -> list[str]:
    """The script that makes this on a host without machines."""
    plan = Cell(system, a_windows()).plan()
    return scripts_of(plan)[apply_script(plan)].decode("ascii").split("\r\n")


def from_an_image(count: int) -> System:
    """So many partitions alike, each with a disk that grows out of an image."""
    system = a_system(count)
    made = HypervPartition(image=IMAGE, vm_path="D:\\vms")
    return replace(system, partitions={name: a_partition(name, hyperv=made) for name in system.components})


@pytest.mark.parametrize(
    ("system", "apply_lines", "undo_lines"),
    [(a_system(10), 145, 125), (from_an_image(10), 170, 160), (from_an_image(1), 115, 115)],
    ids=["ten", "ten from an image", "one from an image"],
)
def test_apply_and_undo_scripts_are_few_lines(system: System, apply_lines: int, undo_lines: int) -> None:
    host = a_windows()
    plan = Cell(system, host.copy()).plan()
    scripts = scripts_of(plan)

    made = apply(host, plan)
    running = [vm.name for vm in host.vms.values() if vm.state == "Running"]
    undone = undo(host, plan)

    assert (made.code, undone.code) == (0, 0), (made.says, undone.says)
    assert (sorted(running), host.vms) == (sorted(system.components), {})
    assert scripts[apply_script(plan)].count(b"\n") <= apply_lines
    assert scripts[undo_script(plan)].count(b"\n") <= undo_lines


def test_changed_reserve_takes_85_lines() -> None:
    host = a_windows()
    apply(host, Cell(a_system(10), host.copy()).plan())
    single, ten = (Cell(a_system(10, 8, others), host.copy()).plan() for others in (5, 6))

    counts = [text.count(b"\n") for plan in (single, ten) for text in scripts_of(plan).values()]

    assert (apply(host, ten).code, {vm.reserve for vm in host.vms.values()}) == (0, {24, 32})
    assert (max(counts[:2]), max(counts[2:])) <= (85, 135)


def test_one_number_changes_few_script_lines() -> None:
    before, after = (lines_of(a_system(PARTITIONS, reserve=reserve)) for reserve in (6, 7))

    assert len(after) == len(before)
    changed = sum(old != new for old, new in zip(before, after, strict=True))
    assert 3 < changed <= 11 + 2 * PARTITIONS  # a pending name holds the plan's id
