"""How likely a compound needs how much: predictions, with an error that the answers so far show.

There are many hypotheses: each takes one way to predict, shifted by some bias, with an error of some size; others take
none. They are weighed by how well they foretold what was answered (Bayes' rule). Where a way predicts well on this
host, that shows after a few compounds; where none does, what remains is wide, and more is asked.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from math import ceil, exp, log

BIASES = (-0.2, 0.0, 0.2)
ERRORS = (0.02, 0.07, 0.2, 0.5)
"""In parts of what a compound can save at all: the sum of its parts less its neediest member."""

GRAIN = 0.3
"""Per cent: no prediction is better than that, since a CR is whole."""

BLUNDERS = 0.05
"""Part of the compounds of which even the right way to predict knows nothing."""

BEYOND = 1.25
"""Who knows nothing expects, evenly, any need up to so far beyond the neediest, in parts of what can be saved."""

TRUST = 0.5
"""What it weighs at first that one of the ways predicts; the rest: none does."""

PLACES = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
WIDE = (0.07, 0.2)
"""Where none does, compounds may still be alike: all about here between neediest and sum, with such an error."""

EVEN = 0.7
"""What it weighs that they are not, where nothing predicts."""

UNLIKELY = 7.0
"""Hypotheses that are less likely than the best by this, as a logarithm, are left out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outlook:
    """What is known of what a compound needs; CRs, per cent of each of its processors."""

    neediest: float  # what its neediest member needs alone
    together: float  # what its parts reserve together
    predictions: tuple[float | None, ...]  # what each way predicts; None: it cannot say
    low: int  # it needs at least so much, whether seen or inferred
    slack: int = 0  # points by which it may need less than the neediest
    less: float = 0.0  # the probability that it does
    passed: int | None = None  # it was seen to need at most so much
    failed: int | None = None  # it was itself seen to need more

    @property
    def most(self) -> int:
        """The CR above which the need is not expected to lie."""
        width = max(self.together - self.neediest, 1.0)
        return max(self.low, int(self.neediest + BEYOND * width) + 1) if self.passed is None else self.passed


@dataclass(frozen=True, slots=True, kw_only=True)
class Hypothesis:
    """One way to predict, with its error; `way` None: all lie about `bias`, or anywhere (`error` 0)."""

    way: int | None
    bias: float = 0.0
    error: float = 0.0

    def below(self, outlook: Outlook, reserve: float) -> float:
        """Return the probability that the compound needs at most this CR, before anything was asked about it.

        Args:
            outlook: what is known and predicted of the compound.
            reserve: a CR, in per cent of each of its processors.

        Returns:
            0..1, rising with the reserve.
        """
        least = ceil(outlook.neediest)
        if reserve < least and outlook.slack:
            return outlook.less * max(0.0, reserve + 1 - least + outlook.slack) / outlook.slack
        return outlook.less + (1.0 - outlook.less) * _below(
            self.bias, self.error, outlook.neediest, outlook.together, self._predicted(outlook), reserve
        )

    def _predicted(self, outlook: Outlook) -> float | None:
        if self.way is None:
            return outlook.neediest if self.error else None
        return outlook.predictions[self.way]

    def bounds(self, outlook: Outlook) -> tuple[float, float]:
        """Return the probabilities of a need below the known interval, and of one up to its upper end.

        Args:
            outlook: what is known and predicted of the compound.

        Returns:
            Both 0..1, the first at most the second; their difference is what the answers left of this hypothesis.
        """
        low = self.below(outlook, outlook.low - 1) if outlook.low > outlook.neediest - outlook.slack else 0.0
        return low, 1.0 if outlook.passed is None else self.below(outlook, outlook.passed)


@lru_cache(maxsize=1 << 18)
def _below(
    bias: float, error: float, neediest: float, together: float, prediction: float | None, reserve: float
) -> float:
    width = max(together - neediest, 1.0)
    even = min(1.0, max(0.0, (reserve - neediest + 1.0) / (width * BEYOND + 1.0)))
    if prediction is None:
        return even
    off = (reserve - prediction - bias * width) / (error * width + GRAIN)
    return (1.0 - BLUNDERS) * _logistic(off) + BLUNDERS * even


def _logistic(at: float) -> float:
    return 1.0 / (1.0 + exp(-at)) if at > -500.0 else 0.0


def _first(low: int, high: int, enough: Callable[[int], bool]) -> int:
    """The least that is enough; `high`, if none below is."""
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle + 1, high)
    return low


@dataclass(frozen=True, slots=True, kw_only=True)
class Expectation:
    """What one compound may need, after all that is known."""

    outlook: Outlook
    parts: tuple[tuple[Hypothesis, float, float], ...]  # what it weighs, over what is left, and what lies below that

    def below(self, reserve: int) -> float:
        """Return the probability that the compound needs at most this CR.

        Args:
            reserve: whole per cent of each of its processors.

        Returns:
            0 below what it was seen or inferred to need, 1 from the highest expected need on.
        """
        outlook = self.outlook
        if reserve < outlook.low:
            return 0.0
        if reserve >= outlook.most:
            return 1.0
        return min(
            1.0, sum(weight * (hypothesis.below(outlook, reserve) - low) for hypothesis, weight, low in self.parts)
        )

    def quantile(self, chance: float) -> int:
        """Return the least whole CR that is enough with this probability.

        Args:
            chance: 0..1.

        Returns:
            Per cent of each of the compound's processors.
        """
        return _first(self.outlook.low, self.outlook.most, lambda reserve: self.below(reserve) >= chance)


@dataclass(frozen=True, slots=True, kw_only=True)
class Belief:
    """The hypotheses with what they weigh; the weights add up to 1."""

    weights: Mapping[Hypothesis, float]

    def of(self, outlook: Outlook) -> Expectation:
        """Return how likely this compound needs how much, within what is known of it.

        Args:
            outlook: what is known and predicted of the compound.

        Returns:
            A mixture of the hypotheses that the answers about it left.
        """
        parts = []
        for hypothesis, weight in self.weights.items():
            low, high = hypothesis.bounds(outlook)
            if high > low:
                parts.append((hypothesis, weight / (high - low), low))
        probability = sum(weight * (hypothesis.bounds(outlook)[1] - low) for hypothesis, weight, low in parts)
        return Expectation(
            outlook=outlook, parts=tuple((hypothesis, weight / probability, low) for hypothesis, weight, low in parts)
        )


def belief_of(ways: int, outlooks: Sequence[Outlook]) -> Belief:
    """Weigh every hypothesis by how well it foretold what was measured (Bayes' rule).

    Args:
        ways: how many ways to predict there are; 0: none.
        outlooks: the compounds that were asked about, each with what was measured, in any order. Each
            has `ways` predictions.

    Returns:
        Hypotheses with weights that add up to 1; the very unlikely ones are left out.
    """
    first = _hypotheses(ways)
    likely = [
        sum(parts) for parts in zip(_logarithms(ways), *(_fitting(ways, outlook) for outlook in outlooks), strict=True)
    ]
    best = max(likely)
    weights = {
        hypothesis: exp(value - best)
        for (hypothesis, _), value in zip(first, likely, strict=True)
        if value > best - UNLIKELY
    }
    total = sum(weights.values())
    return Belief(weights={hypothesis: weight / total for hypothesis, weight in weights.items()})


@cache
def _logarithms(ways: int) -> tuple[float, ...]:
    return tuple(log(weight) for _, weight in _hypotheses(ways))


@lru_cache(maxsize=1 << 12)
def _fitting(ways: int, outlook: Outlook) -> tuple[float, ...]:
    """For each hypothesis, how well it foretold what was answered about this compound, as a logarithm."""
    return tuple(_fits(hypothesis, outlook) for hypothesis, _ in _hypotheses(ways))


def _fits(hypothesis: Hypothesis, outlook: Outlook) -> float:
    """The logarithm of the probability of what was answered."""
    low = 0.0 if outlook.failed is None else hypothesis.below(outlook, outlook.failed)
    high = 1.0 if outlook.passed is None else hypothesis.below(outlook, outlook.passed)
    return log(max(high - low, 1e-12))


@cache
def _hypotheses(ways: int) -> tuple[tuple[Hypothesis, float], ...]:
    """With what each weighs before anything was asked."""
    return tuple(_each_hypothesis(ways))


def _each_hypothesis(ways: int) -> Iterator[tuple[Hypothesis, float]]:
    known = TRUST if ways else 0.0
    yield Hypothesis(way=None), (1.0 - known) * EVEN
    for place in PLACES:
        for error in WIDE:
            alike = (1.0 - known) * (1.0 - EVEN) / (len(PLACES) * len(WIDE))
            yield Hypothesis(way=None, bias=place, error=error), alike
    for way in range(ways):
        for bias in BIASES:
            for error in ERRORS:
                yield Hypothesis(way=way, bias=bias, error=error), known / (ways * len(BIASES) * len(ERRORS))


SLACK = 2
"""Points of CR by which a compound on several processors may need less than a part of it."""

ASSUMED = f"a compound needs at least what any part of it needs (on several processors: at most {SLACK} points less)"

SELDOM = 0.1
"""Part of these compounds that do, as one expects before any was asked."""


def slack_on(processors: int) -> int:
    """Return by how much a compound may need less than a part of it.

    Args:
        processors: virtual processors of the compound's partition.

    Returns:
        Points of CR: 0 on one processor, `SLACK` on several.
    """
    return SLACK if processors > 1 else 0


def at_least(cost: int, processors: int) -> int:
    """Return the CR that a compound needs at least, as the need of one of its parts shows.

    Args:
        cost: what that part needs, in per cent of one logical processor.
        processors: virtual processors of the compound's partition.

    Returns:
        Whole per cent of each of these processors, at least 1; rounded up, less `slack_on`.
    """
    return max(1, -(-cost // processors) - slack_on(processors))
