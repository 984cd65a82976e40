"""How the settings of an experiment are chosen: by a search, a list of settings, or a question about one.

A method is what was asked for, a strategy decides on the next setting.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Protocol, assert_never

from rarms_iac.measuring.search import STRATEGIES
from rarms_iac.measuring.search.crossings import begun_before, down_to, is_known
from rarms_iac.measuring.search.first_pass import search_by_estimates
from rarms_iac.measuring.search.trials import (
    Goal,
    Member,
    SearchMethod,
    SearchTrial,
    is_clear,
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
    return Goal(
        members=members,
        processors=experiment.setup.processors,
        budget=experiment.budget,
        slow_job=experiment.slow_job,
        precision=float(experiment.precision) / 100,
    )


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


_A_LITTLE = 0.07
"""By this part the answer of the first pass is raised where it was neither shown to be enough nor to miss."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Searching:
    """A search of `measuring.search`, kept within what the host can give; it ends with what a plan reserves.

    Where other loads ask for a floor, it shows that this is enough with this load, too, or else searches above it.
    """

    goal: Goal
    decide_search: SearchMethod
    most: int  # the highest CR that the host can give
    floor: int = 0  # in per cent; 0: this is the first load
    confirms: bool = False  # whether the answer's setting goes on until its verdicts have no condition
    begin: int = 0  # the first setting, in per cent: the answer of the first pass; 0: that of the search

    def decide(self, settings: Sequence[Setting]) -> SearchDecision:
        decision = self._decide(settings)
        if self.goal.precision and isinstance(decision, Measure):
            return replace(decision, until_known=decision.reserve < self.most)  # nothing above the most may pass
        is_own = self.confirms or not isinstance(decision, Sufficient) or decision.reserve != self.floor
        if self.goal.precision and isinstance(decision, Sufficient) and is_own:
            decision = replace(decision, down_to=down_to(settings, decision, self.goal))
        if self.confirms and isinstance(decision, Sufficient) and decision.reserve <= self.most:
            answer = [setting for setting in settings if setting.reserve == decision.reserve]
            if answer and not is_clear(answer[-1], self.goal, unconditional=True):
                return Measure(reserve=decision.reserve, until_clear=True, unconditional=True)
        return decision

    def _decide(self, settings: Sequence[Setting]) -> SearchDecision:
        finished = {setting.reserve for setting in settings if self._is_finished(setting, settings)}
        judged = judge_settings(settings, self.goal)
        if self.floor and judged.least is not None and judged.least <= self.floor:
            lower = [setting for setting in settings if setting.reserve < self.floor]
            return sufficient(judge_settings(lower, self.goal).trials, self.floor)
        if self.floor and self.floor not in finished:
            return Measure(reserve=self.floor, until_clear=True, within_until=self.goal.ends_at_until)
        trials = [trial for trial in judged.trials if trial.reserve in finished]
        guess = self._guess(trials)
        decision = self.decide_search(trials, self.goal) if guess is None else guess
        can_pass = may_be_shown(trials, self.goal) or any(trial.passed for trial in trials)
        if isinstance(decision, Measure) and not can_pass:
            decision = Measure(reserve=100, until_clear=True)  # does the whole host miss? Nothing else can be shown
        decision = self._within_most(decision, trials)
        if isinstance(decision, Measure):
            return decision
        least = judged.least
        if least is None or (isinstance(decision, Sufficient) and decision.reserve == least):
            return decision
        if least not in finished:
            return Measure(reserve=least, until_clear=True, within_until=self.goal.ends_at_until)
        return sufficient(trials, least)

    def _guess(self, trials: Sequence[SearchTrial]) -> Measure | None:
        """Return the answer of the first pass as the first setting, and one a little higher where that failed."""
        if self.begin and not trials:
            return Measure(reserve=self.begin, until_clear=True)
        if len(trials) == 1 and trials[0].reserve == self.begin and trials[0].failed and not trials[0].missed:
            return Measure(reserve=self.begin + ceil(_A_LITTLE * self.begin), until_clear=True)
        return None

    def _is_finished(self, setting: Setting, settings: Sequence[Setting]) -> bool:
        before = begun_before(setting.reserve, settings)
        is_enough = setting.reserve < self.most and is_known(setting, before, self.goal, is_recorded=True)
        return is_enough or is_finished(setting, self.goal)

    def _within_most(self, decision: SearchDecision, trials: Sequence[SearchTrial]) -> SearchDecision:
        if not isinstance(decision, Measure):
            return decision
        known = [trial for trial in trials if trial.reserve == self.most]
        if decision.reserve > self.most and known:  # what the host can give decides
            return sufficient(trials, self.most) if known[-1].passed else not_sufficient(known[-1], self.goal)
        return replace(decision, reserve=min(decision.reserve, self.most), within_until=self.goal.ends_at_until)


@dataclass(frozen=True, slots=True, kw_only=True)
class Looking:
    """The search of the first pass; where later settings show an answer already, it is that."""

    goal: Goal
    most: int  # the highest CR that the host can give
    floor: int = 0  # as of `Searching`

    def decide(self, settings: Sequence[Setting]) -> SearchDecision:
        judged = judge_settings([setting for setting in settings if not setting.first_pass], self.goal)
        if judged.least is not None:
            return sufficient(judged.trials, max(judged.least, self.floor))
        return search_by_estimates(settings, self.goal, self.most, self.floor)


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

DEFAULT = "default"
"""The name of the strategy that ends within the precision of the policy. Bisection goes on to the whole per cent."""

USUAL_STEP = 10
"""Per cent between settings of the performance measurement mode, and the first of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Search:
    """Search the least reservation that meets every threshold."""

    strategy: str = DEFAULT  # a name in `STRATEGIES`
    floor: int = 0  # per cent that loads before this one ask for: less is not an answer; 0: this is the first load
    confirms: bool = False  # as of `Searching`
    begin: int = 0  # as of `Searching`


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstPass:
    """Find a provisional reservation by few short settings."""

    floor: int = 0  # as of `Searching`


Method = Search | Sweep | ThresholdCheck | FirstPass


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
        case Search(strategy=name, floor=floor, confirms=confirms, begin=begin):
            goal = replace(goal, ends_at_until=name == PAPER, precision=goal.precision if name == DEFAULT else 0.0)
            return Searching(
                goal=goal, decide_search=STRATEGIES[name], most=most, floor=floor, confirms=confirms, begin=begin
            )
        case FirstPass(floor=floor):
            return Looking(goal=goal, most=most, floor=floor)
        case _:
            assert_never(method)
