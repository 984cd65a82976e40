"""The strategies that the loop can be given: a search, a list of settings, or what a curve rests on without a look."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from rarms_iac.measuring.search.bracketing import WIDTH
from rarms_iac.measuring.search.trials import (
    Goal,
    Member,
    NextStep,
    SearchTrial,
    below_demand,
    is_finished,
    not_sufficient,
    sufficient,
    trial_of,
)
from rarms_iac.measuring.setup import Experiment
from rarms_iac.model.measurement import Setting
from rarms_iac.model.outcomes import ExperimentStep, Measure, NotResolved, SearchStep, Sufficient, Swept
from rarms_iac.model.system import Threshold
from rarms_iac.statistics.curves import curves_of, least_reserve

NOTHING_FOR_SURE = "no setting that was measured meets every threshold for sure"


def goal_of(experiment: Experiment) -> Goal:
    """State what a search looks for: every APT of every member.

    Args:
        experiment: what is measured.

    Returns:
        Members with their APTs and runs, and the processors of P1.
    """
    members = tuple(
        Member(name=member.name, apt=member.apt, run=experiment.runs[member.name]) for member in experiment.members
    )
    return Goal(members=members, processors=experiment.setup.processors)


def apts_of(experiment: Experiment) -> dict[str, Mapping[str, Threshold]]:
    """List the thresholds of each member.

    Args:
        experiment: what is measured.

    Returns:
        By member, then by index.
    """
    return {member.name: member.apt for member in experiment.members}


@dataclass(slots=True, kw_only=True)
class Searching:
    """A search of `measuring.search`, kept within what the host can give."""

    goal: Goal
    next_step: NextStep
    most: int  # the highest CR that the host can give
    own_settings_only: bool = False  # it walks through settings that it asked for itself, in its own order
    _judged: dict[int, tuple[SearchTrial, bool]] = field(default_factory=dict)  # by `id` of a setting; does it count?
    _has_begun: bool = False  # what comes after the first step was measured for this goal

    def step(self, settings: Sequence[Setting]) -> SearchStep:
        # NOTE: judging a setting reads all of its samples: each is judged once.
        for setting in settings:
            if id(setting) not in self._judged:
                counts = self._has_begun or is_finished(setting, self.goal)
                self._judged[id(setting)] = trial_of(setting, self.goal), counts
        self._has_begun = True
        trials = [trial for trial, counts in (self._judged[id(setting)] for setting in settings) if counts]
        return self._replay(trials) if self.own_settings_only else self._step(trials)

    def _replay(self, trials: Sequence[SearchTrial]) -> SearchStep:
        """Say what it would ask next, had it asked for those trials that it asks for, and for no others."""
        remaining, walked = list(trials), list[SearchTrial]()
        while isinstance(step := self._step(walked), Measure):
            known = next((trial for trial in remaining if trial.reserve == step.reserve), None)
            if known is None:
                break
            remaining.remove(known)
            walked.append(known)
        return step

    def _step(self, trials: Sequence[SearchTrial]) -> SearchStep:
        step = self.next_step(trials, self.goal)
        if not isinstance(step, Measure):
            return step
        if step.reserve > self.most:  # what the host can give decides
            known = [trial for trial in trials if trial.reserve == self.most]
            if known and known[-1].passed:
                return sufficient(trials, self.most)
            if known:
                return not_sufficient(known[-1])
        # Once a setting had no steady state, an early look may see but a part of what changes.
        to_its_end = any(trial.inconclusive for trial in trials)
        reserve = min(step.reserve, self.most)
        # Within the noise at the highest reserve is no answer at all, and no other setting can give one.
        is_last_chance = reserve == self.most
        return replace(step, reserve=reserve, until_clear=step.until_clear and not to_its_end, patient=is_last_chance)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """Performance measurement mode: these settings, with any result."""

    reserves: tuple[int, ...] = ()  # in per cent; none: a coarse curve, as far as the host can give it

    def step(self, settings: Sequence[Setting]) -> ExperimentStep:
        known = {setting.reserve for setting in settings}
        return next((Measure(reserve=reserve) for reserve in self.reserves if reserve not in known), Swept())


@dataclass(frozen=True, slots=True, kw_only=True)
class ThresholdCheck:
    """Are all thresholds met at this reservation? Ends as soon as the samples tell."""

    reserve: int  # in per cent
    strategy: str = "default"  # of tuning, which asks

    def step(self, settings: Sequence[Setting]) -> ExperimentStep:
        known = any(setting.reserve == self.reserve for setting in settings)
        return Swept() if known else Measure(reserve=self.reserve, until_clear=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Verifying:
    """Measures the reservation that a curve gives between two settings, until it gives one that was measured."""

    goal: Goal
    most: int

    def step(self, settings: Sequence[Setting]) -> SearchStep:
        members = self.goal.members
        runs, apts = {member.name: member.run for member in members}, {member.name: member.apt for member in members}
        least = least_reserve(curves_of(settings, runs, apts))
        if least is None:
            return NotResolved(reason=NOTHING_FOR_SURE)
        if least.interpolated and least.reserve > self.most:
            free = f"the host has {self.most} % left for P1: what runs there is in the way"
            return NotResolved(reason=f"{least.reserve} % was looked up, and {free}")
        if least.interpolated:
            return Measure(reserve=least.reserve)
        lower = [trial_of(setting, self.goal) for setting in settings if setting.reserve < least.reserve]
        return sufficient(lower, least.reserve)


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreeing:
    """A search that ends with what a plan reserves: the least that the curve's safe side allows, measured itself.

    A setting passes by the curve's rule, but between one that fails and one that passes a point or two above it, the
    curve may allow less than the latter: that is measured, too.
    """

    search: Searching
    verifying: Verifying

    def step(self, settings: Sequence[Setting]) -> SearchStep:
        step = self.search.step(settings)
        if not isinstance(step, Sufficient):
            return step
        verified = self.verifying.step(settings)
        if not isinstance(verified, Sufficient):
            return verified
        if verified.reserve == step.reserve:
            return step
        goal = self.search.goal
        below = below_demand([trial_of(setting, goal) for setting in settings], goal)
        return _certify(verified, {setting.reserve for setting in settings}, below)


@dataclass(frozen=True, slots=True, kw_only=True)
class Confirming:
    """Shows that what other loads ask for is enough beside this one, too, or else searches the least that is."""

    goal: Goal
    floor: int  # in per cent
    search: Searching | Agreeing

    def step(self, settings: Sequence[Setting]) -> SearchStep:
        members = self.goal.members
        runs, apts = {member.name: member.run for member in members}, {member.name: member.apt for member in members}
        least = least_reserve(curves_of(settings, runs, apts))
        if least is not None and least.reserve <= self.floor:
            lower = [trial_of(setting, self.goal) for setting in settings if setting.reserve < self.floor]
            return sufficient(lower, self.floor)
        if all(setting.reserve != self.floor for setting in settings):
            return Measure(reserve=self.floor, until_clear=True)
        return self.search.step(settings)


def _certify(planned: Sufficient, known: Collection[int], below: int) -> SearchStep:
    """Ask for a measured fail close below, as a search has it: what its verdict leaves open may do on the curve.

    What is below the demand fails by arithmetic. What is known and is no fail has no steady state, or passes and is not
    believed: it is not measured once more.
    """
    if planned.reserve == 1 or planned.reserve - max(planned.failed or 0, below) <= WIDTH:
        return planned
    near = (planned.reserve - WIDTH + 1, planned.reserve - 1, planned.reserve - WIDTH)
    return next((Measure(reserve=reserve) for reserve in near if reserve >= 1 and reserve not in known), planned)
