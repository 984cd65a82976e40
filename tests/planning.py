"""The route from a system and a state to ordered steps, in one call for tests: the product's own, with its parts."""

from dataclasses import dataclass, replace

from rarms_iac.applying.goals import HostGoal, goals_of
from rarms_iac.diff.compare import Difference, compare
from rarms_iac.diff.hold_back import HeldChanges, hold_back
from rarms_iac.diff.order import Deadlock, OrderedSteps, order
from rarms_iac.diff.steps import plan_changes
from rarms_iac.model.layout import Infeasible, Layout
from rarms_iac.model.state import State
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.problem import host_view
from rarms_iac.planner.reservations import FixedReservations
from tests.builders import PathPlaces

PLACES = PathPlaces()


@dataclass(frozen=True, slots=True)
class Route:
    """Everything between manifest and steps, for one host."""

    request: HostGoal
    difference: Difference
    held: HeldChanges
    ordered: OrderedSteps | Deadlock


def layout_of(system: System, *states: State) -> Layout | Infeasible:
    views = {state.facts.name: host_view(state, system.application.name) for state in states}
    return plan_layout(system, FixedReservations(), views, PLACES).answer


def route(system: System, observed: State, limit: Disruption = Disruption.REMOVAL, guest_build: int = 26100) -> Route:
    host = observed.facts.name
    found = goals_of(system, {host: observed}, PLACES, limit)
    assert found.layout is not None, found.findings
    builds = {partition.id: guest_build for partition in observed.partitions}
    request = replace(found.hosts[host], context=replace(found.hosts[host].context, guest_builds=builds))
    difference = compare(request.desired, observed, system.application.name, request.context, request.rules)
    held = hold_back(difference.changes, request.budget)
    return Route(request, difference, held, order(plan_changes(held.allowed, request.context), request.budget))
