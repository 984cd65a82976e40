"""Verdicts on an APT: met, missed or neither, each with the probability that it is wrong."""

from collections.abc import Mapping
from dataclasses import replace
from math import inf, sqrt
from statistics import NormalDist
from typing import Final

from rarms_iac.model.indexes import percentile_of
from rarms_iac.model.outcomes import (
    Estimate,
    JudgedIndex,
    Met,
    Missed,
    NoEstimate,
    TooFewSamples,
    TooManyFailures,
    Unsteady,
    Verdict,
    WithinNoise,
)
from rarms_iac.model.run import Elapsed, Periodic, Run, SampleCount
from rarms_iac.model.series import Series
from rarms_iac.model.system import AtLeast, AtMost, Threshold
from rarms_iac.statistics.distributions import ERROR, LOOK_ERROR, samples_needed, shared_error
from rarms_iac.statistics.estimates import share_estimate
from rarms_iac.statistics.overload import estimate_of_setting, find_overload, grows_without_end
from rarms_iac.statistics.samples import failures, response_times
from rarms_iac.statistics.steady_state import steady_part

HOPELESS: Final = 0.2
"""A setting ends early if its full length would give a verdict with at most this probability (predictive power)."""

LONG: Final = 2_000
"""Samples of a series that is to show a steady state which a shorter one did not."""

_DEVIATIONS = -NormalDist().inv_cdf(LOOK_ERROR)
_MAXIMUM, _MINIMUM = "maximum_response_time", "minimum_response_time"
_NORMAL = NormalDist()


def judge(series: Series, apt: Mapping[str, Threshold], run: Run, *, error: float = ERROR) -> Verdict:
    """Judge a whole series that is looked at once.

    That every index meets its threshold takes each of them to be shown; the claim is wrong only if one that misses was
    shown to meet (intersection-union test), so that nothing needs to be shared. That one misses shares the error.

    Args:
        run: The component's; says how many samples may fail, and the deadline.
        error: The probability, 0..1, with which `Met`, and with which `Missed`, may be wrong.

    Returns:
        `TooManyFailures` before `Missed` for an overload before `Unsteady` before what the indexes say: `Met`,
            `Missed`, or inconclusive between them.
    """
    failed = failures(series)
    if len(failed) > run.failures:
        return TooManyFailures(component=series.component, failures=failed, allowed=run.failures)
    overload = find_overload(series, run, error=error)
    if overload and any(grows_without_end(index, series, run) for index in apt):
        return Missed(judged=(), warm_up=0, overload=overload)
    part = steady_part(series)
    if isinstance(part, Unsteady) and not series.wanders and not overload:
        return part
    return _judge_indexes(series, part, apt, run, error)


def judge_each(series: Series, apt: Mapping[str, Threshold], run: Run) -> dict[str, Verdict]:
    """Judge each index by itself.

    Args:
        series: the samples of one component at one setting, in order.
        run: how the component is run, with its deadline.

    Returns:
        A verdict for each index of the APT, in its order.
    """
    return {index: judge(series, {index: threshold}, run) for index, threshold in apt.items()}


def judge_look(series: Series, apt: Mapping[str, Threshold], run: Run, *, members: int = 1) -> Verdict:
    """Judge a setting that may have ended at any look: the error holds for all looks at it together.

    Args:
        series: of one component at one setting, whether it ended early or not.
        members: components of the setting, which share the error of saying that one of them misses.

    Returns:
        As of `judge`.
    """
    verdict = judge(series, apt, run, error=LOOK_ERROR)
    if members > 1 and isinstance(verdict, Missed):
        return judge(series, apt, run, error=shared_error(members, LOOK_ERROR))
    return verdict


def judge_early(
    series: Series, apt: Mapping[str, Threshold], run: Run, *, done: float, members: int = 1, most_samples: float = inf
) -> Verdict | None:
    """Say whether a setting that is being measured may end now, at `FIRST_LOOK` samples or more.

    Args:
        done: the part of the samples that the setting will have at its end, above 0; 1: it has ended.
        most_samples: at most so many the setting will have at its end; fewer than an index needs leave it unclear.

    Returns:
        What `judge_look` says, where it is clear or the rest of the setting will hardly make it so. None: go on. At
        the setting's end it is never None. An extreme that one more sample may turn is not clear before `run.until`
        (absent: `USUAL_SAMPLES`).
    """
    verdict = judge_look(series, apt, run, members=members)
    if done >= 1.0 or isinstance(verdict, TooManyFailures):
        return verdict
    match verdict:
        case Met() | Missed():
            return None if _may_turn(verdict) and until_share(series, run.ends) < 1.0 else verdict
        case WithinNoise(judged=judged):
            return verdict if any(_is_hopeless(index, series, done, most_samples) for index in judged) else None
        case Unsteady():
            return verdict if len(series.samples) >= LONG else None
        case _:
            return None


def until_share(series: Series, until: SampleCount | Elapsed) -> float:
    """Say which part of this much has been measured.

    Args:
        series: of one component, with a sample at least.
        until: so many samples, or so long.

    Returns:
        More than 0; 1 or more: there is enough.
    """
    match until:
        case SampleCount(samples=samples):
            return len(series.samples) / samples
        case Elapsed(time=time):
            return series.elapsed_ms / float(time)


def _is_hopeless(judged: JudgedIndex, series: Series, done: float, most_samples: float) -> bool:
    """Return whether the rest of the setting would probably settle nothing: bounds shrink as the root of the time.

    Where all jobs were good, only as many good ones as are needed settle it.

    Stopping for this can make no verdict wrong (Lan, Simon and Halperin 1982): it only gives one up.
    """
    outlook = _outlook(judged, series)
    if outlook is None:
        needed = _samples_if_all_are_good(judged, series)
        return needed is not None and most_samples < needed
    seen, limit = outlook
    shrinks, goes = sqrt(done), sqrt(1.0 - done)
    below, above = seen.value - seen.lower, seen.upper - seen.value
    under = _NORMAL.cdf((limit - above * shrinks - seen.value) * _DEVIATIONS / (above * goes))
    over = _NORMAL.cdf((seen.value - below * shrinks - limit) * _DEVIATIONS / (below * goes))
    return under + over <= HOPELESS


def samples_to_clear(judged: JudgedIndex, series: Series) -> float | None:
    """Say with how many samples it will be clear, if what was seen so far is what is true.

    Args:
        judged: an index for which the samples show neither.

    Returns:
        How many of all samples, no fewer than there are; infinite where the index is at its threshold. None:
            unknown.
    """
    if _meets(judged):
        return float(len(series.samples))
    outlook = _outlook(judged, series)
    if outlook is None:
        return _samples_if_all_are_good(judged, series)
    seen, limit = outlook
    away = abs(seen.value - limit)
    bound = seen.upper - seen.value if seen.value <= limit else seen.value - seen.lower
    return len(series.samples) * max(1.0, bound / away) ** 2 if away > 0.0 else inf


def _samples_if_all_are_good(judged: JudgedIndex, series: Series) -> float | None:
    """Return `samples_to_clear` where the threshold is met so far and samples are too few for a bound."""
    seen = judged.estimate
    if not _meets(replace(judged, estimate=replace(seen, lower=seen.value, upper=seen.value))):
        return None
    dependence = len(series.samples) / max(1.0, seen.effective_samples)
    needed = samples_needed(judged.index, judged.threshold) * dependence
    return needed if needed > len(series.samples) else None


def _outlook(judged: JudgedIndex, series: Series) -> tuple[Estimate, float] | None:
    """Return the estimate that will become clear, with its threshold; of a percentile the share of jobs beyond it.

    None: an extreme, or bounds that are no bounds.
    """
    seen, limit = judged.estimate, float(judged.threshold.value)
    percentile = percentile_of(judged.index)
    if percentile is not None:
        beyond = [1.0 if time > limit else 0.0 for time in response_times(series.samples)]
        share = share_estimate(beyond, LOOK_ERROR)
        if isinstance(share, NoEstimate):
            return None
        seen, limit = share, 100.0 - float(percentile)
    if seen.beyond is not None or not -inf < seen.lower < seen.value < seen.upper < inf:
        return None
    return seen, limit


def _may_turn(verdict: Met | Missed) -> bool:
    """Return whether a later sample can change the verdict: of a maximum met so far, or a minimum missed so far."""
    match verdict:
        case Met(judged=judged):
            return any(index.index == _MAXIMUM for index in judged)
        case Missed(judged=judged, overload=overload):
            return overload is None and all(index.index == _MINIMUM for index in judged if _misses(index))


def _judge_indexes(
    series: Series, part: Series | Unsteady, apt: Mapping[str, Threshold], run: Run, error: float
) -> Verdict:
    judged: list[JudgedIndex] = []
    for index, threshold in apt.items():
        estimated = estimate_of_setting(index, series, run, error=error)
        if isinstance(estimated, NoEstimate):
            return part if isinstance(part, Unsteady) else TooFewSamples(reason=estimated.reason)
        judged.append(JudgedIndex(index=index, threshold=threshold, estimate=estimated))
    warm_up = 0 if isinstance(part, Unsteady) else len(series.samples) - len(part.samples)
    if all(map(_meets, judged)):
        return Met(judged=tuple(judged), warm_up=warm_up)
    halves = 2 if isinstance(run.arrival, Periodic) else 1  # the other half is spent on an overload
    missing_error = shared_error(halves * len(apt), error)
    if any(_misses_for(index, series, run, missing_error) for index in judged):
        return Missed(judged=tuple(judged), warm_up=warm_up)
    return WithinNoise(judged=tuple(judged), warm_up=warm_up)


def _misses_for(judged: JudgedIndex, series: Series, run: Run, error: float) -> bool:
    """Return whether an index misses its threshold at this error, its share of the error of all."""
    if not _misses(judged):
        return False
    closer = estimate_of_setting(judged.index, series, run, error=error)
    return isinstance(closer, Estimate) and _misses(
        JudgedIndex(index=judged.index, threshold=judged.threshold, estimate=closer)
    )


def _meets(judged: JudgedIndex) -> bool:
    return max(_excesses(judged)) <= 0.0


def _misses(judged: JudgedIndex) -> bool:
    return min(_excesses(judged)) > 0.0


def _excesses(judged: JudgedIndex) -> tuple[float, float]:
    """Return the distance of the bounds beyond the threshold; an extreme is judged by the value seen."""
    index = judged.estimate
    bounds = (index.value, index.value) if index.beyond is not None else (index.lower, index.upper)
    match judged.threshold:
        case AtMost(value=limit):
            return bounds[0] - float(limit), bounds[1] - float(limit)
        case AtLeast(value=limit):
            return float(limit) - bounds[0], float(limit) - bounds[1]
