"""What a search is given: the goal, the settings so far as trials, and the bracket in which the answer lies."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil

from rarms_iac.model.measurement import Setting
from rarms_iac.model.outcomes import (
    Met,
    Missed,
    NoEstimate,
    NotAchievable,
    NotResolved,
    SearchStep,
    Sufficient,
    TooFewSamples,
    TooManyFailures,
    Unsteady,
    Verdict,
    WithinNoise,
)
from rarms_iac.model.run import Periodic, Run
from rarms_iac.model.series import Series
from rarms_iac.model.system import Threshold
from rarms_iac.statistics.estimates import estimate
from rarms_iac.statistics.overload import grows_without_end
from rarms_iac.statistics.verdicts import judge_early, judge_look

NOTHING_PASSED = 101
"""As the upper end of a bracket: no setting has passed yet."""

_PRECISE_BUT_FOR = 0.025  # the error of a bound by which a mean is called precise: a guess, and no verdict

MOST_INCONCLUSIVE = 3
"""Settings without a steady state between a fail and a pass, after which nothing below them is looked for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """One component in P1 with what it must reach there."""

    name: str
    apt: Mapping[str, Threshold]
    run: Run


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """What is searched: the least CR at which all members meet their APTs."""

    members: tuple[Member, ...]
    processors: int  # VPs of P1


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchTrial:
    """A setting with the verdict on each member."""

    setting: Setting
    verdicts: Mapping[str, Verdict]

    @property
    def reserve(self) -> int:
        """The CR of the setting."""
        return self.setting.reserve

    @property
    def passed(self) -> bool:
        """Whether every member was shown to meet its APT; within the noise, the safe side is no."""
        return not self.not_shown

    @property
    def not_shown(self) -> tuple[str, ...]:
        """The members that were not shown to meet their APT."""
        return tuple(name for name, verdict in self.verdicts.items() if not isinstance(verdict, Met))

    @property
    def inconclusive(self) -> bool:
        """Whether it neither passes nor fails: nothing but a missing steady state keeps it from passing."""
        return not self.passed and all(isinstance(self.verdicts[name], Unsteady) for name in self.not_shown)

    @property
    def failed(self) -> bool:
        """Whether a member with a steady state was not shown to meet its APT, so that less is not enough either."""
        return not self.passed and not self.inconclusive

    @property
    def missed(self) -> bool:
        """Whether a member was shown to miss its APT."""
        return any(isinstance(verdict, Missed) for verdict in self.verdicts.values())


NextStep = Callable[[Sequence[SearchTrial], Goal], SearchStep]
"""A search: the trials so far, in the order in which they were run, to the next step. Pure."""


def trial_of(setting: Setting, goal: Goal) -> SearchTrial:
    """Judge a setting as when it ended, so that one read from a data log gives the same.

    A member passes by the rule that a plan takes: the safe side of every index's band meets its threshold.

    Args:
        setting: recorded.
        goal: what is searched.

    Returns:
        The setting with the verdict on each member.
    """
    return SearchTrial(
        setting=setting, verdicts={member.name: _verdict(setting, member, goal) for member in goal.members}
    )


def is_clear(
    series: Mapping[str, Series], goal: Goal, *, precision: float | None = None, patient: bool = False
) -> bool:
    """Tell whether a setting that is being measured may end now (`Measure.until_clear`).

    More samples would hardly turn what it passes by then (`trial_of`). One member that misses makes it clear;
    otherwise every member must be clear. To be asked at `next_look` counts of samples.

    Args:
        series: By component, as they will be recorded.
        goal: What is searched.
        precision: As `Measure.precision`.
        patient: As `Measure.patient`.

    Returns:
        Whether it may end.
    """
    verdicts = [
        judge_early(series[member.name], member.apt, member.run, members=len(goal.members)) for member in goal.members
    ]
    if any(isinstance(verdict, Missed) and verdict.overload for verdict in verdicts):
        return True
    if precision is not None and not all(
        _is_precise(series[member.name], member, precision) for member in goal.members
    ):
        return False
    if any(isinstance(verdict, Missed) for verdict in verdicts):
        return True
    return not any(verdict is None or (patient and isinstance(verdict, WithinNoise)) for verdict in verdicts)


def is_finished(setting: Setting, goal: Goal) -> bool:
    """Tell whether a recorded setting would have ended where it did, had it been measured for this goal.

    One that ended early because it missed another threshold may have too few samples for those of today.

    Args:
        setting: Recorded, perhaps for other thresholds.
        goal: What is searched.

    Returns:
        False: it is to be measured again, for longer.
    """
    by_component = {series.component: series for series in setting.series}
    return any(series.unsettled for series in setting.series) or is_clear(by_component, goal)


def _is_precise(series: Series, member: Member, precision: float) -> bool:
    """Whether its response times, whose mean says most to a search, are known that well; True if it shows none."""
    mean = estimate("mean_response_time", series, member.run, error=_PRECISE_BUT_FOR, unseen=False)
    return isinstance(mean, NoEstimate) or mean.upper - mean.value <= precision * mean.value


def _verdict(setting: Setting, member: Member, goal: Goal) -> Verdict:
    series = next(series for series in setting.series if series.component == member.name)
    return judge_look(series, member.apt, member.run, members=len(goal.members))


@dataclass(frozen=True, slots=True, kw_only=True)
class Bracket:
    """The highest setting that failed, or is below the demand, and the lowest that passed above it."""

    failed: int  # 0: none did
    passed: int | None
    inconclusive: tuple[int, ...] = ()  # measured between the two, and without a steady state; in their order

    @property
    def stays_above(self) -> bool:
        """Whether so many settings have no steady state that the search stays above them, on the safe side."""
        return len(self.inconclusive) >= MOST_INCONCLUSIVE

    @property
    def floor(self) -> int:
        """Below what the search does not look; 0: it looks everywhere."""
        return self.inconclusive[-1] if self.stays_above else self.failed

    @property
    def closed(self) -> frozenset[int]:
        """What it does not measure once more, between the floor and the lowest setting that passed."""
        return frozenset(reserve for reserve in self.inconclusive if reserve > self.floor)

    @property
    def highest(self) -> int:
        """The lowest setting that passed, or `NOTHING_PASSED`."""
        return NOTHING_PASSED if self.passed is None else self.passed

    @property
    def widest(self) -> tuple[int, int]:
        """The two settings next to each other with the most between them that was not measured; of equals the upper."""
        ends = (self.floor, *sorted(self.closed), self.highest)
        return max(pairwise(ends), key=lambda pair: (pair[1] - pair[0], pair))


def below_demand(history: Sequence[SearchTrial], goal: Goal) -> int:
    """Find the highest CR that is overloaded by arithmetic: the members' jobs that are due need more than it gives.

    Args:
        history: the settings so far; each shows what a job consumes.
        goal: what is searched.

    Returns:
        Per cent; 0 where nothing is known, or a member that falls behind may meet its thresholds all the same. The
        least demand that was seen counts.
    """
    demands = [
        sum(_demand_lp(member, series) for member in goal.members for series in trial.setting.series)
        for trial in history
    ]
    per_cent = 100 * min(demands, default=0.0) / goal.processors
    return min(99, max(0, ceil(per_cent) - 1))


def _demand_lp(member: Member, series: Series) -> float:
    """LPs that the jobs of a member need which are due; 0 where they are not due at certain times."""
    if series.component != member.name or not isinstance(member.run.arrival, Periodic):
        return 0.0
    if not series.cpu_ms or not any(grows_without_end(index, series, member.run) for index in member.apt):
        return 0.0
    return series.cpu_ms / len(series.samples) / float(member.run.arrival.period)


def bracket_of(history: Sequence[SearchTrial], goal: Goal) -> Bracket | NotAchievable | NotResolved:
    """Find between which settings the least sufficient CR lies; what is below the demand is no setting to measure.

    A setting that fails above one that passed (noise, near the threshold) counts against the one below: the safe side.
    One without a steady state counts for nothing: it is no verdict.

    Args:
        history: the settings so far, in any order.
        goal: what is searched.

    Returns:
        The bracket; or, where 100 % was measured and nothing passed, that there is no answer.
    """
    below = below_demand(history, goal)
    failed = max((trial.reserve for trial in history if trial.failed), default=0)
    passed = min((trial.reserve for trial in history if trial.passed and trial.reserve > failed), default=None)
    if passed is None or below < passed:  # else the samples know better
        failed = max(failed, below)
    highest = [trial for trial in history if trial.reserve == 100 and not trial.passed]
    if highest and passed is None:
        return not_sufficient(highest[-1])
    _, inconclusive = settings_below(history, NOTHING_PASSED if passed is None else passed)
    above = tuple(reserve for reserve in inconclusive if reserve > failed)
    return Bracket(failed=failed, passed=passed, inconclusive=above)


def settings_below(history: Sequence[SearchTrial], reserve: int) -> tuple[int | None, tuple[int, ...]]:
    """Find the highest lower setting that failed (None: none did), and those above it that have no steady state.

    Args:
        history: the settings so far.
        reserve: a CR in per cent.

    Returns:
        The CR that failed, and the ascending CRs without a steady state.
    """
    lower = [trial for trial in history if trial.reserve < reserve]
    failed = max((trial.reserve for trial in lower if trial.failed), default=0)
    conclusive = {trial.reserve for trial in lower if not trial.inconclusive}
    inconclusive = {trial.reserve for trial in lower if trial.reserve > failed} - conclusive
    return failed or None, tuple(sorted(inconclusive))


def sufficient(history: Sequence[SearchTrial], reserve: int) -> Sufficient:
    """Conclude that this CR, which passed, is enough, with what is known of less.

    Args:
        history: the settings so far.
        reserve: the CR in per cent.

    Returns:
        The conclusion.
    """
    failed, inconclusive = settings_below(history, reserve)
    return Sufficient(reserve=reserve, failed=failed, inconclusive=inconclusive)


def not_sufficient(highest: SearchTrial) -> NotAchievable | NotResolved:
    """Conclude from the highest CR there is, which did not pass.

    Args:
        highest: the setting of the highest CR.

    Returns:
        That it is not achievable where a member was shown to miss; otherwise why nothing was resolved.
    """
    if highest.missed:
        return NotAchievable(reserve=highest.reserve)
    members = sorted(highest.not_shown)
    described = "; ".join(f"{name} {_DESCRIPTIONS[type(highest.verdicts[name])]}" for name in members)
    return NotResolved(reason=f"at {highest.reserve} % {described}")


_DESCRIPTIONS: Mapping[type[Verdict], str] = {
    WithinNoise: "is within the noise of its threshold, and no number of samples allowed tells",
    Unsteady: "has no steady state",
    TooManyFailures: "has too many failed samples",
    TooFewSamples: "has too few samples",
}
