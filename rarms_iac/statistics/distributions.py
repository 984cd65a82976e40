"""The one error that is stated of measured numbers, how it is spent, and the quantiles that it needs.

Everything that rarms concludes from samples it says wrongly in at most `ERROR` of the runs: that a setting is enough,
that a threshold is missed, that a layout holds, and that the truth is not beyond a bound. All that is said of several
things together shares it. The standard library has the quantiles of the normal distribution only.
"""

from functools import lru_cache
from math import ceil, exp, inf, lgamma, log, log1p, sqrt
from statistics import NormalDist
from typing import Final

from rarms_iac.model.indexes import percentile_of
from rarms_iac.model.series import MOST_SAMPLES
from rarms_iac.model.system import AtLeast, AtMost, Threshold

_TINY = 1e-300
_TERMS = 400
_HALVINGS = 52
_NORMAL_ENOUGH = 400.0  # degrees of freedom from which Student's t is the normal within 0.3 %


def normal_quantile(probability: float) -> float:
    """Compute the value that a standard normal variable stays below with this probability.

    Args:
        probability: between 0 and 1, neither of them.

    Returns:
        The value, in standard deviations from the mean.

    Raises:
        statistics.StatisticsError: the probability is not between 0 and 1.
    """
    return NormalDist().inv_cdf(probability)


def share_below(value: float, a: float, b: float) -> float:
    """Compute P(Beta(a, b) <= value), the regularised incomplete beta function, by its continued fraction (Lentz).

    Args:
        value: any number; at most 0 gives 0, at least 1 gives 1.

    Returns:
        The probability, 0..1.
    """
    if value <= 0.0:
        return 0.0
    if value >= 1.0:
        return 1.0
    if value > (a + 1.0) / (a + b + 2.0):
        return 1.0 - share_below(1.0 - value, b, a)
    front = exp(lgamma(a + b) - lgamma(a) - lgamma(b) + a * log(value) + b * log(1.0 - value)) / a
    return front / _continued_fraction(value, a, b)


def _continued_fraction(value: float, a: float, b: float) -> float:
    """Return 1 + d1/(1 + d2/(1 + ...)); its inverse times the front factor is the distribution function."""
    result, c, d = 1.0, 1.0, 0.0
    for term in range(1, _TERMS):
        half = term // 2
        if term % 2:
            factor = -(a + half) * (a + b + half) * value / ((a + 2 * half) * (a + 2 * half + 1))
        else:
            factor = half * (b - half) * value / ((a + 2 * half - 1) * (a + 2 * half))
        d = 1.0 / (1.0 + factor * d or _TINY)
        c = 1.0 + factor / c or _TINY
        result *= c * d
        if abs(c * d - 1.0) < 1e-13:
            break
    return result


@lru_cache(maxsize=4096)
def beta_quantile(probability: float, a: float, b: float) -> float:
    """Compute the value that a Beta(a, b) variable stays below with this probability, by bisection.

    Returns:
        A share, 0..1, exact to the last of `_HALVINGS` halvings; each costs one call of `share_below`.
    """
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if share_below(middle, a, b) < probability:
            low = middle
        else:
            high = middle
    return (low + high) / 2


@lru_cache(maxsize=4096)
def student_quantile(probability: float, freedom: float) -> float:
    """Compute the value that Student's t stays below with this probability.

    Args:
        freedom: degrees of freedom, not necessarily whole; many count as a normal distribution.

    Returns:
        The value; infinite without a degree of freedom.
    """
    if freedom > _NORMAL_ENOUGH:
        return normal_quantile(probability)
    if probability < 0.5:
        return -student_quantile(1.0 - probability, freedom)
    if freedom <= 0.0:
        return inf
    # t^2 / (freedom + t^2) is Beta(1/2, freedom/2) distributed.
    share = beta_quantile(2.0 * probability - 1.0, 0.5, freedom / 2)
    return sqrt(freedom * share / (1.0 - share)) if share < 1.0 else inf


def share_interval(successes: float, trials: float, *, error: float) -> tuple[float, float]:
    """Compute Clopper and Pearson's bounds of a share: each is wrong with at most half the error.

    Args:
        successes: 0 to `trials`, not necessarily whole.
        trials: the independent trials that the samples are worth.
        error: the probability, 0..1, that the share lies outside of the bounds.

    Returns:
        The lower and the upper bound, 0..1.
    """
    misses = trials - successes
    lower = beta_quantile(error / 2, successes, misses + 1.0) if successes > 0.0 else 0.0
    upper = beta_quantile(1.0 - error / 2, successes + 1.0, misses) if misses > 0.0 else 1.0
    return lower, upper


ERROR: Final = 0.01
"""The probability with which what is said may be wrong."""

FIRST_LOOK: Final = 40
"""Samples before the first look at a setting that is being measured."""

LOOK_GROWTH: Final = 2.0**0.5
"""How many times as many samples there are at the next look."""

LOOK_ERROR: Final = ERROR / 43
"""The error of each look at a setting, at any count of samples: a constant boundary.

The standardised mean of the first n samples lies above 3.5 at any n from 40 to 40,000 in 1 % of series, where one lies
with a probability of 0.00023 (`benchmarks/verdicts.py` simulates it). So what is said of a setting holds
however often it was looked at, whenever it ended, and after any further samples.
"""

PERIODIC_STARTS: Final = ceil(log(LOOK_ERROR) / log(0.75))
"""Starts of a load, 30, that a bound of a periodic component needs: it may lock into one phase for each.

A phase that a quarter of all starts lead to is in none of so many with a probability of at most `LOOK_ERROR`. Where
starts are alike nothing else shows it: all jobs of a start have its phase.
"""


def shared_error(parts: int, error: float) -> float:
    """Share an error among several statements, so that it holds for all of them together (union bound).

    Args:
        parts: how many statements; none counts as one.
        error: the probability, 0..1, that any of them is wrong.

    Returns:
        The error of each.
    """
    return error / max(1, parts)


def next_look(samples: int) -> int:
    """Say at which count of samples to look at a setting next.

    Returns:
        A larger count. The counts grow geometrically, so that the looks stay few.
    """
    look = float(FIRST_LOOK)
    while round(look) <= samples:
        look *= LOOK_GROWTH
    return round(look)


def samples_needed(index: str, threshold: Threshold) -> int:
    """Say with how many samples an index is shown to meet its threshold at the earliest, where all of them are good.

    Returns:
        Independent samples: `FIRST_LOOK` at least, and more than `MOST_SAMPLES` where no setting may have enough; of a
            share of jobs that may be bad, those of which all are good but for the error at greater shares.
    """
    match threshold:
        case AtMost() if (percentile := percentile_of(index)) is not None:
            bad = 1.0 - float(percentile) / 100
        case AtLeast(value=share) if index == "success_rate":
            bad = 1.0 - float(share) / 100
        case AtMost(value=share) if index == "deadline_miss_rate":
            bad = float(share) / 100
        case _:
            return FIRST_LOOK
    if bad <= 0.0:
        return MOST_SAMPLES + 1
    return FIRST_LOOK if bad >= 1.0 else max(FIRST_LOOK, ceil(log(LOOK_ERROR) / log1p(-bad)))


def describe_error() -> str:
    """Return the confidence of a statement: `99 % confidence`."""
    return f"{100 - 100 * ERROR:.4g} % confidence"


def describe_errors(*, sure: bool, so_far: bool) -> str:
    """Write how sure several verdicts are, below their table.

    Args:
        sure: some are wrong with a known probability: each with `ERROR`, and so is that all of them are met.
        so_far: some are of a maximum or minimum, whose probability is unknown.

    Returns:
        A sentence; empty where there is nothing of either.
    """
    each = f"{100 - 100 * ERROR:.4g} % confidence each" if sure else ""
    extremes = "a maximum or minimum is met so far" if so_far else ""
    sentence = "; ".join(filter(None, (each, extremes)))
    return f"{sentence.capitalize()}." if sentence else ""


def describe_extreme(beyond: float) -> str:
    """Write what an extreme says of jobs to come, the same everywhere.

    Args:
        beyond: the share of jobs, in per cent, that may yet lie beyond it (`Estimate.beyond`).

    Returns:
        Words to append to a value: `so far; up to 2.3 % of the jobs may lie beyond it`.
    """
    return f"so far; up to {beyond:.2g} % of the jobs may lie beyond it"


ERRORS_EXPLAINED: Final = (
    f"Each statement on measured values has {describe_error()}: a reservation is enough, a threshold is missed, or "
    "all thresholds of a layout are met. The bounds (from, to) have the same confidence. Bounds include unseen jobs "
    "of up to twice the mean time or the longest measured time. For a maximum or minimum, rarms shows the "
    "measured value so "
    "far and the share of jobs that may be beyond it."
)
"""What the terminal, the report and the documentation say of errors."""
