"""The loop as a law: a random system on a random host is planned, its scripts run, and then there is nothing to do."""

from copy import deepcopy
from dataclasses import replace

from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from rarms_iac.model.capacity import decide_packing
from rarms_iac.model.claims import Claim
from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.model.plan import Plan
from rarms_iac.model.system import RunsOn, System
from tests.builders import a_capacity, a_host
from tests.effort import examples
from tests.fake_powershell.cell import Cell, apply, undo
from tests.fake_powershell.cells import a_stranger, a_windows
from tests.fake_powershell.host import Vm, WindowsHost
from tests.strategies import FOREIGN_NAMES, systems

FEW = settings(
    max_examples=examples(3), deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much]
)


def a_hyperv_host(logical_processors: int) -> Host:
    return a_host("onboard", provider=ProviderKind.HYPERV, logical_processors=logical_processors, memory="8 GiB")


@st.composite
def hosts(draw: st.DrawFn) -> WindowsHost:
    """A server with up to three machines of others: running, off, saved, starting by themselves."""
    found: list[Vm] = []
    for number, name in enumerate(draw(st.lists(st.sampled_from(FOREIGN_NAMES), max_size=3))):
        state = draw(st.sampled_from(["Off", "Running", "Saved", "Paused"]))
        start = draw(st.sampled_from(["Nothing", "Start", "StartIfRunning"]))
        reserve = draw(st.integers(0, 9))
        notes = draw(st.sampled_from(["", "keep me", "rarms/1 robot/arm vm=00000000 set=000000000000"]))
        stranger = a_stranger(name, number, state=state, start_action=start, reserve=reserve, notes=notes)
        found.append(stranger)
    return a_windows(*found, logical_processors=draw(st.integers(2, 4)))


@st.composite
def hyperv_systems(draw: st.DrawFn, logical_processors: int) -> System:
    """Task classes only in the host's own Windows: each guest's would be two scripts more to inspect."""
    system = draw(systems(a_hyperv_host(logical_processors)))
    components = {
        name: component if component.runs_on is RunsOn.HOST else replace(component, task=None)
        for name, component in system.components.items()
    }
    return replace(system, components=components)


@st.composite
def laid_out(draw: st.DrawFn) -> Cell:
    host = draw(hosts())
    return Cell(draw(hyperv_systems(host.logical_processors)), host)


def within(host: WindowsHost) -> None:
    """What the host has promised to what runs fits: per processor, and in memory."""
    active = [vm for vm in host.vms.values() if vm.active]
    promises = [Claim(processors=vm.processors, reserve=vm.reserve) for vm in active]
    assert decide_packing(promises, a_capacity(host.logical_processors)) is not False, promises
    assert sum(vm.memory for vm in active) <= host.memory


def strangers_of(host: WindowsHost) -> list[Vm]:
    return deepcopy([vm for name, vm in sorted(host.vms.items()) if name.startswith("ffff")])


def possible(cell: Cell) -> Plan:
    """The plan; what cannot be planned is not a case of a law about running."""
    plan = cell.prepare().plan
    assume(plan is not None)
    assert plan is not None
    return plan


@FEW
@given(laid_out(), st.data())
def test_changed_wish_is_applied_and_stays(cell: Cell, data: st.DataObject) -> None:
    first, host = possible(cell), cell.host.copy(watch=within)
    before = strangers_of(host)
    assert apply(host, first).code == 0
    other = Cell(data.draw(hyperv_systems(host.logical_processors)), host)
    plan = possible(other)
    seen = other.observe()

    ran = apply(host, plan)

    assert ran.code == 0, ran.says
    assert [str(step.address) for step in other.plan().hosts[0].steps] == []
    assert strangers_of(host) == before
    if not any(step.undo.message for step in plan.hosts[0].steps):
        assert undo(host, plan).code == 0
        assert other.observe().partitions == seen.partitions
