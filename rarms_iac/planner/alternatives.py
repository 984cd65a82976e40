"""What else could have been: the hosts that a partition is not on, each with the reason."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction

from rarms_iac.model.capacity import capacity_of, fits
from rarms_iac.model.layout import Cause, Layout, PlacedPartition
from rarms_iac.model.plan import Claim
from rarms_iac.model.quantities import show_processors
from rarms_iac.model.system import Host, System
from rarms_iac.planner.groups import Group
from rarms_iac.planner.problem import by_name
from rarms_iac.planner.reservations import ReservationSource
from rarms_iac.planner.sizes import size


@dataclass(frozen=True, slots=True, kw_only=True)
class Elsewhere:
    """A host that a partition is not on, and why; the rest of the layout stays where it is."""

    host: str
    reserved: Fraction | None  # LPs that it would be guaranteed there; None: it cannot be there at all
    says: str


def elsewhere(
    group: Group, placed: PlacedPartition, layout: Layout, system: System, reservations: ReservationSource
) -> tuple[Elsewhere, ...]:
    """Every other host of the manifest, by name. What the layout says of hosts is taken from the manifest alone."""
    others = [host for host in by_name(system.hosts) if host.name != placed.host]
    return tuple(_elsewhere(group, placed, host, layout, reservations) for host in others)


def _elsewhere(
    group: Group, placed: PlacedPartition, host: Host, layout: Layout, reservations: ReservationSource
) -> Elsewhere:
    refused = next((one.name for one in group.members if one.hosts is not None and host.name not in one.hosts), "")
    if refused:
        return Elsewhere(host=host.name, reserved=None, says=f"{refused} may not run there (`hosts`)")
    answer = size(group, host, reservations)
    if isinstance(answer, Cause):
        return Elsewhere(host=host.name, reserved=None, says=answer.says.rstrip("."))
    there = replace(answer.placed, host=host.name)
    says = "; ".join(_compared(placed, there, host, layout))
    return Elsewhere(host=host.name, reserved=there.reserved, says=says)


def _compared(placed: PlacedPartition, there: PlacedPartition, host: Host, layout: Layout) -> Iterator[str]:
    beside = [one for one in layout.partitions if one.host == host.name]
    amount = show_processors(there.reserved)
    if there.reserved > placed.reserved:
        yield f"it would reserve {amount} instead of {show_processors(placed.reserved)}"
    elif there.reserved < placed.reserved:
        yield f"it would reserve only {amount}"
    else:
        yield f"it would reserve {amount} there too"
    if fits(capacity_of(host, None), claims_of([*beside, there])):
        if there.reserved == placed.reserved:
            yield f"{placed.host} is as good, and comes first: what is there stays, then names decide"
        elif there.reserved < placed.reserved:
            yield f"there is room, so what is on {placed.host} already stays there, or another needs the room more"
    else:
        names = ", ".join(one.name for one in beside)
        yield f"it does not fit beside {names}" if names else "it does not fit"


def claims_of(partitions: Iterable[PlacedPartition]) -> tuple[Claim, ...]:
    """What these partitions are promised."""
    return tuple(Claim(processors=one.processors, reserve=one.reserve, memory=one.memory) for one in partitions)
