"""The search for the least reservation: strategies are pure functions of the settings measured so far.

    step = STRATEGIES["default"](history, goal)

Resuming is replaying the history out of the data log: the same history gives the same step.
"""

from rarms_iac.measuring.search import bisection, default, paper
from rarms_iac.measuring.search.values import (
    Found,
    Goal,
    Measure,
    Member,
    NotAchievable,
    NotResolved,
    Step,
    Strategy,
    Trial,
    settled,
    trial_of,
)

STRATEGIES: dict[str, Strategy] = {
    "default": default.next_step,
    "bisection": bisection.next_step,
    "paper": paper.next_step,
}
"""By the name that `--strategy` takes."""

__all__ = [
    "STRATEGIES",
    "Found",
    "Goal",
    "Measure",
    "Member",
    "NotAchievable",
    "NotResolved",
    "Step",
    "Strategy",
    "Trial",
    "settled",
    "trial_of",
]
