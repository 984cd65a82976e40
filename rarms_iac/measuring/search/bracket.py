"""Between which settings the least reservation lies."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from rarms_iac.measuring.search.values import NotAchievable, NotResolved, Trial
from rarms_iac.statistics.steady_state import Unsteady
from rarms_iac.statistics.verdicts import TooFewSamples, TooManyFailures, Verdict, WithinTheNoise

MOST_UNTOLD = 3
"""Settings without a steady state between a fail and a pass, after which nothing below them is looked for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bracket:
    """The highest setting that failed (0: none did, and none can lie below) and the lowest that passed above it."""

    failed: int
    passed: int | None
    untold: tuple[int, ...] = ()  # measured between the two, and without a steady state; in their order

    @property
    def weary(self) -> bool:
        """Whether so many settings have no steady state that the search stays above them, on the safe side."""
        return len(self.untold) >= MOST_UNTOLD

    @property
    def floor(self) -> int:
        """Below what the search does not look; 0: it looks everywhere."""
        return self.untold[-1] if self.weary else self.failed

    @property
    def closed(self) -> frozenset[int]:
        """What it does not measure once more, between the floor and the lowest setting that passed."""
        return frozenset(one for one in self.untold if one > self.floor)

    @property
    def widest(self) -> tuple[int, int]:
        """The two settings next to each other with the most between them that was not measured; of equals the upper."""
        ends = (self.floor, *sorted(self.closed), 101 if self.passed is None else self.passed)
        return max(pairwise(ends), key=lambda pair: (pair[1] - pair[0], pair))


def bracket_of(history: Sequence[Trial]) -> Bracket | NotAchievable | NotResolved:
    """What the trials leave open.

    A setting that fails above one that passed (noise, near the threshold) voids the one below: the safe side. One
    without a steady state voids nothing, and nothing rests on it: it is no verdict.
    """
    failed = max((trial.reserve for trial in history if trial.failed), default=0)
    passed = min((trial.reserve for trial in history if trial.passed and trial.reserve > failed), default=None)
    top = [trial for trial in history if trial.reserve == 100 and not trial.passed]
    if top and passed is None:
        return not_met(top[-1])
    _, untold = below(history, 101 if passed is None else passed)
    return Bracket(failed=failed, passed=passed, untold=untold)


def below(history: Sequence[Trial], reserve: int) -> tuple[int | None, tuple[int, ...]]:
    """The highest lower setting that failed (None: none did), and those above it that have no steady state."""
    lower = [trial for trial in history if trial.reserve < reserve]
    failed = max((trial.reserve for trial in lower if trial.failed), default=0)
    told = {trial.reserve for trial in lower if not trial.untold}
    untold = {trial.reserve for trial in lower if trial.reserve > failed} - told
    return failed or None, tuple(sorted(untold))


def not_met(trial: Trial) -> NotAchievable | NotResolved:
    """What it comes to that the highest reservation there is did not pass."""
    if trial.judged:
        return NotAchievable()
    why = "; ".join(f"{name} {_IN_WORDS[type(trial.verdicts[name])]}" for name in sorted(trial.worse))
    return NotResolved(why=f"at {trial.reserve} % {why}")


_IN_WORDS: Mapping[type[Verdict], str] = {
    WithinTheNoise: "is within the noise of its threshold, and no number of samples allowed tells",
    Unsteady: "has no steady state",
    TooManyFailures: "has too many failed samples",
    TooFewSamples: "has too few samples",
}
