"""The strategies: bisection, the paper's walk, and the default, bisection guided by where the curve probably crosses.

Bisection and the walk assume only that more processor time is never worse. The default interpolates, truncates,
projects (ITP; Oliveira and Takahashi, 2020): a crossing is read off the settings so far, moved a little towards the
middle, and kept where halving could still end in time. So no falling curve takes more than `MOST` settings whose
verdicts are true; where noise turns one, or there is no steady state, halving goes on, and the loop ends it.

Of a crossing: a response time is taken for a + b / CR, and b (the work, in ms times per cent) for the CPU time that a
job consumed. So one setting foretells the crossing of a component that needs a processor, and two that enclose it are
interpolated. A setting passes by its bound, so the threshold is taken for a time whose bound at a setting's end still
meets it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor, inf, log, log2, sqrt
from statistics import NormalDist

from rarms_iac.measuring.search.trials import (
    NOTHING_PASSED,
    Bracket,
    Goal,
    Member,
    SearchTrial,
    bracket_of,
    done_share,
    not_sufficient,
    sufficient,
)
from rarms_iac.model.outcomes import WIDTH, Estimate, Measure, NotAchievable, NotResolved, SearchDecision
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.series import Series
from rarms_iac.model.system import AtLeast, AtMost, Threshold
from rarms_iac.statistics.distributions import LOOK_ERROR
from rarms_iac.statistics.estimates import estimate
from rarms_iac.statistics.samples import effective_samples, response_times, successes

MOST = 8
"""Settings with true verdicts that a curve takes at most: bisection tells 1..100 % and "none" apart by 7, and one."""

FIRST = 45
"""The first setting: high enough to see what time no CPU shortens, and near the middle, should nothing be learnt."""

PRECISION = 0.015
"""How well the first setting's mean must be known, as a part of it: the second depends on it alone."""

_TRUNCATION = 0.0003  # points towards the middle, for each squared point of the bracket


def search_with_few_settings(history: Sequence[SearchTrial], goal: Goal) -> SearchDecision:
    """Find a passing setting and a failing one at most `WIDTH` points below, usually by at most `MOST` settings.

    Args:
        history: the settings so far, in the order in which they were run.

    Returns:
        The next setting, or how the search ends. Settings without a steady state, and verdicts that noise turned so
        that `MOST` settings were not enough, are left to halving.
    """
    if not history:
        return Measure(reserve=FIRST, until_clear=True, precision=PRECISION)
    bracket = bracket_of(history, goal)
    if not isinstance(bracket, Bracket):
        return bracket
    if bracket.inconclusive:
        return bisect(history, goal)
    failed, passed = bracket.highest_failed, bracket.upper_end
    crossings = list(crossings_of(history, goal, failed, passed))
    middle = (failed + passed) / 2
    at = max((crossing.at for crossing in crossings), default=middle)  # all must be met
    read_off = bool(crossings) and all(crossing.smooth for crossing in crossings) and at > passed - 2
    width = passed - failed
    if bracket.lowest_passed is not None and (
        width == 1 or (failed > 0 and width <= (WIDTH if read_off else WIDTH - 1))
    ):
        return sufficient(history, passed)
    towards = _TRUNCATION * width**2
    chosen = ceil(min(at + towards, middle)) if at <= middle else floor(max(at - towards, middle))
    # As wide may a bracket be that halving still ends in time; what was measured for something else may have left more.
    reach = 2 ** (max(MOST - len(history), ceil(log2(width))) - 1)
    lowest, highest = max(failed + 1, passed - reach), min(passed - 1, failed + reach)
    return Measure(reserve=max(lowest, min(chosen, highest)), until_clear=True)


WALK_STEP = 10


def bisect(history: Sequence[SearchTrial], goal: Goal) -> SearchDecision:
    """Halve what is left down to one point: the least passing whole per cent.

    Args:
        history: the settings so far, in the order in which they were run.

    Returns:
        The next setting, or how the search ends.
    """
    bracket = bracket_of(history, goal)
    match bracket:
        case NotAchievable() | NotResolved():
            return bracket
        case Bracket(lowest_passed=None) if bracket.stays_above:
            return Measure(reserve=100, until_clear=True)  # whether anything has a steady state
        case Bracket(lowest_passed=passed):
            low, high = bracket.widest
            if passed is not None and (high - low == 1):
                return sufficient(history, passed)
            return Measure(reserve=(low + high) // 2, until_clear=True)


def walk_by_ten(history: Sequence[SearchTrial], goal: Goal) -> SearchDecision:
    """Apply CMCPUR as the paper has it: 10, 20, ... 100 %, until the APT is met or 100 % misses it.

    Args:
        history: the settings so far; others than its own count for nothing.

    Returns:
        The next setting, or how the search ends.
    """
    own = {trial.reserve: trial for trial in history}
    for reserve in range(WALK_STEP, 101, WALK_STEP):
        if reserve not in own:
            return Measure(reserve=reserve, until_clear=True)
        if own[reserve].passed:
            return sufficient([trial for trial in history if trial.reserve % WALK_STEP == 0], reserve)
    return not_sufficient(own[100], goal)


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
    """Where one index of one member probably meets its threshold."""

    at: float  # CR
    smooth: bool  # no cliff: the curve between the fail and the pass may be read off them


def crossings_of(history: Sequence[SearchTrial], goal: Goal, failed: int, passed: int) -> Iterator[Crossing]:
    """Read off the crossings that lie between a failing setting (0: none) and a passing one (101: none).

    Args:
        history: the settings so far, with their verdicts.
        goal: every index of every member is asked on its own.

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
            read_as, target = _time_wanted(measured, goal, member, index, threshold)
            found = (_point(reserve, series, member, read_as) for reserve, series in measured.items())
            points = [point for point in found if point is not None]
            failing = [point for point in points if point.reserve <= failed]
            passing = [point for point in points if point.reserve >= passed]
            work = _work(points, goal.processors)
            if target is None or not points:
                continue
            crossing = (
                _between(failing[-1], passing[0], target, work)
                if failing and passing
                else _beyond(failing[::-1] or passing, target, work)
            )
            if crossing is not None and failed < crossing.at < min(passed + 1, NOTHING_PASSED):
                yield crossing


def _between(failing: _Point, passing: _Point, target: float, work: float | None) -> Crossing | None:
    """Interpolate: half-way between what a + b / CR gives and what a power of the CR gives; never below the work."""
    if not failing.time_ms > target >= passing.time_ms:
        return None
    smooth = failing.time_ms <= passing.time_ms * (1.0 + _STEEPEST * (passing.reserve / failing.reserve - 1.0))
    least = 0.0 if work is None else work / target
    if failing.time_ms * failing.reserve <= _WORK_ALONE * (work or 0.0):
        return Crossing(at=least, smooth=smooth)
    part = (target - passing.time_ms) / (failing.time_ms - passing.time_ms)
    hyperbola = 1.0 / (part / failing.reserve + (1.0 - part) / passing.reserve)
    power = passing.reserve * (failing.reserve / passing.reserve) ** (
        log(target / passing.time_ms) / log(failing.time_ms / passing.time_ms)
    )
    return Crossing(at=max((hyperbola + power) / 2, least / _WORK_ALONE), smooth=smooth)


def _beyond(points: Sequence[_Point], target: float, work: float | None) -> Crossing | None:
    """Extrapolate by a + b / CR from the points of one side, nearest first; b is the work until two points tell."""
    near, slope = points[0], work
    for other in points[1:2]:
        if abs(other.time_ms - near.time_ms) > other.half_band_ms + near.half_band_ms:
            slope = (other.time_ms - near.time_ms) / (1.0 / other.reserve - 1.0 / near.reserve)
        elif near.time_ms <= target and work is not None:
            return Crossing(at=work / target, smooth=False)  # a floor: it ends where the work begins
        else:
            return None
    inverse = 1.0 / near.reserve + (target - near.time_ms) / slope if slope else 0.0
    return Crossing(at=1.0 / inverse, smooth=False) if inverse > 0.0 else None


def _work(points: Sequence[_Point], processors: int) -> float | None:
    """Return the work on as few processors as all settings allow: no response has time for more."""
    known = [(point.work, point.time_ms * point.reserve) for point in points if point.work is not None]
    counts = [n for n in range(1, processors + 1) if all(work / n <= _WORK_ALONE * room for work, room in known)]
    return sum(work for work, _ in known) / len(known) / counts[0] if known and counts else None


def _time_wanted(
    measured: Mapping[int, Series], goal: Goal, member: Member, index: str, threshold: Threshold
) -> tuple[str, float | None]:
    """Return the index to look at and the time (ms) that it must fall to; None: nothing tells."""
    match index, threshold:
        case "success_rate", AtLeast(value=share):
            samples = [sample for series in measured.values() for sample in series.samples if sample.response_ms]
            slowest = max((sample.response_ms or 0.0 for sample in samples if sample.successful), default=0.0)
            quickest = min((sample.response_ms or inf for sample in samples if not sample.successful), default=inf)
            limit = sqrt(slowest * quickest) if slowest and quickest < inf else None
            return "mean_response_time", limit and limit / _multiple(measured, goal, member, float(share) / 100)
        case "deadline_miss_rate", AtMost(value=share) if member.run.deadline is not None:
            return "mean_response_time", float(member.run.deadline) / _multiple(
                measured, goal, member, 1.0 - float(share) / 100
            )
        case "throughput", AtLeast(value=limit) if limit > 0:
            return index, 1000.0 / float(limit) / (1.0 + _room(measured, goal, member, index))
        case _, AtMost(value=limit) if limit > 0:
            return index, float(limit) / (1.0 + _room(measured, goal, member, index))
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


def _multiple(measured: Mapping[int, Series], goal: Goal, member: Member, share: float) -> float:
    """Return the multiple of the mean within which this share of jobs answers, or what shows it.

    It is the same at every setting.
    """
    worth = max(
        effective_samples(successes(series.samples)) / done_share(series, reserve, member.run, series.elapsed_ms, goal)
        for reserve, series in measured.items()
    )
    shows = min(1.0, share + _DEVIATIONS * sqrt(share * (1.0 - share) / worth))
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
