"""With whom `rarms explain COMPONENT` says that a component could share a partition, as predicted and not measured."""

from collections.abc import Callable, Sequence
from fractions import Fraction

from rarms_iac.model.quantities import show_processors
from rarms_iac.model.system import Host
from rarms_iac.planner.assigning.values import cost
from rarms_iac.planner.groups import Group, may_share
from rarms_iac.planner.prediction.members import Predictor, alone_in, expected_of, predictor_of
from rarms_iac.planner.reservations import MeasuredReservations, Names, names_of
from rarms_iac.planner.sizes import Sized, size

TOLD = 3


def partners(
    group: Group,
    groups: Sequence[Group],
    host: Host,
    reservations: MeasuredReservations,
    was_measured: Callable[[Names], bool],
) -> tuple[str, ...]:
    """The pairs that would save most, if what their members do alone is a guide; the most first.

    Only pairs of which nothing was measured: of others the data log says more.
    """
    others = [one for one in groups if one.name != group.name and may_share(group, one)]
    others = [other for other in others if not was_measured(names_of((*group.members, *other.members)))]
    predictor = predictor_of(alone_in(groups, reservations, host))
    found = [_told(group, other, host, reservations, predictor) for other in others]
    return tuple(says for _, says in sorted(one for one in found if one is not None)[:TOLD])


def _told(
    group: Group, other: Group, host: Host, reservations: MeasuredReservations, predictor: Predictor
) -> tuple[int, str] | None:
    """With what it saves, below 0, in per cent of one logical processor; None: nothing, or nothing says so."""
    sizes = [size(one, host, reservations) for one in (group, other)]
    claims = [size.claim for size in sizes if isinstance(size, Sized)]
    if len(claims) < len(sizes):
        return None
    costs, processors = [cost(claim) for claim in claims], max(claim.processors for claim in claims)
    together = expected_of(predictor, names_of((*group.members, *other.members)), processors, costs)
    if together is None or together * processors >= sum(costs):
        return None
    apart, now = (show_processors(Fraction(one, 100)) for one in (sum(costs), together * processors))
    says = f"sharing with {other.name}: predicted {now} instead of {apart} apart; `rarms tune` measures it"
    return together * processors - sum(costs), says
