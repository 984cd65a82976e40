"""How the difference and its text grow with the number of components, on one host and over a fleet.

Every partition has another weight than on the host, so that each is a change with steps.
"""

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import date
from fractions import Fraction

from benchmarks.timing import Figure, interleaved, median_ratio, report, seconds
from rarms_iac.applying.goals import HostGoal, goals_of
from rarms_iac.applying.prepare import PlanningRequest, PlanningResult, prepare
from rarms_iac.diff.compare import compare
from rarms_iac.diff.hold_back import hold_back
from rarms_iac.diff.order import OrderedSteps, order
from rarms_iac.diff.steps import plan_changes
from rarms_iac.model.diagnostics import Place
from rarms_iac.model.host import Host, KeepForHost, ProviderKind, SchedulerType, SimulatedHost
from rarms_iac.model.layout import Layout
from rarms_iac.model.plan import Plan
from rarms_iac.model.quantities import Bytes, LogicalProcessors, ProcessorTime
from rarms_iac.model.state import HostFacts, Rights, State
from rarms_iac.model.system import Application, Component, CpuRequest, Disruption, Policy, RunsOn, System
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.reservations import FixedReservations
from rarms_iac.views.console import render
from rarms_iac.views.plan import plan_text

SMALL, LARGE = 1_000, 4_000
GOAL = 5.0
PLANNED_IN_MS = 200
NO_CHANGES_IN_S = 1.0
ROUNDS = 3


class NoPlaces:
    """Places of a system that was never text."""

    def value(self, *path: str | int) -> Place:
        return Place(file="rarms.yaml", line=1, column=1, path=".".join(map(str, path)))

    def key(self, *path: str | int) -> Place:
        return self.value(*path)


def component(number: int, weight: int) -> Component:
    return Component(
        name=f"part-{number:04}",
        criticality=number % 97,
        apt={},
        run=None,
        memory=Bytes((64 + number % 4 * 64) << 20),
        processors=1,
        cpu=CpuRequest(reserve=ProcessorTime(LogicalProcessors(Fraction(1 + number % 3, 100))), weight=weight),
        together=(),
        apart=(),
        dedicated=False,
        task=None,
        hosts=None,
        runs_on=RunsOn.PARTITION,
        interference=None,
        simulation=None,
    )


def system(components: int, hosts: int, weight: int) -> System:
    """So many components on so many hosts, with this weight."""
    names = [f"cell-{number:04}" for number in range(hosts)]
    return System(
        application=Application(name="fleet"),
        hosts={name: host(name, components // hosts) for name in names},
        components={drawn.name: drawn for drawn in (component(number, weight) for number in range(components))},
        partitions={},
        interference={},
        tasks={},
        policy=Policy(),
        moved={},
    )


def host(name: str, components: int) -> Host:
    return Host(
        name=name,
        provider=ProviderKind.SIMULATED,
        logical_processors=max(8, components // 40),
        memory=Bytes(components << 30),
        keep_for_host=KeepForHost(),
        platform="cell",
        connect=None,
        settings=SimulatedHost(),
    )


def empty(host: Host) -> State:
    return State(
        facts=HostFacts(
            name=host.name,
            id=f"id-{host.name}",
            provider=host.provider,
            computer_name=host.name,
            os_build=26100,
            client=False,
            scheduler=SchedulerType.CLASSIC,
            smt=False,
            logical_processors=host.logical_processors,
            memory=int(host.memory),
            rights=Rights.PROVEN,
        )
    )


def applied(wanted_system: System) -> dict[str, State]:
    """The hosts as they are when all of it was applied."""
    nothing = {name: empty(host) for name, host in wanted_system.hosts.items()}
    requests = goals_of(wanted_system, nothing, NoPlaces(), Disruption.HOST_RESTART)
    return {name: with_ids(request.desired) for name, request in requests.hosts.items()}


def with_ids(desired: State) -> State:
    made = []
    for number, partition in enumerate(desired.partitions):
        machine = f"{number:08x}-made"
        assert partition.mark is not None
        made.append(replace(partition, id=machine, mark=replace(partition.mark, machine=machine[:8])))
    return replace(desired, partitions=tuple(made))


@dataclass(frozen=True, slots=True)
class Case:
    """A fleet as it is, and a plan for the manifest that wants something else."""

    requests: Mapping[str, HostGoal]
    plan: Plan

    def difference_and_text(self) -> None:
        """What the goal is about: the difference of every host, in order, and the whole plan as text."""
        for request in self.requests.values():
            found = compare(request.desired, request.observed, "fleet", request.context, request.rules)
            held = hold_back(found.changes, request.budget)
            if not isinstance(order(plan_changes(held.allowed, request.context), request.budget), OrderedSteps):
                raise TypeError("a fleet with room to spare has an order")
        if "to change" not in render(plan_text(self.plan)):
            raise ValueError("the plan's text does not count its changes")


def case(components: int, hosts: int) -> Case:
    observed = applied(system(components, hosts, weight=100))
    heavier = system(components, hosts, weight=200)
    requests = goals_of(heavier, observed, NoPlaces(), Disruption.HOST_RESTART)
    made = prepare(request(heavier), observed)
    if made.plan is None:
        raise ValueError(f"no plan: {made.findings[:3]}")
    return Case(requests=requests.hosts, plan=made.plan)


def request(wanted_system: System) -> PlanningRequest:
    return PlanningRequest(
        system=wanted_system,
        places=NoPlaces(),
        manifest="rarms.yaml",
        manifest_digest="0" * 64,
        today=date(2026, 1, 1),
    )


def growth(name: str, hosts: Mapping[int, int]) -> Figure:
    small, large = (case(number, hosts[number]) for number in (SMALL, LARGE))
    times = interleaved({"small": small.difference_and_text, "large": large.difference_and_text}, rounds=ROUNDS)
    return Figure(name=name, value=median_ratio(times["large"], times["small"]), at_most=GOAL)


def figures() -> Iterator[Figure]:
    yield growth("difference and text, 4,000 to 1,000 components on one host", {SMALL: 1, LARGE: 1})
    yield growth("difference and text, 4,000 to 1,000 components, 50 a host", {SMALL: SMALL // 50, LARGE: LARGE // 50})
    fleet = system(SMALL, 20, weight=100)
    layouts: list[object] = []
    took = min(
        seconds(lambda: layouts.append(plan_layout(fleet, FixedReservations(), {}, NoPlaces()).answer))
        for _ in range(ROUNDS)
    )
    if not all(isinstance(layout, Layout) for layout in layouts):
        raise TypeError("the fleet has a layout")
    yield Figure(name="layout of 1,000 components on 20 hosts", value=1000 * took, unit="ms", at_most=PLANNED_IN_MS)
    observed = applied(fleet)
    plans: list[PlanningResult] = []
    took = min(seconds(lambda: plans.append(prepare(request(fleet), observed))) for _ in range(ROUNDS))
    if any(plan.plan is None or plan.plan.has_changes for plan in plans):
        raise ValueError("a fleet that was applied has no changes")
    yield Figure(name="plan without changes for 1,000 components", value=took, unit="s", at_most=NO_CHANGES_IN_S)


if __name__ == "__main__":
    sys.exit(report(list(figures())))
