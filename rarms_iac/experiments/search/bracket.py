"""Between which settings the least reservation lies."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rarms_iac.experiments.search.values import NotAchievable, NotResolved, Trial
from rarms_iac.statistics.steadiness import Unsteady
from rarms_iac.statistics.verdict import TooFewSamples, TooManyFailures, Verdict, WithinTheNoise


@dataclass(frozen=True, slots=True, kw_only=True)
class Bracket:
    """The highest setting that failed (0: none did, and none can lie below) and the lowest that passed above it."""

    failed: int
    passed: int | None


def bracket_of(history: Sequence[Trial]) -> Bracket | NotAchievable | NotResolved:
    """What the trials leave open.

    A setting that fails above one that passed (noise, near the threshold) voids the one below: the safe side.
    """
    top = [trial for trial in history if trial.reserve == 100 and not trial.passed]
    if top:
        return not_met(top[-1])
    failed = max((trial.reserve for trial in history if not trial.passed), default=0)
    passed = min((trial.reserve for trial in history if trial.passed and trial.reserve > failed), default=None)
    return Bracket(failed=failed, passed=passed)


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
