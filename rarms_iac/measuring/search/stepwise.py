"""The two searches that assume only that more processor time is never worse: bisection, and the paper's walk."""

from collections.abc import Sequence

from rarms_iac.measuring.search.trials import Bracket, Goal, SearchTrial, bracket_of, sufficient
from rarms_iac.model.outcomes import Measure, NotAchievable, NotResolved, SearchStep

WALK_STEP = 10


def bisect(history: Sequence[SearchTrial], _goal: Goal) -> SearchStep:
    """Halve what is left down to one point: the least passing whole per cent.

    Args:
        history: the settings so far, in the order in which they were run.

    Returns:
        The next setting, or how the search ends.
    """
    bracket = bracket_of(history)
    match bracket:
        case NotAchievable() | NotResolved():
            return bracket
        case Bracket(passed=None) if bracket.stays_above:
            return Measure(reserve=100, until_clear=True)  # whether anything has a steady state
        case Bracket(passed=passed):
            low, high = bracket.widest
            if passed is not None and (high - low == 1):
                return sufficient(history, passed)
            return Measure(reserve=(low + high) // 2, until_clear=True)


def walk_by_ten(history: Sequence[SearchTrial], _goal: Goal) -> SearchStep:
    """CMCPUR as the paper has it: 10, 20, ... 100 %, until the APT is met or 100 % misses it.

    Args:
        history: the settings of this walk, in their order.

    Returns:
        The next setting, or how the search ends.
    """
    if not history:
        return Measure(reserve=WALK_STEP, until_clear=True)
    last = history[-1]
    if last.passed:
        return sufficient(history, last.reserve)
    if last.reserve == 100:
        # To the letter: what is not shown to meet the APT there has no reservation that does.
        return NotAchievable(reserve=100)
    return Measure(reserve=last.reserve + WALK_STEP, until_clear=True)
