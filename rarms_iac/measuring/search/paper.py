"""CMCPUR as PAPER.md has it: 10, 20, ... 100 %, until the APT is met."""

from collections.abc import Sequence

from rarms_iac.measuring.search.values import Found, Goal, Measure, NotAchievable, Step, Trial

STEP = 10


def next_step(history: Sequence[Trial], _goal: Goal) -> Step:
    """The walk's next setting; the first that is not worse than the APT ends it, and so does a missed 100 %."""
    if not history:
        return Measure(reserve=STEP)
    last = history[-1]
    if last.passed:
        return Found(reserve=last.reserve, failed=last.reserve - STEP or None)
    if last.reserve == 100:
        return NotAchievable()  # to the letter: what is not shown to meet the APT there has no reservation that does
    return Measure(reserve=last.reserve + STEP)
