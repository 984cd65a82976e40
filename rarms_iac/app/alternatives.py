"""Alternatives to the place of a partition: the hosts that it is not on, each with the reason."""

from dataclasses import dataclass, replace
from fractions import Fraction

from rarms_iac.app.explained_partition import ExplainedPartition
from rarms_iac.model.capacity import capacity_of, fits
from rarms_iac.model.host import Host
from rarms_iac.model.layout import Cause, PlacedPartition
from rarms_iac.model.quantities import show_processors
from rarms_iac.planner.problem import HostView, by_name
from rarms_iac.planner.sizes import size


@dataclass(frozen=True, slots=True, kw_only=True)
class Elsewhere:
    """A host that a partition is not on, and why; the rest of the layout stays where it is."""

    host: str
    reserved: Fraction | None  # LPs that it would be guaranteed there; None: it cannot be there at all
    message: str


def elsewhere(partition: ExplainedPartition, here: PlacedPartition) -> tuple[Elsewhere, ...]:
    """Work out for each other host of the manifest, by name, how a partition would be there.

    Args:
        here: what it gets where it is, or would be.
    """
    others = [host for host in by_name(partition.system.hosts) if host.name != here.host]
    return tuple(_elsewhere(partition, here, host) for host in others)


def _elsewhere(partition: ExplainedPartition, here: PlacedPartition, host: Host) -> Elsewhere:
    group, layout = partition.group, partition.layout
    refused = next((member.name for member in group.members if not member.may_run_on(host.name)), "")
    if refused:
        return Elsewhere(host=host.name, reserved=None, message=f"{refused} may not run there (`hosts`)")
    answer = size(group, host, partition.reservations)
    if isinstance(answer, Cause):
        return Elsewhere(host=host.name, reserved=None, message=answer.message)
    view = partition.views.get(host.name, HostView())
    there = replace(answer, host=host.name, sharing=view.sharing(answer.name))
    if layout is None:
        why = partition.why_bound or "there is no layout to compare with"
        message = f"it would reserve {show_processors(there.reserved)}; {why}"
    else:
        neighbours = layout.on(host.name)
        claims = (*view.claims, *(other.claim for other in (*neighbours, there)))
        if fits(capacity_of(host, view.facts), claims):
            why = _why_not_there(here, there, partition.why_bound)
        else:
            names = [other.name for other in neighbours] + (["unmanaged machines"] if view.claims else [])
            why = f"it does not fit beside {', '.join(names)}" if names else "it does not fit"
        message = "; ".join(filter(None, [_compared(here, there), why]))
    return Elsewhere(host=host.name, reserved=there.reserved, message=message)


def _compared(here: PlacedPartition, there: PlacedPartition) -> str:
    amount = show_processors(there.reserved)
    if there.reserved == here.reserved:
        return f"it would reserve {amount} there too"
    if there.reserved < here.reserved:
        return f"it would reserve only {amount}"
    return f"it would reserve {amount} instead of {show_processors(here.reserved)}"


def _why_not_there(here: PlacedPartition, there: PlacedPartition, bound: str) -> str:
    """Why it is not on a host that has room for it; empty where it reserves more there."""
    if bound:
        return f"there is room, and {bound}"
    if there.reserved == here.reserved:
        return f"{here.host} is as good, and comes first: what is there stays, then names decide"
    if there.reserved < here.reserved:
        return f"there is room, so what is on {here.host} already stays there, or another needs the room more"
    return ""
