"""The default strategy: few settings, by what earlier ones tell of the whole curve; halving when guesses fail."""

from collections.abc import Collection, Sequence
from itertools import accumulate

from rarms_iac.measuring.search.observations import Question, questions
from rarms_iac.measuring.search.posterior import chances, mixed
from rarms_iac.measuring.search.stepwise import bisect
from rarms_iac.measuring.search.trials import NOTHING_PASSED, Bracket, Goal, SearchTrial, bracket_of, sufficient
from rarms_iac.model.outcomes import Measure, NotAchievable, NotResolved, SearchStep

WIDTH = 3
"""A passing setting is certified by a failing one at most so many points below it."""

AGAIN = 0.3
"""Settings to come after an end with points between fail and pass: so often the curve asks for one of those, too."""

_BESIDE = 4  # where a search may end is not quite what Knuth's rule allows


def certain(
    chances: Sequence[float], failed: int, passed: int, doubt: float, closed: Collection[int] = frozenset()
) -> bool:
    """Whether the search may end between a failing setting (0: none) and a passing one (101: none).

    `chances[c]` is the probability that c is the least reservation; that it lies more than a point below `passed` may
    have the probability `doubt`. Those that are closed are not to be measured: where no other is left, it ends.
    """
    if passed == NOTHING_PASSED:
        return failed == NOTHING_PASSED - 1
    if passed - failed - 1 == len(closed):
        return True
    if passed - failed > WIDTH or (failed == 0 and passed > 1):
        return False
    inside = sum(chances[failed + 1 : passed + 1])
    return sum(chances[failed + 1 : passed - 1]) <= doubt * inside


def root(
    chances: Sequence[float], failed: int, passed: int, doubt: float, closed: Collection[int] = frozenset()
) -> int:
    """The setting to measure next, when the answer lies above `failed` and not above `passed`; none that is closed.

    A dynamic program over all brackets: V(l, r) = 0 where the search may end (`AGAIN` P(l, r) with points in between),
    otherwise P(l, r) + the least over m of V(l, m) + V(m, r), with P the probability of the bracket. The best m hardly
    moves left as a bracket's ends move right (Knuth), so that m is looked for between those of the two brackets one
    shorter, and a little beside.
    """
    summed = [0.0, *accumulate(chances)]  # summed[c + 1] - summed[b + 1]: the probability of b < least <= c
    costs: dict[tuple[int, int], float] = {}
    roots: dict[tuple[int, int], int] = {}
    for width in range(1, passed - failed + 1):
        for left in range(failed, passed - width + 1):
            right = left + width
            if _ends(summed, left, right, doubt):
                again = AGAIN if right - left > 1 else 0.0
                costs[left, right], roots[left, right] = again * (summed[right + 1] - summed[left + 1]), left + 1
                continue
            low, high = left + 1, min(right - 1, NOTHING_PASSED - 1)
            if width > 8 and not closed:
                low = max(low, roots[left, right - 1] - _BESIDE)
                high = max(low, min(high, roots[left + 1, right] + _BESIDE))
            candidates = [m for m in range(low, high + 1) if m not in closed]
            if not candidates:
                costs[left, right], roots[left, right] = 0.0, low
                continue
            best = min(candidates, key=lambda m: costs[left, m] + costs[m, right])
            costs[left, right] = summed[right + 1] - summed[left + 1] + costs[left, best] + costs[best, right]
            roots[left, right] = best
    return roots[failed, passed]


def _ends(summed: Sequence[float], left: int, right: int, doubt: float) -> bool:
    """`certain`, from summed chances."""
    if right == NOTHING_PASSED:
        return left == NOTHING_PASSED - 1
    if right - left == 1 and (left > 0 or right == 1):
        return True
    if right - left > WIDTH or left == 0:
        return False
    return summed[right - 1] - summed[left + 1] <= doubt * (summed[right + 1] - summed[left + 1])


FIRST = 45
"""The first setting: high enough to see what time no CPU shortens, and near the middle, should nothing be learnt."""

PRECISION = 0.015
"""How well the first setting's level must be known, as a part of it: all that follows rests on it."""

DOUBT = 0.1
"""The probability with which a search may end more than a point too high: what the curve allows is measured, too."""

PATIENCE = 12
"""Settings after which the search goes on by halving."""


def search_with_few_settings(history: Sequence[SearchTrial], goal: Goal) -> SearchStep:
    """The root of the optimal search tree over what is probable; ends with a measured pass and fail close together."""
    if not history:
        return Measure(reserve=FIRST, until_clear=True, precision=PRECISION)
    bracket = bracket_of(history, goal)
    match bracket:
        case NotAchievable() | NotResolved():
            return bracket
        case Bracket(passed=passed) if len(history) >= PATIENCE or (bracket.stays_above and passed is None):
            return bisect(history, goal)
        case Bracket(passed=passed, floor=floor, top=top, closed=closed):
            probabilities = _chances(questions(history, goal), floor, top, goal)
            if passed is not None and certain(probabilities, floor, passed, DOUBT, closed):
                return sufficient(history, goal, passed)
            return Measure(reserve=root(probabilities, floor, top, DOUBT, closed), until_clear=True)


def _chances(asked: Sequence[Question], failed: int, passed: int, goal: Goal) -> list[float]:
    """All questions must be answered by the reservation: its distribution is that of their largest answer."""
    below = [1.0] * (NOTHING_PASSED + 1)
    for question in asked:
        running = 0.0
        for reserve, chance in enumerate(chances(question, failed, passed, goal.processors)):
            running += chance
            below[reserve] *= running
    if not asked:
        return mixed([0.0] * (NOTHING_PASSED + 1), failed, passed)
    return [later - sooner for sooner, later in zip([0.0, *below], below, strict=False)]
