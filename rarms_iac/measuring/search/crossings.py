"""Where the curve of an index probably crosses its threshold, read off the settings so far.

The level of a response is taken for a + b / CR, and b for the CPU time that a job consumed: so one setting foretells
the crossing of a component that needs a processor, and two that enclose it are interpolated.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, log, sqrt

from rarms_iac.measuring.search.trials import NOTHING_PASSED, Goal, Member, SearchTrial
from rarms_iac.model.measurement import Series
from rarms_iac.model.outcomes import Estimate
from rarms_iac.model.system import AtLeast, AtMost, Threshold
from rarms_iac.statistics.estimates import estimate
from rarms_iac.statistics.samples import response_times

_WORK_ALONE = 1.03  # a level up to so many times the work's is that of the work: CPU time is known about so well
_STEEPEST = 4.0  # times as steep as pure work; what falls steeper between two settings is a cliff


@dataclass(frozen=True, slots=True, kw_only=True)
class _Point:
    """One index of one member at one setting, as a level that falls as the CR rises."""

    reserve: int
    level: float  # ms, or ms a success
    doubt: float  # half of the band
    work: float | None  # what level times CR would be if a job only used one processor for its CPU time; None: unknown


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """Where one index of one member probably meets its threshold."""

    at: float  # CR
    smooth: bool  # no cliff: the curve between the fail and the pass may be read off them


def crossings_of(history: Sequence[SearchTrial], goal: Goal, failed: int, passed: int) -> Iterator[Crossing]:
    """Read off the crossings that lie between a failing setting (0: none) and a passing one (101: none).

    Args:
        history: the settings so far, with their verdicts.
        goal: every index of every member is asked on its own.
        failed: CR in per cent.
        passed: CR in per cent.

    Returns:
        One for each index of which the settings tell anything.
    """
    for member in goal.members:
        seen = {
            trial.reserve: series
            for trial in sorted(history, key=lambda trial: trial.reserve)
            for series in trial.setting.series
            if series.component == member.name and series.samples
        }
        for index, threshold in member.apt.items():
            seen_as, target = _level_wanted(seen, member, index, threshold)
            points = [point for reserve, series in seen.items() for point in _points(reserve, series, member, seen_as)]
            left = [point for point in points if point.reserve <= failed]
            right = [point for point in points if point.reserve >= passed]
            work = _work(points, goal.processors)
            if target is None or not points:
                continue
            crossing = (
                _between(left[-1], right[0], target, work)
                if left and right
                else _beyond(left[::-1] or right, target, work)
            )
            if crossing is not None and failed < crossing.at < min(passed + 1, NOTHING_PASSED):
                yield crossing


def _between(left: _Point, right: _Point, target: float, work: float | None) -> Crossing | None:
    """Interpolate: half-way between what a + b / CR gives and what a power of the CR gives; never below the work."""
    if not left.level > target >= right.level:
        return None
    smooth = left.level <= right.level * (1.0 + _STEEPEST * (right.reserve / left.reserve - 1.0))
    least = 0.0 if work is None else work / target
    if left.level * left.reserve <= _WORK_ALONE * (work or 0.0):
        return Crossing(at=least, smooth=smooth)
    part = (target - right.level) / (left.level - right.level)
    hyperbola = 1.0 / (part / left.reserve + (1.0 - part) / right.reserve)
    power = right.reserve * (left.reserve / right.reserve) ** (
        log(target / right.level) / log(left.level / right.level)
    )
    return Crossing(at=max((hyperbola + power) / 2, least / _WORK_ALONE), smooth=smooth)


def _beyond(points: Sequence[_Point], target: float, work: float | None) -> Crossing | None:
    """Extrapolate by a + b / CR from the points of one side, nearest first; b is the work until two points tell."""
    near, slope = points[0], work
    for other in points[1:2]:
        if abs(other.level - near.level) > other.doubt + near.doubt:
            slope = (other.level - near.level) / (1.0 / other.reserve - 1.0 / near.reserve)
        elif near.level <= target and work is not None:
            return Crossing(at=work / target, smooth=False)  # a floor: it ends where the work begins
        else:
            return None
    inverse = 1.0 / near.reserve + (target - near.level) / slope if slope else 0.0
    return Crossing(at=1.0 / inverse, smooth=False) if inverse > 0.0 else None


def _work(points: Sequence[_Point], processors: int) -> float | None:
    """The work on as few processors as all settings allow: no response has time for more."""
    known = [(point.work, point.level * point.reserve) for point in points if point.work is not None]
    counts = [n for n in range(1, processors + 1) if all(work / n <= _WORK_ALONE * room for work, room in known)]
    return sum(work for work, _ in known) / len(known) / counts[0] if known and counts else None


def _level_wanted(
    seen: Mapping[int, Series], member: Member, index: str, threshold: Threshold
) -> tuple[str, float | None]:
    """The index to look at and the level that it must fall to; None: nothing tells."""
    match index, threshold:
        case "success_rate", AtLeast(value=share):
            samples = [sample for series in seen.values() for sample in series.samples if sample.response_ms]
            slowest = max((sample.response_ms or 0.0 for sample in samples if sample.successful), default=0.0)
            quickest = min((sample.response_ms or inf for sample in samples if not sample.successful), default=inf)
            limit = sqrt(slowest * quickest) if slowest and quickest < inf else None
            return "mean_response_time", limit and limit / _multiple(seen, float(share) / 100)
        case "deadline_miss_rate", AtMost(value=share) if member.run.deadline is not None:
            return "mean_response_time", float(member.run.deadline) / _multiple(seen, 1.0 - float(share) / 100)
        case "throughput", AtLeast(value=limit) if limit > 0:
            return index, 1000.0 / float(limit)
        case _, AtMost(value=limit) if limit > 0:
            return index, float(limit)
    return index, None


def _multiple(seen: Mapping[int, Series], share: float) -> float:
    """The multiple of the mean within which this share of jobs answers: about the same at every setting."""
    scaled = [
        time * len(times) / sum(times)
        for series in seen.values()
        if (times := response_times(series.samples))
        for time in times
    ]
    return sorted(scaled)[round(share * (len(scaled) - 1))] if scaled else inf


def _points(reserve: int, series: Series, member: Member, index: str) -> Iterator[_Point]:
    """The setting as a point; none where it gives no estimate.

    Of response times only the time counts in which there is a job; a throughput has also what a periodic one waits.
    """
    seen = estimate(index, series, member.run)
    if not isinstance(seen, Estimate) or seen.value <= 0.0:
        return
    level = 1000.0 / seen.value if index == "throughput" else seen.value
    doubt = level * (min(seen.upper, 1.1 * seen.value) / seen.value - 1.0)
    busy_ms = 0.0 if index == "throughput" else sum(response_times(series.samples))
    used = 100 * series.cpu_ms / (busy_ms or series.elapsed_ms) if series.cpu_ms else None
    yield _Point(reserve=reserve, level=level, doubt=doubt, work=used and level * used)
