"""The strategies that the loop can be given: a search, a list of settings, or what a curve rests on without a look."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rarms_iac.experiments.conclusions import (
    Measure,
    NotAchievable,
    NotResolved,
    Step,
    Sufficient,
    Swept,
)
from rarms_iac.experiments.search import Goal, Member, Trial, settled, trial_of
from rarms_iac.experiments.search import values as searched
from rarms_iac.experiments.setup import Experiment
from rarms_iac.model.measurement import Series, Setting
from rarms_iac.model.system import Threshold
from rarms_iac.statistics.curve import curves_of, least_reserve


def goal_of(experiment: Experiment) -> Goal:
    """What a search looks for: every APT of every member."""
    members = tuple(Member(name=one.name, apt=one.apt, run=experiment.runs[one.name]) for one in experiment.members)
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

    def is_enough(self, asked: Measure, seen: Mapping[str, Series]) -> bool:
        """As `Strategy` says."""
        return settled(seen, self.goal, precision=asked.precision)

    def _judged(self, settings: Sequence[Setting]) -> Sequence[Trial]:
        """NOTE: settings are only ever added, and judging one reads all of its samples: each is judged once."""
        self._trials += [trial_of(one, self.goal) for one in settings[len(self._trials) :]]
        return self._trials

    def _replayed(self, trials: Sequence[Trial]) -> Step:
        """What it would ask next, had it asked for those of the trials that it asks for, and for no others."""
        left, walked = list(trials), list[Trial]()
        while isinstance(step := self._within(walked), Measure):
            known = next((one for one in left if one.reserve == step.reserve), None)
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
                return Measure(reserve=reserve, precision=precision)
            case searched.Found(reserve=reserve, failed=failed):
                return Sufficient(reserve=reserve, failed=failed, error=self.goal.error)
            case searched.NotAchievable():
                return NotAchievable(reserve=100, error=self.goal.error)
            case searched.NotResolved(why=why):
                return NotResolved(says=why)

    def _at_most(self, trials: Sequence[Trial], precision: float | None) -> Step:
        """More is asked for than the host can give: what it can give decides."""
        known = [one for one in trials if one.reserve == self.most]
        if not known:
            return Measure(reserve=self.most, precision=precision)
        if known[-1].passed:
            failed = max((one.reserve for one in trials if not one.passed and one.reserve < self.most), default=None)
            return Sufficient(reserve=self.most, failed=failed, error=self.goal.error)
        return NotAchievable(reserve=self.most, error=self.goal.error)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweeping:
    """Performance measurement mode: these settings, whatever they show."""

    reserves: tuple[int, ...]

    def step(self, settings: Sequence[Setting]) -> Step:
        """As `Strategy` says."""
        known = {one.reserve for one in settings}
        return next((Measure(reserve=one) for one in self.reserves if one not in known), Swept())

    def is_enough(self, asked: Measure, seen: Mapping[str, Series]) -> bool:  # noqa: ARG002 - `Strategy` asks so
        """Every sample that `run.until` asks for is taken."""
        return False


@dataclass(frozen=True, slots=True, kw_only=True)
class Answering:
    """One threshold question: are all APTs met at this reservation? Ends as soon as the samples tell."""

    goal: Goal
    reserve: int

    def step(self, settings: Sequence[Setting]) -> Step:
        """As `Strategy` says."""
        known = any(one.reserve == self.reserve for one in settings)
        return Swept() if known else Measure(reserve=self.reserve)

    def is_enough(self, asked: Measure, seen: Mapping[str, Series]) -> bool:
        """As `Strategy` says."""
        return settled(seen, self.goal, precision=asked.precision)


@dataclass(frozen=True, slots=True, kw_only=True)
class Verifying:
    """Measures the reservation that a curve gives between two settings, until it gives one that was measured."""

    experiment: Experiment
    most: int

    def step(self, settings: Sequence[Setting]) -> Step:
        """As `Strategy` says."""
        found = least_reserve(curves_of(settings, self.experiment.runs, apts_of(self.experiment)))
        if found is None:
            return NotResolved(says="no setting that was measured meets every threshold for sure")
        if found.interpolated and found.reserve <= self.most:
            return Measure(reserve=found.reserve)
        return Sufficient(reserve=found.reserve, failed=None, error=goal_of(self.experiment).error)

    def is_enough(self, asked: Measure, seen: Mapping[str, Series]) -> bool:  # noqa: ARG002 - `Strategy` asks so
        """Every sample that `run.until` asks for is taken."""
        return False


def apts_of(experiment: Experiment) -> dict[str, Mapping[str, Threshold]]:
    """The thresholds of each member."""
    return {one.name: one.apt for one in experiment.members}
