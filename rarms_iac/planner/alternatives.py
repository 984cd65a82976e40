"""Alternatives to a placement: the hosts that a partition is not on, each with the reason."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

from rarms_iac.model.capacity import capacity_of, fits
from rarms_iac.model.host import Host
from rarms_iac.model.layout import Cause, Layout, PlacedPartition
from rarms_iac.model.quantities import show_processors
from rarms_iac.model.system import System
from rarms_iac.planner.groups import Group
from rarms_iac.planner.problem import HostView, by_name
from rarms_iac.planner.reservations import ReservationSource
from rarms_iac.planner.sizes import size


@dataclass(frozen=True, slots=True, kw_only=True)
class Elsewhere:
    """A host that a partition is not on, and why; the rest of the layout stays where it is."""

    host: str
    reserved: Fraction | None  # LPs that it would be guaranteed there; None: it cannot be there at all
    message: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenPlace:
    """Where a partition is in a layout, and what that was made from."""

    partition: PlacedPartition
    layout: Layout | None  # None: there is none, and this is where it would be
    views: Mapping[str, HostView]  # as the layout was made; a host that is not in it was not looked at
    stays: str = ""  # why it may be nowhere else, even where there is room

    def view(self, host: Host) -> HostView:
        """Return what was observed of a host.

        Args:
            host: a host of the manifest.

        Returns:
            The view; an empty one where the host was not looked at.
        """
        return self.views.get(host.name, HostView())


def elsewhere(
    group: Group, chosen: ChosenPlace, system: System, reservations: ReservationSource
) -> tuple[Elsewhere, ...]:
    """Work out for each other host of the manifest how the partition would be there.

    Args:
        group: the partition's members.
        chosen: where the layout has it.
        system: the manifest.
        reservations: where reservations come from.

    Returns:
        An answer for each host but the chosen one, by name.
    """
    others = [host for host in by_name(system.hosts) if host.name != chosen.partition.host]
    return tuple(_elsewhere(group, chosen, host, reservations) for host in others)


def _elsewhere(group: Group, chosen: ChosenPlace, host: Host, reservations: ReservationSource) -> Elsewhere:
    refused = next((member.name for member in group.members if not member.may_run_on(host.name)), "")
    if refused:
        return Elsewhere(host=host.name, reserved=None, message=f"{refused} may not run there (`hosts`)")
    answer = size(group, host, reservations)
    if isinstance(answer, Cause):
        return Elsewhere(host=host.name, reserved=None, message=answer.message)
    there = replace(answer, host=host.name, sharing=chosen.view(host).sharing(answer.name))
    layout = chosen.layout
    message = _without_layout(chosen, there) if layout is None else "; ".join(_compared(chosen, layout, there, host))
    return Elsewhere(host=host.name, reserved=there.reserved, message=message)


def _without_layout(chosen: ChosenPlace, there: PlacedPartition) -> str:
    why = chosen.stays or "there is no layout to compare with"
    return f"it would reserve {show_processors(there.reserved)}; {why}"


def _compared(chosen: ChosenPlace, layout: Layout, there: PlacedPartition, host: Host) -> Iterator[str]:
    here, view = chosen.partition, chosen.view(host)
    neighbours = [partition for partition in layout.partitions if partition.host == host.name]
    amount = show_processors(there.reserved)
    if there.reserved > here.reserved:
        yield f"it would reserve {amount} instead of {show_processors(here.reserved)}"
    elif there.reserved < here.reserved:
        yield f"it would reserve only {amount}"
    else:
        yield f"it would reserve {amount} there too"
    if fits(capacity_of(host, view.facts), (*view.claims, *(partition.claim for partition in (*neighbours, there)))):
        if chosen.stays:
            yield f"there is room, and {chosen.stays}"
        elif there.reserved == here.reserved:
            yield f"{here.host} is as good, and comes first: what is there stays, then names decide"
        elif there.reserved < here.reserved:
            yield f"there is room, so what is on {here.host} already stays there, or another needs the room more"
    else:
        names = [partition.name for partition in neighbours] + (["unmanaged machines"] if view.claims else [])
        yield f"it does not fit beside {', '.join(names)}" if names else "it does not fit"
