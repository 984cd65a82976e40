"""Which APT by how much: thresholds that a lower reservation meets, read off the curves and tried by planning."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil, floor, isfinite

from rarms_iac.model.indexes import find_index
from rarms_iac.model.system import AtLeast, AtMost, Component, Host, Measured, System, Threshold
from rarms_iac.model.thresholds import show_threshold, show_value
from rarms_iac.planner.groups import Group
from rarms_iac.planner.reservations import MeasuredReservations, MeasuredTogether, NotMeasured, ReservationSource

Fits = Callable[[System], bool]
"""Whether everything fits with this manifest; the smaller a reservation, the sooner it does."""

Apt = tuple[str, str]
"""Component and index."""

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


def one_relaxed(slacks: Iterable[Slack], system: System, fits: Fits) -> Iterator[str]:
    """The APTs of one partition, relaxed as little as helps; of the least critical first."""
    for slack in slacks:
        chosen = _highest(slack, system, fits)
        changes = {} if chosen is None else slack.at(chosen) or {}
        if changes:
            yield _told(system, changes)


def several_relaxed(slacks: Iterable[Slack], system: System, fits: Fits) -> str | None:
    """The APTs of several partitions together, the least critical first; None: all that was measured is not enough.

    They are then tightened again as far as it fits, the most critical first.
    """
    chosen: list[tuple[Slack, int]] = []
    relaxed = system
    for slack in slacks:
        lowest = _lowest(slack)
        if lowest is None:
            continue
        chosen.append((slack, lowest))
        relaxed = with_thresholds(relaxed, slack.at(lowest) or {})
        if fits(relaxed):
            return _told(system, _tightened(chosen, system, fits))
    return None


def _tightened(chosen: list[tuple[Slack, int]], system: System, fits: Fits) -> Mapping[Apt, Threshold]:
    for at in reversed(range(len(chosen))):
        slack, _ = chosen[at]
        others: dict[Apt, Threshold] = {}
        for number, (other, reserve) in enumerate(chosen):
            if number != at:
                others.update(other.at(reserve) or {})
        best = slack.least if fits(with_thresholds(system, others)) else None
        best = best or _highest(slack, with_thresholds(system, others), fits)
        if best is not None:
            chosen[at] = (slack, best)
    changes: dict[Apt, Threshold] = {}
    for slack, reserve in chosen:
        changes.update(slack.at(reserve) or {})
    return changes


def _lowest(slack: Slack) -> int | None:
    """The lowest CR that some thresholds would make do."""
    return next((one for one in range(slack.lowest, slack.least) if slack.at(one)), None)


def _highest(slack: Slack, system: System, fits: Fits) -> int | None:
    """The highest CR below the present one with whose thresholds it fits."""
    low, high = _lowest(slack), slack.least - 1

    def works(reserve: int) -> bool:
        changes = slack.at(reserve)
        return changes is not None and fits(with_thresholds(system, changes))

    if low is None or not works(low):
        return None
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if works(middle) else (low, middle - 1)
    return low


def with_thresholds(system: System, changes: Mapping[Apt, Threshold]) -> System:
    """The manifest with these thresholds."""
    changed: dict[str, Component] = dict(system.components)
    for (name, index), threshold in changes.items():
        changed[name] = replace(changed[name], apt={**changed[name].apt, index: threshold})
    return replace(system, components=changed)


def _told(system: System, changes: Mapping[Apt, Threshold]) -> str:
    """`vision: mean_response_time at most 131 ms instead of 100 ms`, in the manifest's words; of several a list."""
    told = []
    for (name, index), threshold in changes.items():
        found = find_index(index)
        assert found is not None, "an APT names indexes that there are"
        before = show_value(found, system.components[name].apt[index].value)
        told.append(f"{name}: {index} {show_threshold(found, threshold)} instead of {before}")
    return told[0] if len(told) == 1 else "\n  - ".join(["all of these APTs:", *told])


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
