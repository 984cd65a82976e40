"""How the difference and its text grow with the number of components, on one host and over a fleet.

Every partition has another weight than on the host, so that each is a change with steps.
"""

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import date

from laboratory.benchmarks.timing import Figure, interleaved, median_ratio, report
from rarms_iac.applying.goals import HostGoal, goals_of
from rarms_iac.applying.prepare import PlanningRequest, prepare
from rarms_iac.diff.compare import compare
from rarms_iac.diff.hold_back import hold_back
from rarms_iac.diff.order import OrderedSteps, order
from rarms_iac.diff.steps import plan_changes
from rarms_iac.model.host import Host
from rarms_iac.model.plan import Plan
from rarms_iac.model.state import State
from rarms_iac.model.system import Disruption, System
from rarms_iac.views.console import render
from rarms_iac.views.plan import plan_text
from tests.builders import PathPlaces, a_component, a_host, a_system
from tests.builders_plan import facts

SMALL, LARGE = 1_000, 4_000
GOAL = 5.0
ROUNDS = 3


def system(components: int, hosts: int, weight: int) -> System:
    """So many components on so many hosts, with this weight."""
    each = components // hosts
    return a_system(
        application="fleet",
        hosts=[
            a_host(f"cell-{at:04}", logical_processors=max(8, each // 40), memory=f"{each} GiB", platform="cell")
            for at in range(hosts)
        ],
        components=[
            a_component(
                f"part-{at:04}",
                criticality=at % 97,
                memory=f"{64 + at % 4 * 64} MiB",
                processors=1,
                reserve=f"{(1 + at % 3) / 100} LP",
                weight=weight,
            )
            for at in range(components)
        ],
    )


def empty(host: Host) -> State:
    return State(facts=facts(host.name, logical_processors=host.logical_processors, ram=f"{host.memory >> 30} GiB"))


def applied(wanted_system: System) -> dict[str, State]:
    """The hosts as they are when all of it was applied."""
    nothing = {name: empty(host) for name, host in wanted_system.hosts.items()}
    requests = goals_of(wanted_system, nothing, PathPlaces(), Disruption.HOST_RESTART)
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
    requests = goals_of(heavier, observed, PathPlaces(), Disruption.HOST_RESTART)
    request = PlanningRequest(
        system=heavier,
        places=PathPlaces(),
        manifest="rarms.yaml",
        manifest_digest="0" * 64,
        today=date(2026, 1, 1),
    )
    made = prepare(request, observed)
    if made.plan is None:
        raise ValueError(f"no plan: {made.findings[:3]}")
    return Case(requests=requests.hosts, plan=made.plan)


def growth(name: str, hosts: Mapping[int, int]) -> Figure:
    small, large = (case(number, hosts[number]) for number in (SMALL, LARGE))
    times = interleaved({"small": small.difference_and_text, "large": large.difference_and_text}, rounds=ROUNDS)
    return Figure(name=name, value=median_ratio(times["large"], times["small"]), at_most=GOAL)


def figures() -> Iterator[Figure]:
    yield growth("difference and text, 4,000 to 1,000 components on one host", {SMALL: 1, LARGE: 1})
    yield growth("difference and text, 4,000 to 1,000 components, 50 a host", {SMALL: SMALL // 50, LARGE: LARGE // 50})


if __name__ == "__main__":
    sys.exit(report(list(figures())))
