"""The route from a system and a state to ordered steps, in one call for tests: the product's own, with its parts."""

from dataclasses import dataclass, replace
from datetime import date

from rarms_iac.applying.desired_hosts import context_of, desired_hosts, partitions_present, rules_of
from rarms_iac.applying.plan_request import PlanRequest
from rarms_iac.diff.compare import compare
from rarms_iac.diff.disruption import hold_back
from rarms_iac.diff.order import order
from rarms_iac.diff.step_context import Difference, StepContext
from rarms_iac.diff.steps import plan_changes
from rarms_iac.model.changes import Change
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.layout import Infeasible, Layout
from rarms_iac.model.plan import HeldBack, Step
from rarms_iac.model.state import State
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner.desired import Desired
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.reservations import FixedReservations
from tests.builders import PathPlaces

PLACES = PathPlaces()


@dataclass(frozen=True, slots=True)
class Route:
    """Everything between manifest and steps, for one host."""

    desired: Desired
    context: StepContext
    difference: Difference
    allowed: tuple[Change, ...]
    held_back: tuple[HeldBack, ...]
    ordered: tuple[Step, ...] | Diagnostic

    @property
    def steps(self) -> tuple[Step, ...]:
        assert not isinstance(self.ordered, Diagnostic), self.ordered
        return self.ordered


def layout_of(system: System, *states: State) -> Layout | Infeasible:
    return plan_layout(system, FixedReservations(), {state.facts.name: state for state in states}, PLACES).answer


def route(system: System, observed: State, limit: Disruption = Disruption.REMOVAL, guest_build: int = 26100) -> Route:
    request = a_request(system, limit)
    hosts, findings = desired_hosts(request, {observed.facts.name: observed})
    assert hosts, findings
    desired = hosts[observed.facts.name]
    present = partitions_present(request, {observed.facts.name: observed})
    builds = {partition.id: guest_build for partition in observed.partitions}
    context = replace(context_of(request, desired, present), guest_builds=builds)
    difference = compare(desired.state, observed, system.application.name, context, rules_of(request, desired))
    allowed, held_back = hold_back(difference.changes, context)
    ordered = order(plan_changes(allowed, context), context)
    return Route(desired, context, difference, allowed, held_back, ordered)


def a_request(system: System, limit: Disruption | None = None, /, **asked: object) -> PlanRequest:
    request = PlanRequest(
        system=system,
        places=PLACES,
        manifest="rarms.yaml",
        manifest_digest="0" * 64,
        today=date(2026, 1, 1),
        max_disruption=limit,
    )
    return replace(request, **asked)  # type: ignore[arg-type]  # fields, said by tests
