"""Verdicts on an APT: met, missed or neither, each with the probability that it is wrong."""

from collections.abc import Mapping
from dataclasses import replace
from math import sqrt
from typing import Final

from rarms_iac.model.measurement import Series
from rarms_iac.model.outcomes import (
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
from rarms_iac.model.system import AtLeast, AtMost, Elapsed, Run, SampleCount, Threshold
from rarms_iac.statistics.estimates import SAFE_SIDE, USUAL_ERROR, estimate
from rarms_iac.statistics.samples import failures, response_times
from rarms_iac.statistics.steady_state import find_steady_part, steady_series

VERDICT_ERROR: Final = 0.01
"""The probability with which a verdict may be wrong unless somebody asks for another."""

FIRST_LOOK: Final = 40
"""Samples before the first look: a luckier few have ended settings too early, with rare large errors."""

LAST_EARLY_LOOK: Final = 0.75
"""The part of a setting after which it goes on to its end, and of the error that early looks spend at most."""

PASSING_ERROR: Final = SAFE_SIDE + LAST_EARLY_LOOK * VERDICT_ERROR
"""Of "enough": at a setting's end by the safe side, or before by what early looks may spend."""

_MAXIMUM, _MINIMUM = "maximum_response_time", "minimum_response_time"
_NEXT_LOOK = sqrt(2.0)


def judge(series: Series, apt: Mapping[str, Threshold], run: Run, *, error: float = VERDICT_ERROR) -> Verdict:
    """Judge a whole series that is looked at once.

    Args:
        series: Of one component at one setting.
        apt: Thresholds by index; the error is shared among them, so that it holds for all together.
        run: The component's; says how many samples may fail, and the deadline.
        error: The probability, 0..1, with which `Met`, and with which `Missed`, may be wrong.
    """
    failed = failures(series)
    if len(failed) > run.failures:
        return TooManyFailures(component=series.component, failures=failed, allowed=run.failures)
    first = find_steady_part(response_times(series.samples))
    return first if isinstance(first, Unsteady) else _judge_steady(series, first, apt, run, error)


def judge_each(
    series: Series, apt: Mapping[str, Threshold], run: Run, *, error: float = VERDICT_ERROR
) -> dict[str, Verdict]:
    """Judge each index by itself.

    Args:
        series: the samples of one component at one setting, in order.
        apt: the thresholds by index.
        run: how the component is run, with its deadline.
        error: the probability, 0..1, that any of the verdicts is wrong; each index gets an equal part.

    Returns:
        A verdict for each index of the APT, in its order.
    """
    part = error / max(1, len(apt))
    return {index: judge(series, {index: threshold}, run, error=part) for index, threshold in apt.items()}


def judge_early(
    series: Series, apt: Mapping[str, Threshold], run: Run, *, error: float = VERDICT_ERROR
) -> Verdict | None:
    """Judge the samples so far of a setting that is being measured.

    To be asked at `next_look` counts of samples and at the setting's end. The error holds for all looks of a setting
    together: each has spent no more of it than its share of the setting (an alpha spending function), so that early
    looks need the clearest evidence. An extreme that one more sample may turn is not clear before the end.

    Returns:
        The verdict; None: not clear yet, go on. At the setting's end it is never None.
    """
    done = _done_share(series, run)
    if done >= 1.0:
        last = judge(series, apt, run, error=error * (1.0 - LAST_EARLY_LOOK))
        return replace(last, error=error) if isinstance(last, Met | Missed) else last
    failed = failures(series)
    if len(failed) > run.failures:
        return TooManyFailures(component=series.component, failures=failed, allowed=run.failures)
    if done > LAST_EARLY_LOOK or len(series.samples) < FIRST_LOOK:
        return None
    spent = error * done * (1.0 - 1.0 / _NEXT_LOOK)
    verdict = judge(series, apt, run, error=spent)
    if isinstance(verdict, Met | Missed) and not _may_turn(verdict):
        return replace(verdict, error=error)
    return None


def next_look(samples: int) -> int:
    """Say at which count of samples to ask `judge_early` next.

    Args:
        samples: how many there are now.

    Returns:
        A larger count. The counts grow geometrically, so that the looks stay few.
    """
    look = float(FIRST_LOOK)
    while round(look) <= samples:
        look *= _NEXT_LOOK
    return round(look)


def show_error(error: float) -> str:
    """Write a probability as people read it.

    Args:
        error: 0..1.

    Returns:
        Per cent, with at most three digits: `2.5 %`.
    """
    return f"{100 * error:.3g} %"


def describe_error(error: float) -> str:
    """Write how sure a verdict is.

    Args:
        error: the probability, 0..1, that it is wrong.

    Returns:
        Words to append to a message: `wrong in at most 1 %`.
    """
    return f"wrong in at most {show_error(error)}"


ERRORS_EXPLAINED = (
    "Wrong in: how often such a verdict is wrong at most. A reserve is enough where the safe side of the interval "
    f"meets the threshold: {show_error(SAFE_SIDE)}, or {show_error(PASSING_ERROR)} where the setting could end early. "
    f"That a threshold is missed, and what is proven, is said with {show_error(VERDICT_ERROR)}. An interval (from to) "
    f"leaves the truth out in at most {show_error(USUAL_ERROR)} of cases, half of that on each side."
)
"""The same words in the terminal, in the report and in the glossary."""


def _may_turn(verdict: Met | Missed) -> bool:
    """Whether a sample to come can turn it: a maximum met so far may yet be missed, a minimum missed so far met."""
    match verdict:
        case Met(judged=judged):
            return any(index.index == _MAXIMUM for index in judged)
        case Missed(judged=judged):
            return all(index.index == _MINIMUM for index in judged if _misses(index))


def _done_share(series: Series, run: Run) -> float:
    """How much of the setting is done, 1 at its end."""
    match run.until:
        case SampleCount(samples=samples):
            return len(series.samples) / samples
        case Elapsed(time=time):
            return series.elapsed_ms / float(time)


def _judge_steady(series: Series, first: int, apt: Mapping[str, Threshold], run: Run, error: float) -> Verdict:
    both_sides = min(1.0, 2 * error / max(1, len(apt)))  # an estimate's error is of two sides, a verdict's of one
    judged: list[JudgedIndex] = []
    for index, threshold in apt.items():
        estimated = estimate(index, steady_series(index, series, first), run, error=both_sides)
        if isinstance(estimated, NoEstimate):
            return TooFewSamples(reason=estimated.reason)
        judged.append(JudgedIndex(index=index, threshold=threshold, estimate=estimated))
    if any(map(_misses, judged)):
        return Missed(error=error, judged=tuple(judged), warm_up=first)
    if all(map(_meets, judged)):
        return Met(error=error, judged=tuple(judged), warm_up=first)
    return WithinNoise(error=2 * error, judged=tuple(judged), warm_up=first)


def _meets(judged: JudgedIndex) -> bool:
    return max(_excesses(judged)) <= 0.0


def _misses(judged: JudgedIndex) -> bool:
    return min(_excesses(judged)) > 0.0


def _excesses(judged: JudgedIndex) -> tuple[float, float]:
    """By how much the bounds are on the wrong side of the threshold; an extreme is judged by what was seen."""
    index = judged.estimate
    bounds = (index.value, index.value) if index.beyond is not None else (index.lower, index.upper)
    match judged.threshold:
        case AtMost(value=limit):
            return bounds[0] - float(limit), bounds[1] - float(limit)
        case AtLeast(value=limit):
            return float(limit) - bounds[0], float(limit) - bounds[1]
