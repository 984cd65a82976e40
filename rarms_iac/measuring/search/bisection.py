"""Halving: the fallback that rests on nothing but that more processor time is never worse."""

from collections.abc import Sequence

from rarms_iac.measuring.search.bracket import Bracket, bracket_of
from rarms_iac.measuring.search.values import Found, Goal, Measure, NotAchievable, NotResolved, Step, Trial


def next_step(history: Sequence[Trial], goal: Goal) -> Step:
    """The next setting, halving what is left down to one point: the least passing whole per cent."""
    return halve(history, goal, width=1)


def halve(history: Sequence[Trial], _goal: Goal, *, width: int) -> Step:
    """The same, down to a passing setting with a failing one at most `width` points below it."""
    bracket = bracket_of(history)
    match bracket:
        case NotAchievable() | NotResolved():
            return bracket
        case Bracket(passed=None) if bracket.weary:
            return Measure(reserve=100)  # whether anything has a steady state
        case Bracket(failed=failed, passed=passed):
            low, high = bracket.widest
            if passed is not None and (passed - bracket.floor <= width or high - low == 1):
                return Found(reserve=passed, failed=failed or None)
            return Measure(reserve=(low + high) // 2)
