"""Between which settings the least reservation lies."""

from collections.abc import Sequence
from dataclasses import dataclass

from rarms_iac.experiments.search.values import NotAchievable, NotResolved, Trial


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
        return NotAchievable() if top[-1].judged else NotResolved(why="no verdict at 100 %: " + _why(top[-1]))
    failed = max((trial.reserve for trial in history if not trial.passed), default=0)
    passed = min((trial.reserve for trial in history if trial.passed and trial.reserve > failed), default=None)
    return Bracket(failed=failed, passed=passed)


def _why(trial: Trial) -> str:
    return "; ".join(f"{name}: {type(verdict).__name__}" for name, verdict in sorted(trial.verdicts.items()))
