"""Quantiles of the few distributions that stated errors rest on; the standard library has the normal one only."""

from functools import lru_cache
from math import exp, inf, lgamma, log, sqrt
from statistics import NormalDist

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
