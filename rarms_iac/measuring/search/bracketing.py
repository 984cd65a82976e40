"""The strategies: bisection, the paper's walk, and the default, bisection guided by where the curve probably crosses.

Bisection and the walk assume only that more processor time is never worse. The default interpolates, truncates,
projects (ITP; Oliveira and Takahashi, 2020): a crossing is read off the settings so far, moved a little towards the
middle, and kept where halving could still end in time. So no falling curve takes more than `MOST` settings whose
verdicts are true; where noise turns one, or there is no steady state, halving goes on, and the loop ends it.

`crossings.py` reads the crossing off the settings.
"""

from collections.abc import Sequence
from math import ceil, floor, log2

from rarms_iac.measuring.search.crossings import Crossing, crossings_of
from rarms_iac.measuring.search.trials import Bracket, Goal, SearchTrial, bracket_of, not_sufficient, sufficient
from rarms_iac.model.outcomes import WIDTH, Measure, NotAchievable, NotResolved, SearchDecision

MOST = 8
"""Settings with true verdicts that a curve takes at most: bisection separates 1..100 % and "none" by 7, and one."""

FIRST = 45
"""The first setting: high enough to see what time no CPU shortens, and near the middle, should nothing be learnt."""

PRECISION = 0.015
"""How well the first setting's mean must be known, as a part of it: the second depends on it alone."""

_TRUNCATION = 0.0003  # points towards the middle, for each squared point of the bracket


def search_with_few_settings(history: Sequence[SearchTrial], goal: Goal) -> SearchDecision:
    """Find a passing setting and a failing one at most `WIDTH` points below, usually by at most `MOST` settings.

    Args:
        history: the settings so far, in the order in which they were run.

    Returns:
        The next setting, or how the search ends. Settings without a steady state, and verdicts that noise turned so
        that `MOST` settings were not enough, are left to halving.
    """
    if not history:
        return Measure(reserve=FIRST, until_clear=True, precision=max(PRECISION, goal.precision))
    bracket = bracket_of(history, goal)
    if not isinstance(bracket, Bracket):
        return bracket
    if bracket.inconclusive:
        return bisect(history, goal)
    failed, passed = bracket.highest_failed, bracket.upper_end
    crossings = list(crossings_of(history, goal, failed, passed))
    middle = (failed + passed) / 2
    at = max((_aim(crossing, goal) for crossing in crossings), default=middle)  # all must be met
    read_off = bool(crossings) and all(crossing.smooth for crossing in crossings) and at > passed - 2
    width = passed - failed
    if bracket.lowest_passed is not None and (
        width == 1 or (failed > 0 and width <= max(WIDTH if read_off else WIDTH - 1, int(goal.precision * passed)))
    ):
        return sufficient(history, passed)
    towards = _TRUNCATION * width**2
    chosen = ceil(min(at + towards, middle)) if at <= middle else floor(max(at - towards, middle))
    # As wide may a bracket be that halving still ends in time; what was measured for something else may have left more.
    reach = 2 ** (max(MOST - len(history), ceil(log2(width))) - 1)
    lowest, highest = max(failed + 1, passed - reach), min(passed - 1, failed + reach)
    return Measure(reserve=max(lowest, min(chosen, highest)), until_clear=True)


_MARGIN = 2 / 3  # of the precision: so far above its crossing a setting passes with few samples


def _aim(crossing: Crossing, goal: Goal) -> float:
    """Return where a setting probably passes: where its bound at its end does, and not so near that it takes long."""
    if not goal.precision:
        return crossing.at
    return max(crossing.at, crossing.likely + max(0.5, _MARGIN * goal.precision * crossing.likely))


WALK_STEP = 10


def bisect(history: Sequence[SearchTrial], goal: Goal) -> SearchDecision:
    """Halve what is left down to one point: the least passing whole per cent.

    Args:
        history: the settings so far, in the order in which they were run.

    Returns:
        The next setting, or how the search ends.
    """
    bracket = bracket_of(history, goal)
    match bracket:
        case NotAchievable() | NotResolved():
            return bracket
        case Bracket(lowest_passed=None) if bracket.stays_above:
            return Measure(reserve=100, until_clear=True)  # whether anything has a steady state
        case Bracket(lowest_passed=passed):
            low, high = bracket.widest
            if passed is not None and (high - low == 1):
                return sufficient(history, passed)
            return Measure(reserve=(low + high) // 2, until_clear=True)


def walk_by_ten(history: Sequence[SearchTrial], goal: Goal) -> SearchDecision:
    """Apply CMCPUR as the paper has it: 10, 20, ... 100 %, until the APT is met or 100 % misses it.

    Args:
        history: the settings so far; others than its own count for nothing.

    Returns:
        The next setting, or how the search ends.
    """
    own = {trial.reserve: trial for trial in history}
    for reserve in range(WALK_STEP, 101, WALK_STEP):
        if reserve not in own:
            return Measure(reserve=reserve, until_clear=True)
        if own[reserve].passed:
            return sufficient([trial for trial in history if trial.reserve % WALK_STEP == 0], reserve)
    return not_sufficient(own[100], goal)
