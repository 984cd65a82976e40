"""`rarms measure`: the result, a row a threshold, and the settings of a sweep or of a curve."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite, isinf
from typing import TYPE_CHECKING, assert_never

from rarms_iac.app.report_measurements import WITHOUT_APT, point_of
from rarms_iac.app.report_model import MeasuredPoint
from rarms_iac.measuring.each_load import decisive
from rarms_iac.measuring.evidence import MeasuredIndex, measured_indexes, shortfall_at
from rarms_iac.measuring.measure import MeasureOutcome
from rarms_iac.measuring.measure_request import ExperimentResult
from rarms_iac.model.commands import MEASURE, PLAN, RecommendedCommand, Wording, command, prose
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.indexes import PerformanceIndex, index_named
from rarms_iac.model.outcomes import (
    Achievement,
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
from rarms_iac.model.quantities import guaranteed
from rarms_iac.model.system import AtMost, Component, Threshold
from rarms_iac.statistics.distributions import describe_errors, describe_extreme
from rarms_iac.statistics.first_look import point_estimate, uncertain_estimates
from rarms_iac.texts.indexes import describe_uncertain, show_range, show_value
from rarms_iac.texts.messages import counted, in_a_row
from rarms_iac.texts.quantities import share_of_processors, show_percent, show_processors
from rarms_iac.views.console import paragraph, stack
from rarms_iac.views.status import describe_totals
from rarms_iac.views.table import Column, Table
from rarms_iac.views.verdicts import (
    CONDITIONAL,
    delay_sentence,
    describe_conditions,
    describe_verdict,
    share_of_threshold,
    short_bound,
    show_bound,
    skipped_sentence,
    why_not_known,
)

if TYPE_CHECKING:
    from rich.console import RenderableType

UNCERTAIN = "~"
"""Marks an estimate of the first pass that more samples may change most."""

RESULTS = (
    Column("component", wraps=True),
    Column("host", wraps=True, if_differs=True),
    Column("threshold", wraps=True),
    Column("measured", right=True),
    Column("reservation", right=True),
    Column("load", wraps=True),
)


def summary_text(outcome: MeasureOutcome, *, verbose: bool = False) -> "RenderableType":
    """Return a table with a row a threshold, the sums of each host, and what happened.

    Above it stand the settings of each sweep. The reservation stands in the first row of the components that were
    measured together.

    Args:
        outcome: of all experiments; those that an early end left out have rows, too.
        verbose: say of each reservation its CR, what is known of the setting below, and the other loads, too.
    """
    answers = [_answer(by_load) for by_load in outcome.partitions]
    rows = [row for answer in answers for row in _rows(answer.result.experiment, answer)]
    rows += [row for experiment in outcome.not_begun for row in _rows(experiment, None)]
    swept = [
        part for result in outcome.experiments if isinstance(result.conclusion, Swept) for part in sweep_text(result)
    ]
    remarks = [f"{answer.name}: {remark}" for answer in answers if (remark := answer.remark(verbose=verbose))]
    lower = [f"{answer.down_to} for {answer.name}" for answer in answers if answer.down_to]
    remarks += [f"Could be down to {', '.join(lower)}"] if lower else []
    remarks += [f"{in_a_row([each.name for each in outcome.not_begun])}: not begun"] if outcome.not_begun else []
    return stack(
        *swept,
        Table(RESULTS, rows, totals=[*(f"{remark}." for remark in remarks), *_totals(outcome, verbose=verbose)]),
        paragraph(_ending(outcome)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Answer:
    """The answer of the components of one partition, as the table and the lines below it have it."""

    result: ExperimentResult  # with the load that decides
    amount: str = "-"
    at: int | None = None  # the setting whose values are shown, in per cent
    state: str = ""  # why there is no reservation, or what is left to do
    down_to: str = ""  # the least that may be enough
    details: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        return self.result.experiment.name

    def remark(self, *, verbose: bool) -> str:
        return "; ".join(filter(None, [self.state, *(self.details if verbose else ())]))


def _answer(by_load: Sequence[ExperimentResult]) -> _Answer:
    """Judge the components of a partition. Where a plan provisionally reserves something else, that is said."""
    answer = _judged(by_load)
    is_said = isinstance(answer.result.conclusion, Stopped)
    if not is_said and (stopped := [each.interference for each in by_load if each.stopped]):
        during = f"stopped during the measurement with {in_a_row(stopped)}"
        answer = replace(answer, state="; ".join(filter(None, [answer.state, during])))
    provisional = "-" if answer.result.provisional_lp is None else show_processors(answer.result.provisional_lp)
    if provisional in {"-", answer.amount}:
        return answer
    planned = f"a plan reserves {provisional}, provisional"
    return replace(answer, state="; ".join(filter(None, [answer.state, planned])))


def _judged(by_load: Sequence[ExperimentResult]) -> _Answer:
    """Judge the components of a partition. A plan uses the curve, so where it differs both are said."""
    result, loads = decisive(by_load), _loads(by_load)
    if result.is_provisional and isinstance(result.conclusion, NotAchievable | NotResolved):
        return _Answer(result=result, state="not met at any reservation of the first pass", details=(loads,))
    match result.conclusion:
        case Sufficient(reserve=reserve) if result.is_weak:
            state = f"rejected, because the loads left processors idle; with them {_amount(result, reserve)} was enough"
            return _Answer(result=result, state=state)
        case Sufficient(reserve=reserve, failed=failed) if result.is_provisional:
            seen = f"{_amount(result, failed)} seemed too little" if failed else ""
            share = share_of_processors(reserve, result.experiment.setup.processors)
            return _Answer(result=result, amount=_amount(result, reserve), at=reserve, details=(share, seen))
        case Sufficient(reserve=reserve, failed=failed, inconclusive=inconclusive, more_settings=more):
            narrow = f"run the same command to narrow it, up to {counted(more, 'setting')} more" if more else ""
            down_to = result.conclusion.down_to
            return _Answer(
                result=result,
                amount=_amount(result, reserve),
                at=reserve,
                state="; ".join(filter(None, [_planned(result, reserve), narrow])),
                down_to=_amount(result, down_to) if down_to else "",
                details=(
                    share_of_processors(reserve, result.experiment.setup.processors),
                    _below(result, failed),
                    _inconclusive(result, inconclusive),
                    loads,
                ),
            )
        case NotAchievable(reserve=reserve):
            state = f"not achievable, not even with {_amount(result, reserve)}"
            return _Answer(result=result, at=reserve, state=state, details=(loads,))
        case NotResolved():
            state = "inconclusive"
        case SettingFailed(reserve=reserve):
            state = f"too many failed samples with {_amount(result, reserve)}"
        case Swept():
            state = ""
        case Stopped():
            at = result.planned if result.planned is not None else _provisional(result)
            amount = "-" if at is None else _amount(result, at)
            return _Answer(result=result, amount=amount, at=at, state=_stopped(result, at), details=(loads,))
        case _:
            assert_never(result.conclusion)
    return _Answer(result=result, state="; ".join(filter(None, [state, _planned(result, None)])), details=(loads,))


def _provisional(result: ExperimentResult) -> int | None:
    """Return the setting that a plan reserves by estimates, in per cent; None: none of these settings."""
    processors = result.experiment.setup.processors
    seen = (each.reserve for each in result.settings)
    return next((each for each in seen if guaranteed(each, processors) == result.provisional_lp), None)


def _stopped(result: ExperimentResult, at: int | None) -> str:
    """Say what is known of a search that did not end; without a new setting it is the answer of an earlier run."""
    if at is None:
        return "stopped"
    amount = _amount(result, at)
    if result.planned is None:
        return f"stopped; {amount} is the estimate of the settings so far"
    if result.new:
        return f"stopped; {amount} meets the threshold so far"
    return f"stopped; {amount} is from an earlier run"


def _rows(experiment: Experiment, answer: _Answer | None) -> Iterator[tuple[str, ...]]:
    """Yield a row a threshold; None: the experiment was not begun."""
    values: Mapping[tuple[str, str], MeasuredIndex] = {}
    if answer is not None and answer.at is not None:
        settings = [setting for setting in answer.result.settings if setting.reserve == answer.at]
        indexes = (each for setting in settings for each in measured_indexes(setting, experiment))
        values = {(each.component, each.index): each for each in indexes}
    conditional = set() if answer is None else {(each.component, each.index) for each in answer.result.conditions}
    amount, load = ("-", "") if answer is None else (answer.amount, answer.result.interference)
    decides = _deciding(values.values())
    for member in experiment.members:
        name = member.name
        for index, threshold in member.apt.items():
            bound = short_bound(index_named(index), threshold)
            bound += ", decides" if (member.name, index) == decides else ""
            if answer is not None and answer.result.is_provisional:
                shown = _estimated(answer, member, index)
            else:
                mark = CONDITIONAL if (member.name, index) in conditional else ""
                shown = _value(values.get((member.name, index))) + mark
            yield name, experiment.host.name, bound, shown, amount, load
            name = amount = ""
        if not member.apt:
            yield name, experiment.host.name, "none", "-", amount, load


def _deciding(values: Collection[MeasuredIndex]) -> tuple[str, str] | None:
    """Return the component and index whose safe-side bound is nearest to its threshold; None: it is the only one."""
    shares = {
        (each.component, each.index): share_of_threshold(
            each.estimate.upper if isinstance(each.threshold, AtMost) else each.estimate.lower, each.threshold
        )
        for each in values
        if each.estimate is not None and each.threshold is not None
    }
    return max(shares, key=shares.__getitem__) if len(shares) > 1 else None


def _estimated(answer: _Answer, member: Component, index: str) -> str:
    """Return the value that the first pass estimated at its answer."""
    seen = (each for each in answer.result.settings if each.reserve == answer.at)
    series = next((each for setting in seen for each in setting.series if each.component == member.name), None)
    found = None if series is None else point_estimate(index, series, answer.result.experiment.runs[member.name])
    if found is None or isinf(found.value):
        return "-"
    return show_value(index_named(index), found.value, member.apt[index]) + (UNCERTAIN if found.doubt else "")


def _value(measured: MeasuredIndex | None) -> str:
    if measured is None or measured.estimate is None:
        return "-"
    return show_value(index_named(measured.index), measured.estimate.value, measured.threshold)


def _loads(by_load: Sequence[ExperimentResult]) -> str:
    """Return the reservation for the first load alone, where a later one decides."""
    last, first = decisive(by_load), by_load[0]
    return "" if last is first or not first.reserve else f"with {first.interference} {_amount(first, first.reserve)}"


def _amount(result: ExperimentResult, reserve: int) -> str:
    return show_processors(guaranteed(reserve, result.experiment.setup.processors))


def _below(result: ExperimentResult, failed: int | None) -> str:
    """Judge the highest lower setting that was not shown to be enough."""
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
    """Name the settings without a steady state: they are neither enough nor too little."""
    return f"{in_a_row([_amount(result, reserve) for reserve in reserves])} unsteady" if reserves else ""


def _planned(result: ExperimentResult, reserve: int | None) -> str:
    planned = result.planned
    return "" if planned is None or planned == reserve else f"a plan reserves {_amount(result, planned)}"


def _totals(outcome: MeasureOutcome, *, verbose: bool) -> Iterator[str]:
    results = outcome.experiments
    for name in dict.fromkeys(result.host for result in results):
        unknown = outcome.unknown.get(name, ())
        totals = outcome.totals.get(name)
        if totals is not None and (totals.reserved_lp or not unknown):
            fixed = outcome.fixed_lp[name]
            note = f", {show_processors(fixed)} of it fixed in the manifest" if fixed and verbose else ""
            yield f"{name}: {'at least ' if unknown else ''}{describe_totals(totals)}{note}."
        if unknown:
            yield f"{name}: {why_not_known(unknown)}."
    yield from _of_first_pass(outcome)
    yield from _skipped_lines(results)
    if sentence := delay_sentence({name: heard for result in results for name, heard in result.heard_messages.items()}):
        yield sentence
    conditions = [each for by_load in outcome.partitions for each in decisive(by_load).conditions]
    extremes = {index_named(measured.index).is_extreme for measured in _concluded_indexes(results)}
    errors = describe_errors(sure=False in extremes, so_far=True in extremes)
    if sentences := " ".join(filter(None, [describe_conditions(conditions), errors])):
        yield sentences


def _of_first_pass(outcome: MeasureOutcome) -> Iterator[str]:
    """Yield which answers are provisional, and which of them are the least certain."""
    answers = [*map(decisive, outcome.partitions)]
    found = [result for result in answers if result.is_provisional and result.reserve is not None]
    names = [result.experiment.name for result in answers if result in found or result.provisional_lp is not None]
    if names:
        which = f"The reservations of {in_a_row(names)} are"
        if len(names) == len(outcome.partitions):
            which = "All reservations are"
        elif len(names) == 1:
            which = f"The reservation of {names[0]} is"
        yield f"{which} provisional: estimates of short settings, without bounds."
    uncertain = [
        each
        for result in found
        for setting in result.settings
        if setting.reserve == result.reserve
        for each in uncertain_estimates(setting.series, result.experiment.runs, result.experiment.apts)
    ]
    if uncertain:
        yield f"{UNCERTAIN} {describe_uncertain(uncertain)}"


def _ending(outcome: MeasureOutcome) -> Wording:
    """Say what was run, and the next command."""
    results = outcome.experiments
    components = counted(len({name for result in results for name in result.components}), "component")
    number, new = sum(len(result.settings) for result in results), sum(result.new for result in results)
    if outcome.stopped and not number:
        return "Stopped before the first setting had ended."
    so_far = " so far" if outcome.stopped else ""
    done = f"Measured: {components}, {counted(number, 'setting')}{so_far}{_earlier(number, number - new)}."
    following = _next(outcome)
    return done if following is None else prose(f"{done} Next: ", following)


def _earlier(number: int, recorded: int) -> str:
    """Say how many of these settings an earlier run measured; empty: none."""
    how_many = "all" if recorded == number else recorded
    return f", {how_many} of them by an earlier run" if recorded else ""


def _next(outcome: MeasureOutcome) -> RecommendedCommand | None:
    """Return the command that comes next; None: the same one, or a finding names it."""
    if outcome.stopped:
        return None
    unknown = [verdict.achievement for verdicts in outcome.unknown.values() for verdict in verdicts]
    if unknown:
        return MEASURE if Achievement.UNMEASURED in unknown else None
    if any(totals.free_lp < 0 for totals in outcome.totals.values()):
        return command("tune")
    return PLAN if any(totals.reserved_lp for totals in outcome.totals.values()) else None


def _skipped_lines(results: Sequence[ExperimentResult]) -> Iterator[str]:
    """Yield a sentence a component whose output has lines that are not samples."""
    described = {
        member.name: skipped_sentence(member, skipped)
        for result in results
        for member in result.experiment.members
        if (skipped := result.skipped_lines.get(member.name)) is not None
    }
    yield from described.values()


def _concluded_indexes(results: Sequence[ExperimentResult]) -> Iterator[MeasuredIndex]:
    """Yield those of the settings that were concluded from."""
    for result in results:
        if isinstance(result.conclusion, Sufficient | NotAchievable) and result.error is not None:
            for setting in result.settings:
                if setting.reserve == result.conclusion.reserve:
                    yield from measured_indexes(setting, result.experiment)


SWEPT = (
    Column("reservation", right=True),
    Column("CR", right=True),
    Column("measured"),
    Column("bounds", wraps=True),
    Column("verdict", wraps=True),
    Column("remark", wraps=True),
)


def sweep_text(result: ExperimentResult) -> "Iterator[RenderableType]":
    """Show a table for each performance index of the components. A setting is a row; the smallest reservation is first.

    Args:
        result: of components that were measured together with one load.
    """
    for member in result.experiment.members:
        for name in member.apt or (WITHOUT_APT,):
            yield paragraph(_heading(result, member, index_named(name)))
            rows = list(_swept_rows(result, member, index_named(name)))
            shown = len(SWEPT) if any(row[-1] for row in rows) else len(SWEPT) - 1
            yield Table(SWEPT[:shown], [row[:shown] for row in rows])
            yield ""


def _heading(result: ExperimentResult, member: Component, index: PerformanceIndex) -> str:
    """Describe the measurement: `vision with busy-loop on onboard: mean_response_time <= 50 ms.`."""
    threshold = member.apt.get(index.name)
    bound = f" {show_bound(index, threshold)}" if threshold is not None else ", no threshold"
    number = result.experiment.setup.processors
    processors = f"its {number} VP{'s' if number > 1 else ''}"
    place = f"{member.name} with {result.interference} on {result.platform}"
    return f"{place}: {index.name}{bound}. CR is per cent of {processors}."


def _swept_rows(result: ExperimentResult, member: Component, index: PerformanceIndex) -> Iterator[tuple[str, ...]]:
    threshold, run = member.apt.get(index.name), result.experiment.runs[member.name]
    apt = {} if threshold is None else {index.name: threshold}
    for setting in sorted(result.settings, key=lambda each: (each.reserve, each.seed)):
        amount = show_processors(guaranteed(setting.reserve, result.experiment.setup.processors))
        for series in setting.series:
            if series.component == member.name:
                point = point_of(setting, series, index.name, apt, run)
                yield amount, show_percent(setting.reserve), *_describe_point(index, point, threshold)


def _describe_point(
    index: PerformanceIndex, point: MeasuredPoint, threshold: Threshold | None
) -> tuple[str, str, str, str]:
    verdict = "" if point.verdict is None else describe_verdict(index, point.verdict)
    failed = f"{point.failed} of {point.samples} samples failed" if point.failed else ""
    remark = "; ".join(filter(None, (point.remark, failed)))
    if point.value is None:
        return "-", "", verdict, remark
    bounds = show_range(index, point.low, point.high, threshold)
    return show_value(index, point.value, threshold), bounds, verdict, remark


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
    return Table((*SWEPT[:2], *(Column(head, wraps=True) for head in heads)), rows)


def show_band(index: MeasuredIndex) -> str:
    """Write as `97.7 ms (97.1 to 98.2 ms)`; without an estimate, write why."""
    if index.estimate is None:
        return index.reason
    return show_estimate(index.index, index.estimate, index.threshold)


def show_estimate(name: str, estimate: Estimate, threshold: Threshold | None = None) -> str:
    """Return a value with its interval: `97.7 ms (97.1 to 98.2 ms)`.

    An extreme has what was seen, and what may lie beyond.
    """
    index = index_named(name)
    value = show_value(index, estimate.value, threshold)
    if estimate.beyond is not None:
        return f"{value} {describe_extreme(estimate.beyond)}"
    bounded = isfinite(estimate.lower) and isfinite(estimate.upper) and estimate.lower != estimate.upper
    return f"{value} ({show_range(index, estimate.lower, estimate.upper, threshold)})" if bounded else value
