"""How the settings of an experiment are chosen: by a search, a list of settings, or a question about one.

A method is what was asked for, a strategy decides on the next setting.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, assert_never

from rarms_iac.measuring.search import STRATEGIES
from rarms_iac.measuring.search.trials import (
    Goal,
    Member,
    SearchMethod,
    SearchTrial,
    is_finished,
    judge_settings,
    may_be_shown,
    not_sufficient,
    sufficient,
)
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.outcomes import ExperimentDecision, Measure, SearchDecision, Sufficient, Swept
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.setting import Setting


def goal_of(experiment: Experiment) -> Goal:
    """State what a search looks for: every APT of every member.

    Returns:
        Members with their APTs and runs, and the processors of P1.
    """
    members = tuple(
        Member(name=member.name, apt=member.apt, run=experiment.runs[member.name]) for member in experiment.members
    )
    return Goal(members=members, processors=experiment.setup.processors, budget=experiment.budget)


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingCount:
    """Between what numbers the settings that an experiment still asks for will lie."""

    least: int
    most: int
    ends_early: bool  # a setting may end as soon as its samples tell
    goes_on: bool = False  # and it goes on until they tell, or its budget is spent


class Strategy(Protocol):
    """Which setting is next; the same settings give the same answer."""

    def decide(self, settings: Sequence[Setting]) -> ExperimentDecision:
        """Say what to do after these settings, in the order in which they were run.

        Args:
            settings: those that count for this run.

        Returns:
            The next setting, or how the experiment ends.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class Searching:
    """A search of `measuring.search`, kept within what the host can give; it ends with what a plan reserves.

    Where other loads ask for a floor, it shows that this is enough with this load, too, or else searches above it.
    """

    goal: Goal
    decide_search: SearchMethod
    most: int  # the highest CR that the host can give
    floor: int = 0  # in per cent; 0: this is the first load

    def decide(self, settings: Sequence[Setting]) -> SearchDecision:
        finished = {setting.reserve for setting in settings if is_finished(setting, self.goal)}
        judged = judge_settings(settings, self.goal)
        if self.floor and judged.least is not None and judged.least <= self.floor:
            lower = [setting for setting in settings if setting.reserve < self.floor]
            return sufficient(judge_settings(lower, self.goal).trials, self.floor)
        if self.floor and self.floor not in finished:
            return Measure(reserve=self.floor, until_clear=True, within_until=self.goal.ends_at_until)
        trials = [trial for trial in judged.trials if trial.reserve in finished]
        decision = self.decide_search(trials, self.goal)
        can_pass = may_be_shown(trials, self.goal) or any(trial.passed for trial in trials)
        if isinstance(decision, Measure) and not can_pass:
            decision = Measure(reserve=100, until_clear=True)  # does the whole host miss? Nothing else can be told
        decision = self._within_most(decision, trials)
        if isinstance(decision, Measure):
            return decision
        least = judged.least
        if least is None or (isinstance(decision, Sufficient) and decision.reserve == least):
            return decision
        if least not in finished:
            return Measure(reserve=least, until_clear=True, within_until=self.goal.ends_at_until)
        return sufficient(trials, least)

    def _within_most(self, decision: SearchDecision, trials: Sequence[SearchTrial]) -> SearchDecision:
        if not isinstance(decision, Measure):
            return decision
        known = [trial for trial in trials if trial.reserve == self.most]
        if decision.reserve > self.most and known:  # what the host can give decides
            return sufficient(trials, self.most) if known[-1].passed else not_sufficient(known[-1], self.goal)
        return replace(decision, reserve=min(decision.reserve, self.most), within_until=self.goal.ends_at_until)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """Performance measurement mode: these settings, with any result."""

    reserves: tuple[int, ...] = ()  # in per cent; none: a coarse curve, as far as the host can give it

    def decide(self, settings: Sequence[Setting]) -> ExperimentDecision:
        known = {setting.reserve for setting in settings}
        return next((Measure(reserve=reserve) for reserve in self.reserves if reserve not in known), Swept())


@dataclass(frozen=True, slots=True, kw_only=True)
class ThresholdCheck:
    """Are all thresholds met at this reservation? A question of tuning."""

    reserve: ReservePercent
    strategy: str = "default"  # of tuning, which asks


@dataclass(frozen=True, slots=True, kw_only=True)
class Checking:
    """Measures one setting, which ends as soon as the samples tell."""

    goal: Goal
    reserve: ReservePercent

    def decide(self, settings: Sequence[Setting]) -> ExperimentDecision:
        known = [setting for setting in settings if setting.reserve == self.reserve]
        if known and is_finished(known[-1], self.goal):
            return Swept()
        return Measure(reserve=self.reserve, until_clear=True, within_until=self.goal.ends_at_until)


PAPER = "paper"
"""The name of the paper's procedures in `STRATEGIES`. They assume that only P1 and P2 reserve anything."""

USUAL_STEP = 10
"""Per cent between settings of the performance measurement mode, and the first of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Search:
    """Search the least reservation that meets every threshold."""

    strategy: str = "default"  # a name in `STRATEGIES`
    floor: int = 0  # per cent that loads before this one ask for: less is no answer; 0: this is the first load


Method = Search | Sweep | ThresholdCheck


def is_of_paper(method: Method) -> bool:
    """Tell whether a search, or a question of tuning, follows the paper's procedure to the letter."""
    return isinstance(method, Search | ThresholdCheck) and method.strategy == PAPER


def reserves_of(method: Sweep, most: int) -> tuple[int, ...]:
    """Return the settings of a sweep; without settings of its own 10, 20, ... up to the highest that the host can give.

    Args:
        most: The highest CR that the host can give, in per cent; 0: none, and the first setting is refused.

    Returns:
        Whole per cent, ascending, each once. A sweep without settings of its own ends with `most`.
    """
    return method.reserves or tuple(dict.fromkeys((*range(USUAL_STEP, most + 1, USUAL_STEP), most or USUAL_STEP)))


def strategy_of(method: Method, goal: Goal, most: int) -> Strategy:
    """Return the strategy that `loop.measure_settings` asks for each next setting.

    Args:
        goal: What is measured; for a search each of its members has a threshold.
        most: The highest CR that the host can give, in per cent.
    """
    match method:
        case Sweep():
            return Sweep(reserves=reserves_of(method, most))
        case ThresholdCheck(reserve=reserve):
            return Checking(goal=replace(goal, ends_at_until=is_of_paper(method)), reserve=reserve)
        case Search(strategy=name, floor=floor):
            goal = replace(goal, ends_at_until=name == PAPER)
            return Searching(goal=goal, decide_search=STRATEGIES[name], most=most, floor=floor)
        case _:
            assert_never(method)
