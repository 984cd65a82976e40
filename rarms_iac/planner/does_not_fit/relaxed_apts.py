"""Which APT by how much: thresholds that a lower reservation meets, read off the curves."""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import ceil, floor, isfinite

from rarms_iac.model.system import AtLeast, AtMost, Host, Measured, Threshold
from rarms_iac.planner.does_not_fit.variants import Apt
from rarms_iac.planner.groups import Group
from rarms_iac.planner.reservations import MeasuredReservations, MeasuredTogether, NotMeasured, ReservationSource

DIGITS = 1000
"""Thresholds are offered with three digits, as a person would write them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Slack:
    """A partition whose reservation rests on curves, with the CRs that they reach down to."""

    group: Group
    log: MeasuredTogether
    least: int  # the CR that its APTs ask for
    lowest: int  # below it nothing was measured

    def at(self, reserve: int) -> Mapping[Apt, Threshold] | None:
        """The thresholds that must change for this CR to do; None: no threshold would make it do."""
        found: dict[Apt, Threshold] = {}
        for one in self.group.members:
            for index, threshold in one.apt.items():
                reached = self.log.curves(one.name, index).safe_value_at(reserve)
                if reached is None or not isfinite(reached):
                    return None
                if not _meets(reached, threshold):
                    found[one.name, index] = _just_met(reached, threshold)
        return found


def slack_of(group: Group, host: Host, reservations: ReservationSource) -> Slack | None:
    """What the partition's curves leave; None: its reserve is fixed, or nothing lower was measured."""
    if not isinstance(reservations, MeasuredReservations) or group.wish.cpu.reserve not in (None, Measured.MEASURED):
        return None
    log, least = reservations.log(group.members, host), reservations.least(group.members, host)
    if isinstance(log, NotMeasured) or least is None:
        return None
    points = [log.curves(one.name, index).points for one in group.members for index in one.apt]
    if not all(points):
        return None
    lowest = max(ceil(each[0].reserve) for each in points)
    return Slack(group=group, log=log, least=least.reserve, lowest=lowest) if lowest < least.reserve else None


def _meets(value: float, threshold: Threshold) -> bool:
    match threshold:
        case AtMost(value=limit):
            return value <= float(limit)
        case AtLeast(value=limit):
            return value >= float(limit)


def _just_met(value: float, threshold: Threshold) -> Threshold:
    """The tightest threshold of three digits that the value meets."""
    step = Fraction(1, DIGITS)
    while abs(value) >= DIGITS * step:
        step *= 10
    match threshold:
        case AtMost():
            return AtMost(value=step * ceil(Fraction(value) / step))
        case AtLeast():
            return AtLeast(value=step * floor(Fraction(value) / step))
