"""The default strategy: few settings, by what earlier ones tell of the whole curve; halving when guesses fail."""

from collections.abc import Sequence

from rarms_iac.measuring.search import posterior, tree
from rarms_iac.measuring.search.bisection import halve
from rarms_iac.measuring.search.bracket import Bracket, bracket_of
from rarms_iac.measuring.search.observations import Question, questions
from rarms_iac.measuring.search.values import Found, Goal, Measure, NotAchievable, NotResolved, Step, Trial

FIRST = 45
"""The first setting: high enough to see what time no CPU shortens, and near the middle, should nothing be learnt."""

PRECISION = 0.015
"""How well the first setting's level must be known, as a part of it: all that follows rests on it."""

DOUBT = 0.1
"""The probability with which a search may end more than a point too high: what the curve allows is measured, too."""

PATIENCE = 12
"""Settings after which the search goes on by halving."""


def next_step(history: Sequence[Trial], goal: Goal) -> Step:
    """The root of the optimal search tree over what is probable; ends with a measured pass and fail close together."""
    if not history:
        return Measure(reserve=FIRST, precision=PRECISION)
    bracket = bracket_of(history)
    match bracket:
        case NotAchievable() | NotResolved():
            return bracket
        case Bracket(passed=passed) if len(history) >= PATIENCE or (bracket.weary and passed is None):
            return halve(history, goal, width=1)
        case Bracket(failed=failed, passed=passed, floor=floor, closed=closed):
            top = passed or tree.NOTHING_PASSED
            chances = _chances(questions(history, goal), floor, top, goal)
            if passed is not None and tree.certain(chances, floor, passed, DOUBT, closed):
                return Found(reserve=passed, failed=failed or None)
            return Measure(reserve=tree.root(chances, floor, top, DOUBT, closed))


def _chances(asked: Sequence[Question], failed: int, passed: int, goal: Goal) -> list[float]:
    """All questions must be answered by the reservation: its distribution is that of their largest answer."""
    below = [1.0] * (tree.NOTHING_PASSED + 1)
    for question in asked:
        running = 0.0
        for reserve, chance in enumerate(posterior.chances(question, failed, passed, goal.processors)):
            running += chance
            below[reserve] *= running
    if not asked:
        return posterior.mixed([0.0] * (tree.NOTHING_PASSED + 1), failed, passed)
    return [later - sooner for sooner, later in zip([0.0, *below], below, strict=False)]
