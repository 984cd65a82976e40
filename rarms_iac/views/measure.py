"""`rarms measure`: progress, the summary with a row a component, and the same for programs."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, assert_never

from rarms_iac.app.control import MeasuringReporter, RemainingSettings
from rarms_iac.measuring.findings import show_index
from rarms_iac.measuring.measure import MeasureOutcome
from rarms_iac.measuring.measure_request import ExperimentResult
from rarms_iac.measuring.performance import MeasuredIndex, indexes_of_series, measured_indexes, shortfall_at
from rarms_iac.measuring.several_loads import decisive
from rarms_iac.model.commands import Wording
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.indexes import index_named, show_bound, show_range, show_value
from rarms_iac.model.outcomes import (
    Estimate,
    Missed,
    NotAchievable,
    NotResolved,
    SettingFailed,
    Stopped,
    Sufficient,
    Swept,
    Unsteady,
)
from rarms_iac.model.quantities import ReservePercent, guaranteed, share_of_processors, show_duration, show_processors
from rarms_iac.model.series import MOST_SAMPLES, Series
from rarms_iac.model.setting import Setting
from rarms_iac.model.wording import counted, in_a_row, natural_order
from rarms_iac.statistics.error_probability import describe_errors, describe_extreme
from rarms_iac.statistics.verdicts import until_share
from rarms_iac.views.console import LiveRows, Table, paragraph, show_seconds, stack
from rarms_iac.views.prove import skipped_sentence
from rarms_iac.views.status import describe_other_claims
from rarms_iac.views.sweep import sweep_text
from rarms_iac.views.verdicts import advise_to_measure, why_not_known

if TYPE_CHECKING:
    from rich.console import RenderableType


Row = tuple[str, str, str, str, str, str]

HEADER = ("component", "threshold", "on", "reservation", "CR", "remark")


def summary_text(outcome: MeasureOutcome) -> "RenderableType":
    """Return a table with a row for each threshold of a component.

    Below it stands what the reservations add up to, and how sure they are.

    Above it stand the settings of each sweep. The reservation stands in the first row of the components that were
    measured together.

    Args:
        outcome: of all experiments; those that an early end left out have rows, too.
    """
    rows = [
        row
        for by_load in outcome.partitions
        for row in _rows(by_load[0].experiment, *_outcome(decisive(by_load), _loads(by_load)))
    ]
    rows += [row for experiment in outcome.not_begun for row in _rows(experiment, "", "-", "not begun")]
    swept = [result for result in outcome.experiments if isinstance(result.conclusion, Swept)]
    settings = [part for result in swept for part in sweep_text(result)]
    return stack(*settings, Table(rows, header=HEADER, wrap=(1, 5), right=(3,)), *map(paragraph, _totals(outcome)))


def _rows(experiment: Experiment, share: str, amount: str, remark: str) -> Iterator[Row]:
    for member in experiment.members:
        name = member.name
        bounds = [f"{index} {show_bound(index_named(index), threshold)}" for index, threshold in member.apt.items()]
        for threshold in bounds or ["none"]:
            yield name, threshold, experiment.host.platform, amount, share, remark
            name = share = amount = remark = ""


def _outcome(result: ExperimentResult, loads: str) -> tuple[str, str, str]:
    """Return the CR, its LPs, and what else is known.

    A plan uses the curve, so where it differs both are shown.
    """
    match result.conclusion:
        case Sufficient(reserve=reserve) if result.is_weak:
            remark = f"no answer: the loads left processors idle ({_amount(result, reserve)} was enough beside them)"
        case Sufficient(reserve=reserve, failed=failed, inconclusive=inconclusive, more_settings=more):
            remarks = [
                _below(result, failed),
                _inconclusive(result, inconclusive),
                _planned(result, reserve),
                loads,
                f"up to {counted(more, 'setting')} more would narrow it: run the same command" if more else "",
            ]
            share = share_of_processors(reserve, result.experiment.setup.processors)
            return share, _amount(result, reserve), ", ".join(filter(None, remarks))
        case NotAchievable(reserve=reserve):
            return "", "-", ", ".join(filter(None, [f"not achievable at {_amount(result, reserve)}", loads]))
        case NotResolved():
            remark = "not shown yet"
        case SettingFailed(reserve=reserve):
            remark = f"too many failed samples at {_amount(result, reserve)}"
        case Swept():
            remark = "measured"
        case Stopped():
            enough = "" if result.planned is None else f"{_amount(result, result.planned)} enough so far"
            return "", "-", ", ".join(filter(None, ["stopped", enough, loads]))
        case _:
            assert_never(result.conclusion)
    return "", "-", ", ".join(filter(None, [remark, _planned(result, None), loads]))


def _loads(by_load: Sequence[ExperimentResult]) -> str:
    """Which of several loads decides, and what the first one alone asks for."""
    last, first = decisive(by_load), by_load[0]
    if len(by_load) == 1 and last.of_loads == 1:
        return ""
    if last is first or not first.reserve:
        return f"beside {last.interference}"
    return f"beside {last.interference} ({first.interference} alone: {_amount(first, first.reserve)})"


def _amount(result: ExperimentResult, reserve: int) -> str:
    """Return a setting in LPs; the row has the share beside it."""
    return show_processors(guaranteed(reserve, result.experiment.setup.processors))


def _below(result: ExperimentResult, failed: int | None) -> str:
    """Return the highest lower setting that was not shown to be enough.

    That one is not yet shown to be too little.
    """
    if not failed:
        return ""
    match shortfall_at(failed, result.settings, result.experiment):
        case Missed():
            return f"{_amount(result, failed)} too little"
        case Unsteady():
            return f"{_amount(result, failed)} unsteady"
        case _:
            return f"{_amount(result, failed)} not clear"


def _inconclusive(result: ExperimentResult, reserves: Sequence[int]) -> str:
    """Those between, without a steady state: they are neither enough nor too little."""
    return f"{in_a_row([_amount(result, reserve) for reserve in reserves])} unsteady" if reserves else ""


def _planned(result: ExperimentResult, reserve: int | None) -> str:
    planned = result.planned
    return "" if planned is None or planned == reserve else f"a plan reserves {_amount(result, planned)}"


def _totals(outcome: MeasureOutcome) -> Iterator[Wording]:
    results = outcome.experiments
    for name in dict.fromkeys(result.experiment.host.name for result in results):
        here = [result for result in results if result.experiment.host.name == name]
        settings = counted(sum(len(result.settings) for result in here), "setting")
        yield (f"{name}: {_reserved_on(name, outcome)}{settings}, {sum(result.new for result in here)} of them new.")
        if unknown := outcome.unknown.get(name, ()):
            yield f"Not known: {why_not_known(unknown)}."
    yield from _skipped_lines(results)
    extremes = {index_named(measured.index).is_extreme for measured in _concluded_indexes(results)}
    if extremes:
        yield describe_errors(sure=False in extremes, so_far=True in extremes)
    if missing := advise_to_measure(each for unknown in outcome.unknown.values() for each in unknown):
        yield missing


def _skipped_lines(results: Sequence[ExperimentResult]) -> Iterator[str]:
    """Yield a sentence a component whose output has lines that are not samples."""
    described = {
        member.name: skipped_sentence(member, skipped)
        for result in results
        for member in result.experiment.members
        if (skipped := result.skipped_lines.get(member.name)) is not None
    }
    yield from described.values()


def _reserved_on(host: str, outcome: MeasureOutcome) -> str:
    if host not in outcome.totals:
        return ""
    totals, fixed = outcome.totals[host], outcome.fixed_lp[host]
    if outcome.unknown[host] and not totals.reserved_lp:
        return ""
    note = f" ({show_processors(fixed)} of it fixed in the manifest)" if fixed else ""
    least = "at least " if outcome.unknown[host] else ""
    claims = "".join(f", {text}" for text in describe_other_claims(totals.unmanaged_lp, totals.kept_lp))
    whole = show_processors(totals.host_lp)
    return f"a plan reserves {least}{show_processors(totals.reserved_lp)} of {whole} there{note}{claims}, by "


def _concluded_indexes(results: Sequence[ExperimentResult]) -> Iterator[MeasuredIndex]:
    """Those of the settings that were concluded from."""
    for result in results:
        if isinstance(result.conclusion, Sufficient | NotAchievable) and not result.is_weak:
            for setting in result.settings:
                if setting.reserve == result.conclusion.reserve:
                    yield from measured_indexes(setting, result.experiment)


def settings_text(result: ExperimentResult) -> "RenderableType":
    """Return a table, a row a setting in the order of their reservations: what a level is picked from."""
    names = [(member.name, index) for member in result.experiment.members for index in member.apt]
    heads = [f"{name} {index}" if len(result.experiment.members) > 1 else index for name, index in names]
    rows = []
    for setting in sorted(result.settings, key=lambda each: (each.reserve, each.seed)):
        indexes = {(index.component, index.index): index for index in measured_indexes(setting, result.experiment)}
        processors = result.experiment.setup.processors
        amount = show_processors(guaranteed(setting.reserve, processors))
        share = share_of_processors(setting.reserve, processors)
        rows.append((amount, share, *(show_band(indexes[name]) for name in names)))
    return Table(rows, header=("reservation", "CR", *heads), wrap=range(2, len(heads) + 2))


def show_band(index: MeasuredIndex) -> str:
    """`97.7 ms (97.1 to 98.2 ms)`; without an estimate, why."""
    return index.reason if index.estimate is None else show_estimate(index.index, index.estimate)


def show_estimate(name: str, estimate: Estimate) -> str:
    """Return a value with its interval: `97.7 ms (97.1 to 98.2 ms)`.

    An extreme has what was seen, and what may lie beyond.
    """
    index = index_named(name)
    value = show_value(index, estimate.value)
    if estimate.beyond is not None:
        return f"{value} {describe_extreme(estimate.beyond)}"
    bounded = isfinite(estimate.lower) and isfinite(estimate.upper) and estimate.lower != estimate.upper
    return f"{value} ({show_range(index, estimate.lower, estimate.upper)})" if bounded else value


BETWEEN_LINES = 30.0
"""Seconds from one line of progress to the next where nothing can be updated in place."""


class MeasuringProgress(MeasuringReporter):
    """A `MeasuringReporter` that writes to a person.

    Args:
        say: writes a line for good.
        clock: seconds, from any start.
        live: the table that is updated in place; None: lines are written, at most one in `BETWEEN_LINES`.
    """

    def __init__(
        self, say: Callable[["RenderableType"], None], clock: Callable[[], float], live: LiveRows | None = None
    ) -> None:
        self._say = say
        self._clock = clock
        self._live = live
        self._began = 0.0
        self._remaining: RemainingSettings | None = None
        self._said = clock()

    def experiment_started(self, experiment: Experiment, recorded: tuple[Setting, ...]) -> None:
        """Show nothing yet: the first setting names what is measured."""

    def setting_started(self, experiment: Experiment, reserve: int, remaining: RemainingSettings | None) -> None:
        """Show the running setting where it can be updated."""
        self._began, self._remaining = self._clock(), remaining
        if self._live is not None:
            self._live.show((_subject(experiment), _setting(experiment, reserve), "..."))

    def samples_came(self, experiment: Experiment, reserve: int, seen: Mapping[str, Series]) -> None:
        """Show how many samples there are, what they come to, and how long it may yet take."""
        if self._live is not None:
            values = brief(indexes_of_series(experiment.members, seen), several=len(experiment.members) > 1)
            progress = f"{samples_of(seen)}, {values}{self._time_left(experiment, reserve, seen)}"
            self._live.show((_subject(experiment), _setting(experiment, reserve), progress))

    def setting_ended(self, experiment: Experiment, setting: Setting, remaining: RemainingSettings | None) -> None:
        """Say what was measured there and how long the rest takes, where the last line is long ago."""
        now = self._clock()
        if self._live is not None or now - self._said < BETWEEN_LINES:
            return
        self._said = now
        series = {series.component: series for series in setting.series}
        several = len(experiment.members) > 1
        values = "; ".join(
            f"{index.component} {show_index(index)}" if several else show_index(index)
            for index in measured_indexes(setting, experiment)
        )
        took = show_seconds(now - self._began)
        done = f"{samples_of(series)}, {values or 'measured'}, in {took}{_describe_remaining(remaining)}"
        self._say(paragraph(f"{_subject(experiment)} at {_setting(experiment, setting.reserve)}: {done}"))

    def setting_disturbed(self, experiment: Experiment, reserve: int, reason: str) -> None:
        """Say that it is measured again, why, and what that adds to the time that was said before."""
        subject = f"{_subject(experiment)} at {_setting(experiment, reserve)}"
        now = self._clock()
        took, self._began = now - self._began, now
        adds = f" This adds about {show_seconds(took)}." if took >= 1 else ""
        self._say(paragraph(f"{subject} is measured again, because it was disturbed: {reason}.{adds}"))

    def proof_samples_came(self, host: str, load: str | None, seen: Mapping[str, Series]) -> None:
        """Show how many samples there are of each component."""
        if self._live is not None:
            named = sorted(seen.items(), key=lambda each: natural_order(each[0]))
            samples = ", ".join(f"{name} {len(series.samples)}" for name, series in named)
            self._live.show((f"{host} beside {load or 'no load'}", f"samples of {samples}"))

    def experiment_ended(self) -> None:
        """Leave no half line behind; what came of it stands in the summary."""
        if self._live is not None:
            self._live.hide()

    def _time_left(self, experiment: Experiment, reserve: ReservePercent, series: Mapping[str, Series]) -> str:
        """Of the experiment, as the command's settings took so far; with the first one, of that setting."""
        took = self._clock() - self._began
        if self._remaining is not None:
            return _describe_remaining(self._remaining, took)
        done = share_done(experiment, reserve, series)
        if not 0 < done < 1 or took < 1:
            return ""
        return f", at most {show_seconds(took * (1 - done) / done)} left"


def _describe_remaining(remaining: RemainingSettings | None, took: float = 0.0) -> str:
    """`, 12 s to about 40 s left`; nothing where that is not known, or nothing is left.

    A setting that takes longer than those before may end at once.
    """
    if remaining is None:
        return ""
    of_this = min(took, remaining.setting_seconds)
    least, most = (1000 * (count * remaining.setting_seconds - of_this) for count in (remaining.least, remaining.most))
    if most <= 0:
        return ""
    if least <= 0:
        return f", at most about {show_duration(most)} left"
    if remaining.least == remaining.most:
        return f", about {show_duration(most)} left"
    return f", {show_duration(least)} to about {show_duration(most)} left"


def share_done(experiment: Experiment, reserve: ReservePercent, series: Mapping[str, Series]) -> float:
    """Return how much of the longest that a setting may take is done, 1 at its end."""
    budget_ms = experiment.budget.at(reserve)
    return min(
        min(1.0, until_share(seen, run.ends), max(len(seen.samples) / MOST_SAMPLES, seen.elapsed_ms / budget_ms))
        for seen, run in ((series[name], run) for name, run in experiment.runs.items())
    )


def samples_of(by_component: Mapping[str, Series]) -> str:
    """`143 samples`; of several components the fewest."""
    return counted(min((len(series.samples) for series in by_component.values()), default=0), "sample")


def brief(indexes: Sequence[MeasuredIndex], *, several: bool = False) -> str:
    """Return the values alone: `mean_response_time 94.1 ms`; of several components `vision 94.1 ms`."""
    values = [
        f"{index.component if several else index.index} {show_value(index_named(index.index), index.estimate.value)}"
        for index in indexes
        if index.estimate is not None
    ]
    return ", ".join(values) or "nothing to tell yet"


def _subject(experiment: Experiment) -> str:
    return f"{experiment.name} beside {experiment.setup.interference}"


def _setting(experiment: Experiment, reserve: int) -> str:
    return show_processors(guaranteed(reserve, experiment.setup.processors))
