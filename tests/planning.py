"""The route from a system and a state to ordered steps, in one call for tests."""

from dataclasses import dataclass

from rarms_iac.diff.compare import Difference, Wishes, compare
from rarms_iac.diff.disruption import Surroundings
from rarms_iac.diff.holding import Held, hold_back
from rarms_iac.diff.order import Cycle, Ordered, Room, order, room_of
from rarms_iac.diff.steps import planned
from rarms_iac.model.capacity import capacity_of, foreign_claims
from rarms_iac.model.layout import Infeasible, Layout
from rarms_iac.model.state import State
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner.desired import Desired, desired_state
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.problem import host_view
from rarms_iac.planner.reservations import FixedReservations
from tests.builders import PathPlaces

PLACES = PathPlaces()


@dataclass(frozen=True, slots=True)
class Route:
    """Everything between manifest and steps, for one host."""

    desired: Desired
    difference: Difference
    held: Held
    room: Room
    ordered: Ordered | Cycle


def layout_of(system: System, *states: State) -> Layout | Infeasible:
    views = {one.facts.name: host_view(one, system.application.name) for one in states}
    return plan_layout(system, FixedReservations(), views, PLACES).answer


def route(system: System, observed: State, limit: Disruption = Disruption.REMOVAL, guest_build: int = 26100) -> Route:
    layout = layout_of(system, observed)
    assert isinstance(layout, Layout), layout
    application, host = system.application.name, system.hosts[observed.facts.name]
    desired = desired_state(system, layout, observed, PLACES)
    around = Surroundings(
        facts=observed.facts, guest_build=guest_build, making=desired.making, criticality=desired.criticality
    )
    wishes = Wishes(
        moved=system.moved,
        protected=desired.protected,
        replaceable=desired.replaceable,
        unused=desired.unused,
        where=lambda address: PLACES.key("partitions", address.partition),
    )
    difference = compare(desired.state, observed, application, around, wishes)
    room = room_of(
        observed,
        application,
        capacity_of(host, observed.facts),
        foreign_claims(observed, application),
        criticality=desired.criticality,
        max_disruption=limit,
    )
    held = hold_back(difference.changes, room)
    return Route(desired, difference, held, room, order(planned(held.kept, around), room))
