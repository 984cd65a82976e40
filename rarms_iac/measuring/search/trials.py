"""What a search is given: the goal, the settings so far as trials, and the bracket in which the answer lies."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, inf

from rarms_iac.model.experiment import Budget
from rarms_iac.model.outcomes import (
    Condition,
    JudgedIndex,
    Met,
    Missed,
    NoEstimate,
    NotAchievable,
    NotResolved,
    SearchDecision,
    Sufficient,
    TooFewSamples,
    TooManyFailures,
    Unsteady,
    Verdict,
    WithinNoise,
)
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.run import Elapsed, Periodic, Run, SampleCount
from rarms_iac.model.series import MOST_SAMPLES, Series
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import Threshold
from rarms_iac.statistics.conditions import conditions_of, more_samples_lift
from rarms_iac.statistics.curves import curves_of, holds, least_reserve
from rarms_iac.statistics.distributions import FIRST_LOOK, samples_needed
from rarms_iac.statistics.estimates import estimate
from rarms_iac.statistics.overload import grows_without_end
from rarms_iac.statistics.verdicts import judge_early, judge_look, samples_to_clear, until_share

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
    """The goal of a search: the least CR at which all members meet their APTs."""

    members: tuple[Member, ...]
    processors: int  # VPs of P1
    budget: Budget = Budget()  # of a setting
    ends_at_until: bool = False  # a setting ends at `run.until` at the latest, clear or not
    slow_job: int = 1  # as of `policy.measuring`
    precision: float = 0.0  # how much less may be enough, as a part of the answer; 0: no setting ends because of it

    @property
    def apts(self) -> dict[str, Mapping[str, Threshold]]:
        """The thresholds by member, then by index."""
        return {member.name: member.apt for member in self.members}

    @property
    def runs(self) -> dict[str, Run]:
        """How each member runs."""
        return {member.name: member.run for member in self.members}


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchTrial:
    """A setting with the verdict on each member."""

    setting: Setting
    verdicts: Mapping[str, Verdict]  # by member, on this setting alone
    not_shown: tuple[str, ...]  # members that the curve does not show to meet their APT here

    @property
    def reserve(self) -> ReservePercent:
        """The CR of the setting."""
        return self.setting.reserve

    @property
    def passed(self) -> bool:
        """Whether every member was shown to meet its APT; if that is inconclusive, no."""
        return not self.not_shown

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


SearchMethod = Callable[[Sequence[SearchTrial], Goal], SearchDecision]
"""A search: the trials so far, in the order in which they were run, to the next step. Pure."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """Settings as a plan judges them."""

    trials: tuple[SearchTrial, ...]  # one a setting, in their order
    least: ReservePercent | None  # the least CR that they show to be enough; None: they show none


def judge_settings(settings: Sequence[Setting], goal: Goal) -> Judged:
    """Judge settings as a plan does, so that those read from a data log give the same as when they were measured.

    A member passes where the safe side of every index's curve meets its threshold: where this setting shows it, or one
    with less CPU does and none with more contradicts.

    Args:
        settings: one a reservation, in the order in which they were first measured.
    """
    curves = curves_of(settings, goal.runs, goal.apts)

    def is_shown(member: Member, reserve: ReservePercent) -> bool:
        own = [(curve, threshold) for curve, threshold in curves if curve.component == member.name]
        return bool(own) and all(holds(curve, threshold, reserve) for curve, threshold in own)

    trials = tuple(
        SearchTrial(
            setting=setting,
            verdicts={member.name: _verdict(setting, member, goal) for member in goal.members},
            not_shown=tuple(member.name for member in goal.members if not is_shown(member, setting.reserve)),
        )
        for setting in settings
    )
    return Judged(trials=trials, least=least_reserve(curves))


def is_clear(setting: Setting, goal: Goal, *, precision: float | None = None, unconditional: bool = False) -> bool:
    """Tell whether a setting that is being measured may end now (`Measure.until_clear`), or has ended.

    It may once it has `run.until` (absent: `FIRST_LOOK` samples) of each member, and one member misses or every one is
    clear; or where its budget is spent, it holds `MOST_SAMPLES`, or the rest of these would hardly make it clear.

    Args:
        setting: All of its reservation so far, as it will be recorded.

    Returns:
        Whether it may end.
    """
    members = {member.name: member for member in goal.members}
    seen = [(members[series.component], series) for series in setting.series if series.component in members]
    done = [done_share(series, setting.reserve, member.run, setting.host_ms, goal) for member, series in seen]
    if min(done) >= 1.0:
        return True
    if not all(_is_begun(series, member.run, goal) for member, series in seen):
        return False
    verdicts = [
        judge_early(
            series,
            member.apt,
            member.run,
            done=part,
            members=len(goal.members),
            most_samples=_most_samples(series, setting, goal),
        )
        for (member, series), part in zip(seen, done, strict=True)
    ]
    if any(isinstance(verdict, Missed) and verdict.overload for verdict in verdicts):
        return True
    if precision is not None and not all(_is_precise(series, member, precision) for member, series in seen):
        return False
    if any(isinstance(verdict, Missed) for verdict in verdicts):
        return True
    if None in verdicts:
        return False
    return not unconditional or not any(
        isinstance(verdict, Met)
        and more_samples_lift(
            verdict.judged, series, member.run, goal.slow_job, samples=_most_samples(series, setting, goal)
        )
        for (member, series), verdict in zip(seen, verdicts, strict=True)
    )


def conditions_at(settings: Sequence[Setting], goal: Goal, reserve: ReservePercent) -> tuple[Condition, ...]:
    """Return the conditions on which thresholds are met at a reservation, by the curves that settings make."""
    found: list[Condition] = []
    series = {each.component: each for setting in settings if setting.reserve == reserve for each in setting.series}
    for curve, threshold in curves_of(settings, goal.runs, goal.apts):
        estimated, point = curve.estimate_at(reserve), curve.value_at(reserve)
        if estimated is not None and point is not None:
            bounded = replace(estimated, lower=point.lower, upper=point.upper)
            judged = JudgedIndex(index=curve.index, threshold=threshold, estimate=bounded)
            run = goal.runs[curve.component]
            found += conditions_of([judged], series[curve.component], run, goal.slow_job)
    return tuple(found)


def is_finished(setting: Setting, goal: Goal) -> bool:
    """Tell whether a recorded setting would have ended where it did, had it been measured for this goal.

    Args:
        setting: All that counts of its reservation, perhaps measured for other thresholds.

    Returns:
        False: it is measured further before it says anything.
    """
    return not setting.has_verdict or is_clear(setting, goal)


def done_share(series: Series, reserve: ReservePercent, run: Run, host_ms: float, goal: Goal) -> float:
    """Say how much of what it will have at its end a setting has.

    Args:
        series: of one member, with a sample at least.
        host_ms: the host's time that the setting took so far.
        goal: says its budget, and whether it ends at `run.until`.

    Returns:
        The part of its samples: more than 0, and 1 where it has ended.
    """
    if goal.ends_at_until:
        return min(1.0, until_share(series, run.ends))
    by_budget = max(len(series.samples) / MOST_SAMPLES, host_ms / goal.budget.at(reserve))
    return min(1.0, by_budget if run.until is None else min(by_budget, until_share(series, run.until)))


def _most_samples(series: Series, setting: Setting, goal: Goal) -> float:
    """Return the number of samples that the rest of the budget may bring at the speed so far."""
    if goal.ends_at_until or series.elapsed_ms <= 0.0:
        return inf
    return len(series.samples) * (1.0 + max(0.0, goal.budget.at(setting.reserve) - setting.host_ms) / series.elapsed_ms)


def may_be_shown(history: Sequence[SearchTrial], goal: Goal) -> bool:
    """Tell whether a setting may hold the samples by which thresholds are shown to be met, at whichever CR.

    Args:
        history: the settings so far; each shows what a job consumes.

    Returns:
        False: no setting can pass within its budget, since jobs come no faster than they are due, or than all of P1's
            processors serve them.
    """
    return goal.ends_at_until or all(
        samples_needed(index, threshold) <= _most_samples_at_any_reserve(member, history, goal)
        for member in goal.members
        for index, threshold in member.apt.items()
    )


def _most_samples_at_any_reserve(member: Member, history: Sequence[SearchTrial], goal: Goal) -> float:
    until, arrival, lasts_ms = member.run.until, member.run.arrival, goal.budget.most_ms
    own = [series for trial in history for series in trial.setting.series if series.component == member.name]
    known = [len(series.samples) for series in own]
    served_ms = [(series.cpu_ms or 0.0) / goal.processors / max(1, len(series.samples)) for series in own]
    between_ms = float(arrival.period) if isinstance(arrival, Periodic) else min(served_ms, default=0.0)
    if isinstance(until, Elapsed):
        lasts_ms = max(lasts_ms, float(until.time))
    elif isinstance(until, SampleCount):
        known.append(until.samples)
    return min(MOST_SAMPLES, max(known, default=0) + (lasts_ms / between_ms if between_ms else inf))


def _is_begun(series: Series, run: Run, goal: Goal) -> bool:
    if goal.ends_at_until or run.until is None:
        return len(series.samples) >= FIRST_LOOK
    return until_share(series, run.until) >= 1.0


def _is_precise(series: Series, member: Member, precision: float) -> bool:
    """Return whether the mean response time is known to this precision; True if there are no response times."""
    mean = estimate("mean_response_time", series, member.run, error=_PRECISE_BUT_FOR, unseen=False)
    return isinstance(mean, NoEstimate) or mean.upper - mean.value <= precision * mean.value


def _verdict(setting: Setting, member: Member, goal: Goal) -> Verdict:
    series = next(series for series in setting.series if series.component == member.name)
    return judge_look(series, member.apt, member.run, members=len(goal.members))


@dataclass(frozen=True, slots=True, kw_only=True)
class Bracket:
    """The highest setting that failed, or is below the demand, and the lowest that passed above it."""

    highest_failed: int  # 0: none did
    lowest_passed: int | None
    inconclusive: tuple[int, ...] = ()  # measured between the two, and without a steady state; in their order

    @property
    def stays_above(self) -> bool:
        """Whether so many settings have no steady state that the search stays above them, on the safe side."""
        return len(self.inconclusive) >= MOST_INCONCLUSIVE

    @property
    def floor(self) -> int:
        """Below what the search does not look; 0: it looks everywhere."""
        return self.inconclusive[-1] if self.stays_above else self.highest_failed

    @property
    def closed(self) -> frozenset[int]:
        """What it does not measure once more, between the floor and the lowest setting that passed."""
        return frozenset(reserve for reserve in self.inconclusive if reserve > self.floor)

    @property
    def upper_end(self) -> int:
        """The lowest setting that passed, or `NOTHING_PASSED`."""
        return NOTHING_PASSED if self.lowest_passed is None else self.lowest_passed

    @property
    def widest(self) -> tuple[int, int]:
        """The two settings next to each other with the most between them that was not measured; of equals the upper."""
        ends = (self.floor, *sorted(self.closed), self.upper_end)
        return max(pairwise(ends), key=lambda pair: (pair[1] - pair[0], pair))


def below_demand(history: Sequence[SearchTrial], goal: Goal) -> int:
    """Find the highest CR that is overloaded by arithmetic: the members' jobs that are due need more than it gives.

    Args:
        history: the settings so far; each shows what a job consumes.

    Returns:
        Per cent of each of the partition's VPs; 0 where nothing is known, or a member that falls behind may meet its
        thresholds all the same. The least demand that was seen counts.
    """
    demands = [
        sum(_demand_lp(member, series) for member in goal.members for series in trial.setting.series)
        for trial in history
    ]
    per_cent = 100 * min(demands, default=0.0) / goal.processors
    return min(99, max(0, ceil(per_cent) - 1))


def _demand_lp(member: Member, series: Series) -> float:
    """Return the LPs that a member's periodic jobs need; 0 if its jobs have no fixed release times."""
    if series.component != member.name or not isinstance(member.run.arrival, Periodic):
        return 0.0
    if not series.cpu_ms or not any(grows_without_end(index, series, member.run) for index in member.apt):
        return 0.0
    return series.cpu_ms / len(series.samples) / float(member.run.arrival.period)


def bracket_of(history: Sequence[SearchTrial], goal: Goal) -> Bracket | NotAchievable | NotResolved:
    """Find between which settings the least sufficient CR lies; what is below the demand is not a setting to measure.

    A setting that fails above one that passed (noise, near the threshold) counts against the one below: the safe side.
    One without a steady state counts for nothing: it is not a verdict.

    Args:
        history: the settings so far, in any order.

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
        return not_sufficient(highest[-1], goal)
    _, inconclusive = settings_below(history, NOTHING_PASSED if passed is None else passed)
    above = tuple(reserve for reserve in inconclusive if reserve > failed)
    return Bracket(highest_failed=failed, lowest_passed=passed, inconclusive=above)


def settings_below(history: Sequence[SearchTrial], reserve: ReservePercent) -> tuple[int | None, tuple[int, ...]]:
    """Find the highest lower setting that failed (None: none did), and those above it that have no steady state.

    Returns:
        The CR that failed, and the ascending CRs without a steady state.
    """
    lower = [trial for trial in history if trial.reserve < reserve]
    failed = max((trial.reserve for trial in lower if trial.failed), default=0)
    conclusive = {trial.reserve for trial in lower if not trial.inconclusive}
    inconclusive = {trial.reserve for trial in lower if trial.reserve > failed} - conclusive
    return failed or None, tuple(sorted(inconclusive))


def sufficient(history: Sequence[SearchTrial], reserve: ReservePercent) -> Sufficient:
    """Conclude that this CR, which passed, is enough, with what is known of less.

    Returns:
        The conclusion.
    """
    failed, inconclusive = settings_below(history, reserve)
    return Sufficient(reserve=reserve, failed=failed, inconclusive=inconclusive)


def conclude(settings: Sequence[Setting], goal: Goal, most_settings: int) -> Sufficient | NotResolved:
    """Conclude from the settings there are, before the search has its end.

    Args:
        most_settings: so many the same search may take next time.

    Returns:
        That the least CR which they show to be enough is; or that they show none. `more_settings` says how many may
            follow: no more than there are whole per cents below that are not known to be too little.
    """
    judged = judge_settings(settings, goal)
    least = judged.least
    if least is None:
        return NotResolved(
            reason=f"none of its {len(settings)} settings was shown to be enough", more_settings=most_settings
        )
    end = sufficient(judged.trials, least)
    return replace(end, more_settings=max(1, min(most_settings, least - 1 - (end.failed or 0))))


def not_sufficient(highest: SearchTrial, goal: Goal) -> NotAchievable | NotResolved:
    """Conclude from the highest CR there is, which did not pass.

    Args:
        highest: the setting of the highest CR.

    Returns:
        That it is not achievable where a member was shown to miss; otherwise why nothing was resolved.
    """
    if highest.missed:
        return NotAchievable(reserve=highest.reserve)
    members = sorted(highest.not_shown)
    described = "; ".join(
        f"{name} {_DESCRIPTIONS.get(type(highest.verdicts[name]), _DESCRIPTIONS[WithinNoise])}" for name in members
    )
    member, samples = _samples_to_clear(highest)
    return NotResolved(
        reason=f"at {highest.reserve} % of its VPs {described}",
        member=member,
        samples=samples,
        ends_at_until=goal.ends_at_until,
    )


def _samples_to_clear(trial: SearchTrial) -> tuple[str, int | None]:
    """Return the member that the setting has to be measured longest for, and with how many of its samples all is clear.

    At most one sample more than a setting may have; None: unknown.
    """
    needed = [
        (each.component, samples_to_clear(judged, each), len(each.samples))
        for each in trial.setting.series
        if isinstance(verdict := trial.verdicts[each.component], WithinNoise)
        for judged in verdict.judged
    ]
    known = [(count / seen, count, member) for member, count, seen in needed if count is not None and seen]
    if not known or len(known) < len(needed):
        return "", None
    _, count, member = max(known)
    return member, ceil(min(count, MOST_SAMPLES + 1))


_DESCRIPTIONS: Mapping[type[Verdict], str] = {
    WithinNoise: "neither met nor missed its threshold with 99 % confidence",
    Unsteady: "did not reach a steady state",
    TooManyFailures: "has too many failed samples",
    TooFewSamples: "has too few samples",
}
