"""What can be lowered of a partition: a reserve that the manifest fixes, or the APTs, as far as its curves reach."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from math import ceil, floor, isfinite

from rarms_iac.model.quantities import CpuAmount, LogicalProcessors, Percent, ProcessorTime, ShareOfHost
from rarms_iac.model.system import AtLeast, AtMost, Measured, Threshold
from rarms_iac.planner.groups import Group
from rarms_iac.planner.infeasibility.edits import (
    Edit,
    Edits,
    Trial,
    component_reserves,
    partition_reserves,
    relaxed_apt,
)
from rarms_iac.planner.problem import Problem
from rarms_iac.planner.reservations import MeasuredReservations, MeasuredTogether, NotMeasured

READ_UP_TO = 8
"""Changes that are told together: nobody makes more of them from a list."""

DIGITS = 1000
"""Thresholds are offered with three digits, as a person would write them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lever:
    """Steps below what is now, the lowest first; the lower, the sooner everything fits."""

    levels: Sequence[int]
    at: Callable[[int], Edits]


def reserve_levers(group: Group) -> Iterator[Lever]:
    """The reserves that the manifest fixes for a partition: its own, or its members', the least critical first."""
    own = group.request.cpu.reserve
    if own is not None and not isinstance(own, Measured):
        yield _reserve_lever(own, partial(partition_reserves, group.name, own))
        return
    for component in reversed(group.members):
        reserve = component.cpu.reserve
        if reserve is not None and not isinstance(reserve, Measured):
            yield _reserve_lever(reserve, partial(component_reserves, component, reserve))


def _reserve_lever(before: CpuAmount, edit: Callable[[CpuAmount], Edit]) -> Lever:
    """In steps as the amount is written: whole per cent of the host, or hundredths of an LP."""
    if isinstance(before, ShareOfHost):
        return Lever(
            levels=range(1, ceil(before.percent)), at=lambda level: (edit(ShareOfHost(Percent(Fraction(level)))),)
        )

    def at(level: int) -> Edits:
        return (edit(ProcessorTime(LogicalProcessors(Fraction(level, 100)))),)

    return Lever(levels=range(1, ceil(100 * before.processors)), at=at)


def apt_levers(group: Group, problem: Problem) -> Iterator[Lever]:
    """The APTs of a partition together, down to the lowest CR that was measured; none where its reserve is fixed."""
    source, claims = problem.reservations, problem.claims[group.name]
    if (
        not claims
        or not isinstance(source, MeasuredReservations)
        or group.request.cpu.reserve not in (None, Measured.MEASURED)
    ):
        return
    host = problem.system.hosts[next(iter(claims))]
    log, least = source.log(group.members, host), source.least(group.members, host)
    if isinstance(log, NotMeasured) or least is None:
        return
    points = [log.curves(member.name, index).points for member in group.members for index in member.apt]
    if points and all(points):
        lowest = max(ceil(each[0].reserve) for each in points)
        yield Lever(
            levels=[reserve for reserve in range(lowest, least.reserve) if _met_at(reserve, group, log)],
            at=lambda reserve: _relaxed(_met_at(reserve, group, log) or {}, group),
        )


def _relaxed(thresholds: Mapping[tuple[str, str], Threshold], group: Group) -> Edits:
    members = {member.name: member for member in group.members}
    return tuple(relaxed_apt(members[name], index, threshold) for (name, index), threshold in thresholds.items())


def _met_at(reserve: int, group: Group, log: MeasuredTogether) -> Mapping[tuple[str, str], Threshold] | None:
    """The thresholds, by component and index, that must change for this CR to do; None: none would make it do."""
    found: dict[tuple[str, str], Threshold] = {}
    for member in group.members:
        for index, threshold in member.apt.items():
            reached = log.curves(member.name, index).safe_value_at(reserve)
            if reached is None or not isfinite(reached):
                return None
            if not _meets(reached, threshold):
                found[member.name, index] = _just_met(reached, threshold)
    return found


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


def lowered(lever: Lever, trial: Trial) -> Edits | None:
    """Lower it by as little as helps; None: nothing that it can be lowered by is enough."""
    number = largest(len(lever.levels), lambda at: trial.fits(lever.at(lever.levels[at])))
    return None if number is None else lever.at(lever.levels[number])


def several_lowered(levers: Sequence[Lever], trial: Trial) -> Edits | None:
    """Lower several together, none without need, and each by as little as helps.

    Args:
        levers: What can be lowered; the first are lowered first.
        trial: Where to plan it.

    Returns:
        The changes; None: all of them are not enough, or more are needed than are read.
    """
    levers = [lever for lever in levers if lever.levels]
    chosen = [lever.at(lever.levels[0]) for lever in levers]
    spared = largest(len(levers), lambda fewer: trial.fits(_flat(chosen[: len(levers) - fewer])))
    if spared is None:
        return None
    del chosen[len(levers) - spared :]
    for at in reversed(range(len(chosen))):
        rest = trial.after(_flat(chosen[:at] + chosen[at + 1 :]))
        chosen[at] = () if rest.fits(()) else lowered(levers[at], rest) or chosen[at]
    edits = _flat(chosen)
    return edits if 0 < len(edits) <= READ_UP_TO else None


def _flat(chosen: Sequence[Edits]) -> Edits:
    return tuple(edit for edits in chosen for edit in edits)


def largest(number: int, works: Callable[[int], bool]) -> int | None:
    """The largest of 0, 1, ... below `number` that works, where every smaller one does too; None: 0 does not."""
    if not number or not works(0):
        return None
    low, high = 0, number - 1
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if works(middle) else (low, middle - 1)
    return low
