"""CoIs as they were measured: what partitions reserve now, and what their data logs show that they need at least."""

from dataclasses import replace

from rarms_iac.model.plan import Claim
from rarms_iac.model.system import Host
from rarms_iac.planner.combining.oracle import Coi
from rarms_iac.planner.groups import Group
from rarms_iac.planner.reservations import MeasuredReservations, MeasuredTogether, ReservationSource, names_of
from rarms_iac.statistics.curves import highest_missed


def coi_as_measured(group: Group, claim: Claim, reservations: ReservationSource, host: Host) -> Coi:
    """What a partition holds, with the highest CR at which its data log for this host shows that it misses an APT.

    Where it reserves more than the log asks for, because the manifest fixes that, nothing less is thought of.
    """
    coi = Coi(
        name=group.name,
        members=names_of(group.members),
        criticality=group.criticality,
        processors=claim.processors,
        reserve=claim.reserve,
    )
    if not isinstance(reservations, MeasuredReservations):
        return coi
    log, least = reservations.log(group.members, host), reservations.least(group.members, host)
    if not isinstance(log, MeasuredTogether) or least is None:
        return coi
    if (log.processors, least.reserve) != (claim.processors, claim.reserve):
        return coi
    apts = [
        (log.curves(member.name, index), threshold)
        for member in group.members
        for index, threshold in member.apt.items()
    ]
    return replace(coi, missed=highest_missed(apts))
