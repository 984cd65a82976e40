"""The one error that is said of measured numbers, and how it is spent.

Everything that rarms concludes from samples it says wrongly in at most `ERROR` of the runs: that a setting is enough,
that a threshold is missed, that a layout holds, and that the truth is not beyond a bound. Whatever is said of several
things together shares it. The quantiles of the few distributions that stated errors rest on are here, too: the standard
library has the normal one only.
"""

from functools import lru_cache
from math import exp, inf, lgamma, log, sqrt
from statistics import NormalDist
from typing import Final

ERROR: Final = 0.01
"""The probability with which what is said may be wrong."""

FIRST_LOOK: Final = 40
"""Samples before the first look at a setting that is being measured."""

LOOK_APART: Final = 2.0**0.5
"""How many times as many samples there are at the next look."""

LOOK_ERROR: Final = ERROR / 14
"""The error of each look at a setting, however many there are: a constant boundary (Pocock 1977).

The largest of the standardised means at 40, 57, 80, ... 40,000 samples lies above 3.18, where one lies with a
probability of 0.00074, in 1 % of runs: 21 looks count like 14 independent ones, since they share their samples
(`benchmarks/verdicts.py` simulates it). So the bounds of a setting hold whenever it ended, and need not know why.
"""

_TINY = 1e-300
_TERMS = 400
_HALVINGS = 52
_NORMAL_ENOUGH = 400.0  # degrees of freedom from which Student's t is the normal within 0.3 %


def shared_error(parts: int, error: float = ERROR) -> float:
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

    Args:
        samples: how many there are now.

    Returns:
        A larger count. The counts grow geometrically, so that the looks stay few.
    """
    look = float(FIRST_LOOK)
    while round(look) <= samples:
        look *= LOOK_APART
    return round(look)


def describe_error(error: float = ERROR) -> str:
    """Write how sure a statement is, the same everywhere.

    Args:
        error: the probability, 0..1, that it is wrong.

    Returns:
        Words to append to a message: `wrong in at most 1 of 100 runs`.
    """
    return f"wrong in at most {100 * error:.3g} of 100 runs"


def describe_extreme(beyond: float) -> str:
    """Write what an extreme says of jobs to come, the same everywhere.

    Args:
        beyond: the share of jobs, in per cent, that may yet lie beyond it (`Estimate.beyond`).

    Returns:
        Words to append to a value: `so far; up to 2.3 % of the jobs may lie beyond it`.
    """
    return f"so far; up to {beyond:.2g} % of the jobs may lie beyond it"


ERRORS_EXPLAINED: Final = (
    f"What is said of measured numbers is {describe_error()}: that a reserve is enough, that a threshold is missed, "
    "and what is proven of all components of a host together. A bound (from, to) has the truth beyond it as rarely. "
    "Jobs of a kind that no sample showed are counted in, taking up to twice the mean time, or as long as the longest "
    "seen. Of a maximum or minimum nothing more is said than what was seen so far, and the share of jobs that may lie "
    "beyond it."
)
"""The same words in the terminal, in the report and in the documentation."""


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
        a: above 0.
        b: above 0.

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
    """1 + d1/(1 + d2/(1 + ...)), whose inverse times the front factor is the distribution function."""
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

    Args:
        probability: 0..1.
        a: above 0.
        b: above 0.

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
        probability: between 0 and 1.
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
