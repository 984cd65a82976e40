"""The search of the first pass: few short settings, judged by their estimates. Begin at `search_by_estimates`."""

from collections.abc import Sequence
from math import ceil, sqrt

from rarms_iac.measuring.search.bracketing import FIRST
from rarms_iac.measuring.search.crossings import crossings_of
from rarms_iac.measuring.search.trials import NOTHING_PASSED, Goal, SearchTrial, below_demand
from rarms_iac.model.outcomes import Measure, NotResolved, SearchDecision, Sufficient, Unsteady
from rarms_iac.model.setting import Setting
from rarms_iac.statistics.first_look import LEAST_SAMPLES, LONGEST_MS, estimated_to_meet, is_probable

_BY_MODEL, _WIDE = 3, 1.3
"""After so many settings, a bracket whose ends differ by a larger ratio is halved."""

MOST_SETTINGS = 7
"""After so many settings with a load, the least that meets the thresholds is the answer, unless the bracket is wide.

It is wide after settings for another threshold, which say nothing on lower reservations.
"""

NEAR_POINTS, NEAR_PART = 2, 0.07
"""So near a setting that misses, or by so large a part of it, the answer is near enough."""


def search_by_estimates(settings: Sequence[Setting], goal: Goal, most: int, floor: int = 0) -> SearchDecision:
    """Find a CR that meets all thresholds by its estimates, with one below that does not.

    Args:
        settings: one a reservation, in the order in which they were first measured.
        most: the highest CR that the host can give, in per cent.
        floor: what other loads ask for; less is not an answer. 0: this is the first load.

    Returns:
        The next setting, or how the pass ends.
    """
    if not settings:
        return _look(min(floor or FIRST, most))
    meets = estimated_to_meet(settings, goal.runs, goal.apts)
    failed = max((reserve for reserve, met in meets.items() if not met), default=0)
    passed = min((reserve for reserve, met in meets.items() if met and reserve > failed), default=None)
    if floor and passed is not None and passed <= floor:
        return Sufficient(reserve=floor, failed=failed or None)
    if floor not in {0, *meets} and floor > failed:
        return _look(min(floor, most))
    if failed >= most:
        return NotResolved(reason=f"no reservation up to {most} % of its VPs met the thresholds in the first pass")
    trials = [_trial(setting, goal, met=meets[setting.reserve]) for setting in settings]
    failed = max(failed, min(below_demand(trials, goal), (passed or most) - 1))
    upper = NOTHING_PASSED if passed is None else passed
    is_late = sum(setting.first_pass for setting in settings) >= MOST_SETTINGS and upper <= _WIDE * max(1, failed)
    if passed is not None and (is_late or upper - failed <= max(NEAR_POINTS, NEAR_PART * upper)):
        return Sufficient(reserve=passed, failed=failed or None)
    return _look(min(most, max(failed + 1, min(_next(trials, goal, failed, upper), upper - 1))))


def _next(trials: Sequence[SearchTrial], goal: Goal, failed: int, upper: int) -> int:
    """Return where the curve probably crosses; after some settings the middle, by ratio, which always ends."""
    middle = sqrt(max(1, failed) * upper)
    if len(trials) >= MOST_SETTINGS - 1 and upper == NOTHING_PASSED:
        return upper  # the highest shows whether anything meets them
    if len(trials) >= _BY_MODEL and upper > _WIDE * max(1, failed):
        return round(middle)
    crossings = crossings_of(trials, goal, failed, upper, of_bound=False)
    return ceil(max((crossing.at for crossing in crossings), default=middle))


def _look(reserve: int) -> Measure:
    return Measure(reserve=reserve, until_clear=True, first_pass=True)


def _trial(setting: Setting, goal: Goal, *, met: bool) -> SearchTrial:
    """Return a setting as the model of the curve takes it; it has no verdicts."""
    names = () if met else tuple(member.name for member in goal.members)
    verdicts = {member.name: Unsteady(reason="not judged in the first pass") for member in goal.members}
    return SearchTrial(setting=setting, verdicts=verdicts, not_shown=names)


def is_near_enough(setting: Setting, goal: Goal) -> bool:
    """Tell whether a setting of the first pass may end now.

    Args:
        setting: all of it so far.
    """
    if min((len(series.samples) for series in setting.series), default=0) < LEAST_SAMPLES:
        return False
    if setting.host_ms >= LONGEST_MS:
        return True
    series = {each.component: each for each in setting.series}
    return all(is_probable(series[member.name], member.apt, member.run) for member in goal.members)
