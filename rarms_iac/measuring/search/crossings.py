"""Where the curve of each index probably crosses its threshold, and how well a setting knows that.

A response time is taken for a + b / CR, and b (the work, in ms times per cent) for the CPU time that a job consumed. So
one setting foretells the crossing of a component that needs a processor, and two that enclose it are interpolated. A
setting passes by its bound, so the threshold is taken for a time whose bound at a setting's end still meets it.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from math import floor, inf, log, sqrt
from statistics import NormalDist, fmean

from rarms_iac.measuring.search.trials import NOTHING_PASSED, Goal, Member, SearchTrial, done_share, judge_settings
from rarms_iac.model.outcomes import Estimate, NoEstimate, Sufficient
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.series import Series
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import AtLeast, AtMost, Threshold
from rarms_iac.statistics.distributions import FIRST_LOOK, LOOK_ERROR
from rarms_iac.statistics.estimates import estimate
from rarms_iac.statistics.samples import effective_samples, response_times, successes

_WORK_ALONE = 1.03  # a time up to so many times the work's is that of the work: CPU time is known about so well
_STEEPEST = 4.0  # times as steep as pure work; what falls steeper between two settings is a cliff
_DEVIATIONS = -NormalDist().inv_cdf(LOOK_ERROR)  # from a share to its bound
_MOST_ROOM = 0.5  # a bound further away than this part of the time is none


@dataclass(frozen=True, slots=True, kw_only=True)
class _Point:
    """One index of one member at one setting, as a time that falls as the CR rises."""

    reserve: ReservePercent
    time_ms: float  # of throughput: the time to a success
    half_band_ms: float  # from the estimate to the end of its band
    work: float | None  # ms times per cent: `time_ms * reserve` of jobs that only compute on one processor; or unknown


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """The reservation at which one index of one member probably meets its threshold."""

    at: float  # CR, of the bound at the end of a setting there
    likely: float  # CR, of the value itself
    smooth: bool  # no cliff: the curve between the fail and the pass may be read off them


def crossings_of(
    history: Sequence[SearchTrial], goal: Goal, failed: int, passed: int, *, of_bound: bool = True
) -> Iterator[Crossing]:
    """Read off the crossings that lie between a failing setting (0: none) and a passing one (101: none).

    Args:
        history: the settings so far, with their verdicts.
        goal: every index of every member is asked on its own.
        of_bound: Whether the bound at the end of a setting is to meet the threshold. False: the estimate, as in the
            first pass.

    Returns:
        One for each index of which the settings tell anything.
    """
    for member in goal.members:
        measured = {
            trial.reserve: series
            for trial in sorted(history, key=lambda trial: trial.reserve)
            for series in trial.setting.series
            if series.component == member.name and series.samples
        }
        for index, threshold in member.apt.items():
            read_as, target = _time_wanted(measured, goal, member, index, threshold, of_bound=of_bound)
            found = (_point(reserve, series, member, read_as) for reserve, series in measured.items())
            points = [point for point in found if point is not None]
            failing = [point for point in points if point.reserve <= failed]
            passing = [point for point in points if point.reserve >= passed]
            work = _work(points, goal.processors)
            if target is None or not points:
                continue
            crossing = _crossing(failing, passing, target, work)
            if crossing is not None and failed < crossing.at < min(passed + 1, NOTHING_PASSED):
                _, middle = _time_wanted(measured, goal, member, index, threshold, of_bound=False)
                likely = None if middle is None else _crossing(failing, passing, middle, work)
                yield replace(crossing, likely=min(crossing.at, likely.at)) if likely else crossing


def _crossing(
    failing: Sequence[_Point], passing: Sequence[_Point], target: float, work: float | None
) -> Crossing | None:
    if failing and passing:
        return _between(failing[-1], passing[0], target, work)
    return _beyond(failing[::-1] or passing, target, work)


def _between(failing: _Point, passing: _Point, target: float, work: float | None) -> Crossing | None:
    """Interpolate: half-way between what a + b / CR gives and what a power of the CR gives; never below the work."""
    if not failing.time_ms > target >= passing.time_ms:
        return None
    smooth = failing.time_ms <= passing.time_ms * (1.0 + _STEEPEST * (passing.reserve / failing.reserve - 1.0))
    least = 0.0 if work is None else work / target
    if failing.time_ms * failing.reserve <= _WORK_ALONE * (work or 0.0):
        return _crossing_at(least, smooth=smooth)
    part = (target - passing.time_ms) / (failing.time_ms - passing.time_ms)
    hyperbola = 1.0 / (part / failing.reserve + (1.0 - part) / passing.reserve)
    power = passing.reserve * (failing.reserve / passing.reserve) ** (
        log(target / passing.time_ms) / log(failing.time_ms / passing.time_ms)
    )
    return _crossing_at(max((hyperbola + power) / 2, least / _WORK_ALONE), smooth=smooth)


def _crossing_at(at: float, *, smooth: bool) -> Crossing:
    return Crossing(at=at, likely=at, smooth=smooth)


def _beyond(points: Sequence[_Point], target: float, work: float | None) -> Crossing | None:
    """Extrapolate by a + b / CR from the points of one side, nearest first; b is the work until two points tell."""
    near, slope = points[0], work
    for other in points[1:2]:
        if abs(other.time_ms - near.time_ms) > other.half_band_ms + near.half_band_ms:
            slope = (other.time_ms - near.time_ms) / (1.0 / other.reserve - 1.0 / near.reserve)
        elif near.time_ms <= target and work is not None:
            return _crossing_at(work / target, smooth=False)  # a floor: it ends where the work begins
        else:
            return None
    inverse = 1.0 / near.reserve + (target - near.time_ms) / slope if slope else 0.0
    return _crossing_at(1.0 / inverse, smooth=False) if inverse > 0.0 else None


def _work(points: Sequence[_Point], processors: int) -> float | None:
    """Return the work on as few processors as all settings allow: no response has time for more.

    Where none allows it, the component got more than it reserves, which a host may give it: its jobs only compute.
    """
    known = [(point.work, point.time_ms * point.reserve) for point in points if point.work is not None]
    if not known:
        return None
    counts = [n for n in range(1, processors + 1) if all(work / n <= _WORK_ALONE * room for work, room in known)]
    return fmean(work / counts[0] if counts else room for work, room in known)


def _time_wanted(
    measured: Mapping[int, Series], goal: Goal, member: Member, index: str, threshold: Threshold, *, of_bound: bool
) -> tuple[str, float | None]:
    """Return the index to look at and the time (ms) that it must fall to; None: unknown.

    Args:
        of_bound: Whether the bound at the end of a setting is to meet the threshold, not the value alone.
    """
    room = _room(measured, goal, member, index) if of_bound else 0.0
    match index, threshold:
        case "success_rate", AtLeast(value=share):
            limit = _success_limit(measured.values())
            return "mean_response_time", limit and limit / _multiple(
                measured, goal, member, float(share) / 100, of_bound=of_bound
            )
        case "deadline_miss_rate", AtMost(value=share) if member.run.deadline is not None:
            return "mean_response_time", float(member.run.deadline) / _multiple(
                measured, goal, member, 1.0 - float(share) / 100, of_bound=of_bound
            )
        case "throughput", AtLeast(value=limit) if limit > 0:
            return index, 1000.0 / float(limit) / (1.0 + room)
        case _, AtMost(value=limit) if limit > 0:
            return index, float(limit) / (1.0 + room)
    return index, None


def _room(measured: Mapping[int, Series], goal: Goal, member: Member, index: str) -> float:
    """Return a time's bound, as a part beyond it, at the end of a setting: it shrinks as the root of the samples."""
    rooms = []
    for reserve, series in measured.items():
        estimated = estimate(index, series, member.run)
        if isinstance(estimated, Estimate) and estimated.lower > 0.0:
            ratio = estimated.value / estimated.lower if index == "throughput" else estimated.upper / estimated.value
            rooms.append((ratio - 1.0) * sqrt(done_share(series, reserve, member.run, series.elapsed_ms, goal)))
    return min((room for room in rooms if room < _MOST_ROOM), default=0.0)


def _multiple(measured: Mapping[int, Series], goal: Goal, member: Member, share: float, *, of_bound: bool) -> float:
    """Return the multiple of the mean within which this share of jobs answers; of a bound, the share that shows it.

    It is the same at every setting.
    """
    worth = max(
        effective_samples(successes(series.samples)) / done_share(series, reserve, member.run, series.elapsed_ms, goal)
        for reserve, series in measured.items()
    )
    shows = min(1.0, share + _DEVIATIONS * sqrt(share * (1.0 - share) / worth)) if of_bound else share
    scaled = [
        time * len(times) / together
        for series in measured.values()
        if (together := sum(times := response_times(series.samples)))
        for time in times
    ]
    return sorted(scaled)[round(shows * (len(scaled) - 1))] if scaled else inf


def _point(reserve: ReservePercent, series: Series, member: Member, index: str) -> _Point | None:
    """Return the setting as a point; None where it gives no estimate.

    Of response times only the time counts in which there is a job; a throughput has also what a periodic one waits.
    """
    estimated = estimate(index, series, member.run)
    if not isinstance(estimated, Estimate) or estimated.value <= 0.0:
        return None
    time_ms = 1000.0 / estimated.value if index == "throughput" else estimated.value
    half_band_ms = time_ms * (min(estimated.upper, 1.1 * estimated.value) / estimated.value - 1.0)
    busy_ms = 0.0 if index == "throughput" else sum(response_times(series.samples))
    cpu_share = 100 * series.cpu_ms / (busy_ms or series.elapsed_ms) if series.cpu_ms else None
    return _Point(reserve=reserve, time_ms=time_ms, half_band_ms=half_band_ms, work=cpu_share and time_ms * cpu_share)


_LIKELY = 0.025  # the error of a bound by which a crossing is called known: it ends a setting, and is not a verdict
_APART = 1.03  # times the CR: settings closer than that say little about the slope between them
_FAR = 1.5  # times the CR: what lies between settings farther than that may be flat in part


@dataclass(frozen=True, slots=True, kw_only=True)
class AnswerRange:
    """Between which CRs, not whole ones, the least sufficient one probably lies."""

    low: float
    high: float


_RECORDED = 1.25
"""So many times as wide a range is known well enough in a setting that was ended: those before it may have gone on."""


def is_known(setting: Setting, before: Sequence[Setting], goal: Goal, *, is_recorded: bool = False) -> bool:
    """Tell whether a setting shows where the answer lies as well as the goal asks for, and will hardly pass itself.

    More samples would only tell whether it is a little too low or a little too high, at the price of thousands: a
    setting a little above passes with few.

    Args:
        setting: all of its reservation so far.
        before: those at other reservations that were begun before it; they say how steep the curve is.
        goal: says the precision; 0: nothing is ever known well enough.
        is_recorded: Whether it has ended, so that it is asked whether it may stay so.
    """
    if not goal.precision or any(len(series.samples) < FIRST_LOOK for series in setting.series):
        return False
    found = range_of(setting, before, goal)
    if found is None:
        return False
    wide = max(1.0, goal.precision * setting.reserve) * (_RECORDED if is_recorded else 1.0)
    return setting.reserve <= found.high < setting.reserve + wide and found.high - found.low <= wide


def begun_before(reserve: ReservePercent, settings: Sequence[Setting]) -> tuple[Setting, ...]:
    """Return the settings that were begun before the one at a reservation, or all where it has yet to begin.

    Args:
        settings: one a reservation, in the order in which they were first measured.
    """
    return tuple(takewhile(lambda setting: setting.reserve != reserve, settings))


def range_of(setting: Setting, others: Sequence[Setting], goal: Goal) -> AnswerRange | None:
    """Return between which CRs the answer lies, by the samples of one setting; None: an index of it does not tell."""
    lows, highs = [0.0], [0.0]
    for member in goal.members:
        measured = {
            each.reserve: series
            for each in sorted((*others, setting), key=lambda each: each.reserve)
            for series in each.series
            if series.component == member.name and series.samples
        }
        for index, threshold in member.apt.items():
            found = _range_of_index(setting.reserve, measured, goal, member, (index, threshold))
            if found is None:
                return None
            lows.append(found.low)
            highs.append(found.high)
    return AnswerRange(low=max(lows), high=max(highs))


def down_to(settings: Sequence[Setting], answer: Sufficient, goal: Goal) -> ReservePercent | None:
    """Return the least CR that may be enough where a setting ended before it showed that as closely as it should.

    Args:
        settings: all that counts, one a reservation.
        answer: the least CR that they show to be enough, and the highest lower one that they do not.

    Returns:
        None: the next lower setting misses, shows where the answer lies, or leaves no more than the precision.
    """
    trials = judge_settings(settings, goal).trials
    below = next((trial for trial in trials if trial.reserve == answer.failed), None)
    if below is None or below.missed:
        return None
    before = begun_before(below.reserve, settings)
    found = range_of(below.setting, before, goal)
    if found is None or is_known(below.setting, before, goal, is_recorded=True):
        return None
    least = max(floor(min(found.low, answer.reserve)), *(trial.reserve for trial in trials if trial.missed), 0) + 1
    return least if answer.reserve - least > max(1.0, goal.precision * answer.reserve) else None


def _range_of_index(
    reserve: ReservePercent, measured: Mapping[int, Series], goal: Goal, member: Member, wanted: tuple[str, Threshold]
) -> AnswerRange | None:
    read_as, target = _time_as_percentile(measured, member, *wanted)
    own = measured.get(reserve)
    if own is None or target is None:
        return None
    seen = estimate(read_as, own, member.run, error=_LIKELY, unseen=False)
    if isinstance(seen, NoEstimate) or seen.beyond is not None or not 0.0 < seen.lower <= seen.upper < inf:
        return None
    found = (_point(at, series, member, read_as) for at, series in measured.items())
    points = [point for point in found if point is not None]
    slope = _slope_at(reserve, points, _work(points, goal.processors))
    if not slope:
        return None
    lower, upper = seen.lower, seen.upper
    if read_as == "throughput":
        lower, upper = 1000.0 / upper, 1000.0 / lower
    low, high = (1.0 / reserve + (target - time) / slope for time in (lower, upper))
    return AnswerRange(low=1.0 / low if low > 0.0 else inf, high=1.0 / high if high > 0.0 else inf)


def _slope_at(reserve: ReservePercent, points: Sequence[_Point], work: float | None) -> float | None:
    """Return b of a + b / CR at a setting, rather too small than too great; None: unknown.

    It is read off the nearest other setting that is far enough, and is at most the work where that is far away or
    takes hardly another time.
    """
    here = next((point for point in points if point.reserve == reserve), None)
    others = [
        point
        for point in points
        if max(point.reserve, reserve) >= _APART * min(point.reserve, reserve) and point.reserve != reserve
    ]
    if here is None:
        return None
    if not others:
        return work
    near = min(others, key=lambda point: abs(log(point.reserve / reserve)))
    between = abs(1.0 / near.reserve - 1.0 / reserve)
    falls = (near.time_ms - here.time_ms) * (1.0 if near.reserve < reserve else -1.0)
    bands = near.half_band_ms + here.half_band_ms
    if falls > bands and max(near.reserve, reserve) <= _FAR * min(near.reserve, reserve):
        return falls / between
    seen = (falls if falls > bands else max(0.0, falls) + bands) / between
    return seen if work is None else min(seen, work)


def _time_as_percentile(
    measured: Mapping[int, Series], member: Member, index: str, threshold: Threshold
) -> tuple[str, float | None]:
    """Return the index of time to look at, and the time that it must fall to: of a share of jobs the percentile."""
    match index, threshold:
        case "success_rate", AtLeast(value=share) if 0 < share < 100:
            return _percentile_index(float(share)), _success_limit(measured.values())
        case "deadline_miss_rate", AtMost(value=share) if 0 < share < 100 and member.run.deadline is not None:
            return _percentile_index(100 - float(share)), float(member.run.deadline)
        case "throughput", AtLeast(value=limit) if limit > 0:
            return index, 1000.0 / float(limit)
        case _, AtMost(value=limit) if limit > 0:
            return index, float(limit)
    return index, None


def _percentile_index(per_cent: float) -> str:
    return f"p{round(min(99.9, max(0.1, per_cent)), 1):g}_response_time"


def _success_limit(measured: Iterable[Series]) -> float | None:
    """Return the time within which jobs succeed: between the slowest success and the quickest failure."""
    samples = [sample for series in measured for sample in series.samples if sample.response_ms]
    slowest = max((sample.response_ms or 0.0 for sample in samples if sample.successful), default=0.0)
    quickest = min((sample.response_ms or inf for sample in samples if not sample.successful), default=inf)
    return sqrt(slowest * quickest) if slowest and quickest < inf else None
