"""The strategies that the loop can be given: a search, a list of settings, or what a curve rests on without a look."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from rarms_iac.measuring.conclusions import (
    Measure,
    NotAchievable,
    NotResolved,
    Step,
    Sufficient,
    Swept,
)
from rarms_iac.measuring.search import Goal, Member, Trial, settled, trial_of
from rarms_iac.measuring.search import values as searched
from rarms_iac.measuring.search.bracket import below, not_met
from rarms_iac.measuring.search.tree import WIDTH
from rarms_iac.measuring.setup import Experiment
from rarms_iac.model.measurement import Setting
from rarms_iac.model.system import Threshold
from rarms_iac.statistics.curves import curves_of, least_reserve


def goal_of(experiment: Experiment) -> Goal:
    """What a search looks for: every APT of every member."""
    members = tuple(
        Member(name=member.name, apt=member.apt, run=experiment.runs[member.name]) for member in experiment.members
    )
    return Goal(members=members, processors=experiment.setup.processors)


@dataclass(slots=True, kw_only=True)
class Searching:
    """A strategy of `experiments.search`, kept within what the host can give."""

    goal: Goal
    next_step: searched.Strategy
    most: int  # the highest CR that the host can give
    only_its_own: bool = False  # it walks through settings that it asked for itself, in its own order
    _trials: list[Trial] = field(default_factory=list)

    def step(self, settings: Sequence[Setting]) -> Step:
        """As `Strategy` says."""
        trials = self._judged(settings)
        return self._replayed(trials) if self.only_its_own else self._within(trials)

    def _judged(self, settings: Sequence[Setting]) -> Sequence[Trial]:
        """NOTE: settings are only ever added, and judging one reads all of its samples: each is judged once."""
        self._trials += [trial_of(setting, self.goal) for setting in settings[len(self._trials) :]]
        return self._trials

    def _replayed(self, trials: Sequence[Trial]) -> Step:
        """What it would ask next, had it asked for those of the trials that it asks for, and for no others."""
        left, walked = list(trials), list[Trial]()
        while isinstance(step := self._within(walked), Measure):
            known = next((trial for trial in left if trial.reserve == step.reserve), None)
            if known is None:
                break
            left.remove(known)
            walked.append(known)
        return step

    def _within(self, trials: Sequence[Trial]) -> Step:
        step = self.next_step(trials, self.goal)
        match step:
            case searched.Measure(reserve=reserve, precision=precision) if reserve > self.most:
                return self._at_most(trials, precision)
            case searched.Measure(reserve=reserve, precision=precision):
                return self._measure(trials, reserve, precision)
            case searched.Found(reserve=reserve):
                return _sufficient(self.goal, trials, reserve)
            case searched.NotAchievable():
                return NotAchievable(reserve=100, error=self.goal.error)
            case searched.NotResolved(why=why):
                return NotResolved(says=why)

    def _measure(self, trials: Sequence[Trial], reserve: int, precision: float | None) -> Measure:
        """Until it is settled, or to its end: once a setting had no steady state, an early look may see but a part."""
        if any(trial.untold for trial in trials):
            return Measure(reserve=reserve)
        return Measure(reserve=reserve, settled=partial(settled, goal=self.goal, precision=precision))

    def _at_most(self, trials: Sequence[Trial], precision: float | None) -> Step:
        """More is asked for than the host can give: what it can give decides."""
        known = [trial for trial in trials if trial.reserve == self.most]
        if not known:
            return self._measure(trials, self.most, precision)
        if known[-1].passed:
            return _sufficient(self.goal, trials, self.most)
        match not_met(known[-1]):
            case searched.NotAchievable():
                return NotAchievable(reserve=self.most, error=self.goal.error)
            case searched.NotResolved(why=why):
                return NotResolved(says=why)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweeping:
    """Performance measurement mode: these settings, whatever they show."""

    reserves: tuple[int, ...]

    def step(self, settings: Sequence[Setting]) -> Step:
        """As `Strategy` says."""
        known = {setting.reserve for setting in settings}
        return next((Measure(reserve=reserve) for reserve in self.reserves if reserve not in known), Swept())


@dataclass(frozen=True, slots=True, kw_only=True)
class Answering:
    """One threshold question: are all APTs met at this reservation? Ends as soon as the samples tell."""

    goal: Goal
    reserve: int

    def step(self, settings: Sequence[Setting]) -> Step:
        """As `Strategy` says."""
        known = any(setting.reserve == self.reserve for setting in settings)
        if known:
            return Swept()
        return Measure(reserve=self.reserve, settled=partial(settled, goal=self.goal, precision=None))


@dataclass(frozen=True, slots=True, kw_only=True)
class Verifying:
    """Measures the reservation that a curve gives between two settings, until it gives one that was measured."""

    goal: Goal
    most: int

    def step(self, settings: Sequence[Setting]) -> Step:
        """As `Strategy` says."""
        members = self.goal.members
        curves = curves_of(
            settings, {member.name: member.run for member in members}, {member.name: member.apt for member in members}
        )
        found = least_reserve(curves)
        if found is None:
            return NotResolved(says=NOTHING_FOR_SURE)
        if found.interpolated and found.reserve > self.most:
            left = f"the host has {self.most} % left for P1: what runs there is in the way"
            return NotResolved(says=f"{found.reserve} % was looked up, and {left}")
        if found.interpolated:
            return Measure(reserve=found.reserve)
        lower = [trial_of(setting, self.goal) for setting in settings if setting.reserve < found.reserve]
        return _sufficient(self.goal, lower, found.reserve)


def _sufficient(goal: Goal, trials: Sequence[Trial], reserve: int) -> Sufficient:
    """That it is enough, with what is known of less."""
    failed, untold = below(trials, reserve)
    return Sufficient(reserve=reserve, failed=failed, error=goal.error_of_passing, untold=untold)


NOTHING_FOR_SURE = "no setting that was measured meets every threshold for sure"


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreeing:
    """A search that ends with what a plan reserves: the least that the curve's safe side allows, measured itself.

    A setting passes by the curve's rule, but between one that fails and one that passes a point or two above it, the
    curve may allow less than the latter: that is measured, too.
    """

    search: Searching
    verifying: Verifying

    def step(self, settings: Sequence[Setting]) -> Step:
        """As `Strategy` says."""
        step = self.search.step(settings)
        if not isinstance(step, Sufficient):
            return step
        match self.verifying.step(settings):
            case Sufficient() as planned:
                known = {setting.reserve for setting in settings}
                return step if planned.reserve == step.reserve else _certified(planned, known)
            case other:
                return other


def _certified(planned: Sufficient, known: Collection[int]) -> Step:
    """With a measured fail close below, as a search has it: what its verdict leaves open may do on the curve.

    What is known and is no fail has no steady state, or passes and is not believed: it is not measured once more.
    """
    if planned.reserve == 1 or planned.reserve - (planned.failed or 0) <= WIDTH:
        return planned
    near = (planned.reserve - WIDTH + 1, planned.reserve - 1, planned.reserve - WIDTH)
    return next((Measure(reserve=one) for one in near if one >= 1 and one not in known), planned)


def apts_of(experiment: Experiment) -> dict[str, Mapping[str, Threshold]]:
    """The thresholds of each member."""
    return {member.name: member.apt for member in experiment.members}
