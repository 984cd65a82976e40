"""Verdicts on an APT: met, missed or neither, each with the probability that it is wrong."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import sqrt
from typing import Final

from rarms_iac.model.measurement import Series
from rarms_iac.model.system import AtLeast, AtMost, Elapsed, Run, SampleCount, Threshold
from rarms_iac.statistics import samples as values
from rarms_iac.statistics.estimates import SAFE_SIDE, USUAL_ERROR, Estimate, NoEstimate, estimate
from rarms_iac.statistics.steady_state import Steady, Unsteady, steady_part

VERDICT_ERROR: Final = 0.01
"""The probability with which a verdict may be wrong unless somebody asks for another."""

FIRST_LOOK: Final = 40
"""Samples before the first look: a luckier few have ended settings too early, with rare large errors."""

_MAXIMUM, _MINIMUM = "maximum_response_time", "minimum_response_time"
_NEXT_LOOK = sqrt(2.0)
LAST_EARLY_LOOK: Final = 0.75
"""The part of a setting after which it goes on to its end, and of the error that early looks spend at most."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """One index of the APT with what was estimated."""

    index: str
    threshold: Threshold
    estimate: Estimate


@dataclass(frozen=True, slots=True, kw_only=True)
class Met:
    """Every index meets its threshold, but for this error; of a maximum: so far (`Estimate.beyond`)."""

    error: float
    judged: tuple[Judged, ...]
    warm_up: int  # samples that were left out


@dataclass(frozen=True, slots=True, kw_only=True)
class Missed:
    """At least one index misses its threshold, but for this error."""

    error: float
    judged: tuple[Judged, ...]
    warm_up: int


@dataclass(frozen=True, slots=True, kw_only=True)
class WithinTheNoise:
    """The samples allowed cannot tell; the truth lies within the estimates' bounds, but for this error."""

    error: float
    judged: tuple[Judged, ...]
    warm_up: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TooManyFailures:
    """More failed samples than `run.failures` allows."""

    failed: int
    allowed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TooFewSamples:
    """There is nothing to estimate an index from."""

    why: str


Verdict = Met | Missed | WithinTheNoise | Unsteady | TooManyFailures | TooFewSamples


def judge(series: Series, apt: Mapping[str, Threshold], run: Run, *, error: float = VERDICT_ERROR) -> Verdict:
    """The verdict on a whole series, looked at once."""
    failed = values.failed(series)
    if failed > run.failures:
        return TooManyFailures(failed=failed, allowed=run.failures)
    begin = steady_part(values.response_times(series.samples))
    match begin:
        case Unsteady():
            return begin
        case Steady(first=first):
            return _judge_steady(series, first, apt, run, error)


def judge_each(
    series: Series, apt: Mapping[str, Threshold], run: Run, *, error: float = VERDICT_ERROR
) -> dict[str, Verdict]:
    """The verdict on each index by itself; that any of them is wrong has at most this probability."""
    part = error / max(1, len(apt))
    return {index: judge(series, {index: threshold}, run, error=part) for index, threshold in apt.items()}


def decide(series: Series, apt: Mapping[str, Threshold], run: Run, *, error: float = VERDICT_ERROR) -> Verdict | None:
    """The verdict on the samples so far; None: not settled, go on.

    To be asked at `next_look` counts of samples and at the setting's end, where it is never None. The error holds
    for all looks of a setting together: each has spent no more of it than its share of the setting (an alpha
    spending function), so that early looks need the clearest evidence. An extreme that one more sample may turn is
    not settled before the end.
    """
    share = _done(series, run)
    if share >= 1.0:
        last = judge(series, apt, run, error=error * (1.0 - LAST_EARLY_LOOK))
        return replace(last, error=error) if isinstance(last, Met | Missed) else last
    if values.failed(series) > run.failures:
        return TooManyFailures(failed=values.failed(series), allowed=run.failures)
    if share > LAST_EARLY_LOOK or len(series.samples) < FIRST_LOOK:
        return None
    spent = error * share * (1.0 - 1.0 / _NEXT_LOOK)
    verdict = judge(series, apt, run, error=spent)
    match verdict:
        case Met() | Missed() if not _may_turn(verdict):
            return replace(verdict, error=error)
        case _:
            return None


def _may_turn(verdict: Met | Missed) -> bool:
    """Whether a sample to come can turn it: a maximum met so far may yet be missed, a minimum missed so far met."""
    match verdict:
        case Met(judged=judged):
            return any(one.index == _MAXIMUM for one in judged)
        case Missed(judged=judged):
            return all(one.index == _MINIMUM for one in judged if _misses(one))


def next_look(samples: int) -> int:
    """The count of samples at which to ask `decide` next."""
    look = float(FIRST_LOOK)
    while round(look) <= samples:
        look *= _NEXT_LOOK
    return round(look)


def _done(series: Series, run: Run) -> float:
    """How much of the setting is done, 1 at its end."""
    match run.until:
        case SampleCount(samples=samples):
            return len(series.samples) / samples
        case Elapsed(time=time):
            return series.elapsed_ms / float(time)


def _judge_steady(series: Series, first: int, apt: Mapping[str, Threshold], run: Run, error: float) -> Verdict:
    each = error / max(1, len(apt))
    judged: list[Judged] = []
    for index, threshold in apt.items():
        found = estimate(
            index, part_for(index, series, first), run, error=min(1.0, 2 * each)
        )  # each side is wrong with half of it
        if isinstance(found, NoEstimate):
            return TooFewSamples(why=found.why)
        judged.append(Judged(index=index, threshold=threshold, estimate=found))
    if any(map(_misses, judged)):
        return Missed(error=error, judged=tuple(judged), warm_up=first)
    if all(map(_meets, judged)):
        return Met(error=error, judged=tuple(judged), warm_up=first)
    return WithinTheNoise(error=2 * error, judged=tuple(judged), warm_up=first)


def part_for(index: str, series: Series, first: int) -> Series:
    """What of a series that is steady from `first` on an index is made of: no warm-up excuses a late answer."""
    return series if index == _MAXIMUM else without_warm_up(series, first)


def without_warm_up(series: Series, first: int) -> Series:
    """The steady part, its clock set back, so that a throughput counts its own time only."""
    if first == 0:
        return series
    answered = [number for number, sample in enumerate(series.samples) if sample.response_ms is not None]
    samples = series.samples[answered[first] :]
    began = samples[0].began_ms
    return replace(
        series,
        samples=tuple(replace(sample, began_ms=sample.began_ms - began) for sample in samples),
        elapsed_ms=series.elapsed_ms - began,
    )


def _meets(judged: Judged) -> bool:
    worst, _best = _bounds(judged)
    return worst <= 0.0


def _misses(judged: Judged) -> bool:
    _worst, best = _bounds(judged)
    return best > 0.0


def _excess(judged: Judged, value: float) -> float:
    """By how much the value is on the wrong side of the threshold."""
    match judged.threshold:
        case AtMost(value=limit):
            return value - float(limit)
        case AtLeast(value=limit):
            return float(limit) - value


def _bounds(judged: Judged) -> tuple[float, float]:
    """The worst and the best excess that the samples allow; an extreme is judged by what was seen."""
    found = judged.estimate
    ends = (found.value, found.value) if found.beyond is not None else (found.lower, found.upper)
    first, second = (_excess(judged, end) for end in ends)
    return max(first, second), min(first, second)


PASSING = SAFE_SIDE + LAST_EARLY_LOOK * VERDICT_ERROR
"""Of "enough": at a setting's end by the safe side, or before by what early looks may spend."""


def share(error: float) -> str:
    """`2.5 %`."""
    return f"{100 * error:.3g} %"


def wrong(error: float) -> str:
    """What stands behind a verdict: `wrong in at most 1 %`."""
    return f"wrong in at most {share(error)}"


ERRORS = (
    "Wrong in: how often such a verdict is wrong at most. A reserve is enough where the safe side of the interval "
    f"meets the threshold: {share(SAFE_SIDE)}, or {share(PASSING)} where the setting could end early. That a threshold "
    f"is missed, and what is proven, is said with {share(VERDICT_ERROR)}. An interval (from to) leaves the truth out "
    f"in at most {share(USUAL_ERROR)} of cases, half of that on each side."
)
"""The figures that measuring shows, and what each is of."""
