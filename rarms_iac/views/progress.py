"""What is shown while components run: each setting of a measurement, and each sample of `rarms run` as it happens."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

from rarms_iac.app.control import FinishedUnit, MeasuringReporter, RemainingSettings, WorkBegun
from rarms_iac.measuring.duration import forecast
from rarms_iac.measuring.evidence import MeasuredIndex, indexes_of_series, measured_indexes
from rarms_iac.measuring.findings import show_index
from rarms_iac.measuring.run_component import ComponentRunResult, SampleReporter
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.indexes import index_named
from rarms_iac.model.outcomes import Estimate, NoEstimate, verdict_word
from rarms_iac.model.quantities import ReservePercent, guaranteed
from rarms_iac.model.series import MOST_SAMPLES, Sample, Series
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import Threshold
from rarms_iac.running.reading import describe_skipped
from rarms_iac.running.samples import SamplingEnd
from rarms_iac.statistics.verdicts import until_share
from rarms_iac.texts.indexes import short_name, show_value
from rarms_iac.texts.messages import STREAM_NAMES, counted, natural_order
from rarms_iac.texts.quantities import show_bytes, show_duration, show_number, show_processors
from rarms_iac.views.console import paragraph, show_seconds, stack, visible
from rarms_iac.views.measure import show_estimate
from rarms_iac.views.table import Column, LiveRow, Table
from rarms_iac.views.verdicts import delay_sentence, share_of_threshold, show_bound

if TYPE_CHECKING:
    from rich.console import RenderableType

_TELLING = 2
"""Units after which the time for the others is foretold."""

BETWEEN_SAMPLES = 60.0
"""Seconds without a line after which a running setting gets one where nothing can be updated in place."""

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
        self, say: Callable[["RenderableType"], None], clock: Callable[[], float], live: LiveRow | None = None
    ) -> None:
        self._say = say
        self._clock = clock
        self._live = live
        self._began = 0.0
        self._remaining: RemainingSettings | None = None
        self._said = self._unit_began = clock()
        self._units = self._ended = 0
        self._took: tuple[float, ...] = ()  # seconds of each unit of this pass
        self._more_follows = self._at_most = False
        self._unit_ms: float | None = None  # longest time; None: unknown
        self._later_ms = 0.0
        self._provisional: dict[str, str] = {}  # answers of the first pass, by their subject

    def work_begun(self, work: WorkBegun) -> None:
        """Count from there. Write the answers of a pass before it in one line."""
        if self._provisional:
            answers = ", ".join(f"{name} {answer}" for name, answer in self._provisional.items())
            self._say(paragraph(f"First pass: {answers}."))
        self._more_follows, self._at_most, self._provisional = work.more_follows, work.at_most, {}
        self._unit_ms, self._later_ms = work.unit_ms, work.later_ms
        self._units, self._ended, self._took = work.units, 0, ()
        self._unit_began = self._clock()

    def unit_ended(self, unit: FinishedUnit) -> None:
        """Write a line, which stays; of a pass that a more precise one follows, keep the answer."""
        now = self._clock()
        self._units, self._ended, self._took = unit.of, unit.number, (*self._took, now - self._unit_began)
        self._unit_began = now
        if self._more_follows:
            self._provisional[unit.subject] = (
                unit.ending if unit.reserved_lp is None else show_processors(unit.reserved_lp)
            )
            return
        self._said = now
        self._say(paragraph(unit_line(unit), more=6))

    def experiment_started(self, experiment: Experiment, recorded: tuple[Setting, ...]) -> None:
        """Show nothing yet: the first setting names what is measured."""

    def setting_started(self, experiment: Experiment, reserve: int, remaining: RemainingSettings | None) -> None:
        """Show the running setting where it can be updated."""
        self._began, self._remaining = self._clock(), remaining
        if self._live is not None:
            self._live.show((self._numbered(experiment), _setting(experiment, reserve), self._all_left() or "..."))

    def samples_came(self, experiment: Experiment, reserve: int, seen: Mapping[str, Series]) -> None:
        """Show how many samples there are, what they come to, and how long it may yet take."""
        if self._live is not None:
            values = brief(indexes_of_series(experiment.members, seen), several=len(experiment.members) > 1)
            left = self._all_left() or self._time_left(experiment, reserve, seen)
            progress = ", ".join(filter(None, [left, values, samples_of(seen)]))  # the end may be cut off
            self._live.show((self._numbered(experiment), _setting(experiment, reserve), progress))
        elif (now := self._clock()) - self._said >= BETWEEN_SAMPLES:
            self._said = now
            values = brief(indexes_of_series(experiment.members, seen), several=len(experiment.members) > 1)
            so_far = f"{samples_of(seen)}, {values}, after {show_seconds(now - self._began)}, still running"
            self._say(paragraph(f"{_subject(experiment)} at {_setting(experiment, reserve)}: {so_far}"))

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
        left = self._of_load(_describe_remaining(remaining))
        done = ", ".join(filter(None, [samples_of(series), values or "measured", f"in {took}", left]))
        self._say(paragraph(f"{_subject(experiment)} at {_setting(experiment, setting.reserve)}: {done}"))

    def setting_disturbed(self, experiment: Experiment, reserve: int, reason: str) -> None:
        """Say that it is measured again, why, and what that adds to the time that was said before."""
        subject = f"{_subject(experiment)} at {_setting(experiment, reserve)}"
        now = self._clock()
        took, self._began = now - self._began, now
        adds = f" This adds about {show_seconds(took)}." if took >= 1 else ""
        self._say(paragraph(f"{subject} is measured again, because it was disturbed: {reason}.{adds}"))

    def proof_samples_came(self, host: str, load: str | None, seen: Mapping[str, Series]) -> None:
        """Show how many samples there are of each component; without a live line, now and then."""
        now, subject = self._clock(), f"{host} under {load}" if load else f"{host} without load"
        if self._live is None and now - self._said < BETWEEN_LINES:
            return
        named = sorted(seen.items(), key=lambda each: natural_order(each[0]))
        samples = f"samples of {', '.join(f'{name} {len(series.samples)}' for name, series in named)}"
        number, left = self._number(), self._all_left()
        if self._live is not None:
            self._live.show((f"{number}{subject}", ", ".join(filter(None, [left, samples]))))
        else:
            self._said = now
            self._say(paragraph(f"{number}{subject}: {', '.join(filter(None, [samples, left]))}"))

    def experiment_ended(self) -> None:
        """Leave no half line behind; what came of it stands in the summary."""
        if self._live is not None:
            self._live.hide()

    def _numbered(self, experiment: Experiment) -> str:
        return f"{self._number()}{experiment.name}  {experiment.setup.interference}"

    def _number(self) -> str:
        """Write which unit of work runs; empty after the last one, and where their number is not known."""
        return f"[{self._ended + 1}/{self._units}] " if self._ended < self._units else ""

    def _all_left(self) -> str:
        """Write how long all units may yet take: at most by their longest time, at least by those that ended.

        Without a longest time, units of this pass that ended give both. Empty if nothing is known.
        """
        if self._ended >= self._units:
            return ""
        rest, running = self._units - self._ended, self._clock() - self._unit_began
        least, most = self._by_ended(rest, running)
        if self._unit_ms is not None:
            bound = (rest - 1) * self._unit_ms + max(0.0, self._unit_ms - 1000 * running) + self._later_ms
            least = 0.0 if self._later_ms else min(least, bound)
            return f"{show_duration(least)} to {show_duration(bound)} left" if least else _at_most(bound)
        return f"{forecast(0.0 if self._at_most else least, most)} left" if most else ""

    def _by_ended(self, rest: int, running: float) -> tuple[float, float]:
        """Return the least and longest ms of the units left, by the units that ended; 0 before two have ended."""
        if len(self._took) < _TELLING:
            return 0.0, 0.0
        ordered = sorted(self._took)
        quick, slow = ordered[len(ordered) // 4], ordered[-1]
        least, most = (max(0.0, 1000 * (rest * each - min(running, each))) for each in (quick, slow))
        return least, most

    def _time_left(self, experiment: Experiment, reserve: ReservePercent, series: Mapping[str, Series]) -> str:
        """Write the experiment's time left at the speed so far; during the first setting, that setting's."""
        took = self._clock() - self._began
        if self._remaining is not None:
            return self._of_load(_describe_remaining(self._remaining, took))
        done = share_done(experiment, reserve, series)
        if not 0 < done < 1 or took < 1:
            return ""
        return f"at most {show_seconds(took * (1 - done) / done)} left in this setting"

    def _of_load(self, left: str) -> str:
        """Say of a time left that it is of one load, if other units follow."""
        return f"{left} with this load" if left and self._units - self._ended > 1 else left


def _at_most(milliseconds: float) -> str:
    return f"at most {show_duration(milliseconds)} left" if milliseconds else ""


def unit_line(unit: FinishedUnit) -> str:
    """Write as `[3/12] vision  bursts-20  0.46 LP  p99 390 ms <= 400 ms  met`; of several values the nearest one."""
    amount = "" if unit.reserved_lp is None else show_processors(unit.reserved_lp)
    value = ""
    if unit.values:
        each = max(unit.values, key=lambda value: share_of_threshold(value.value, value.threshold))
        index = index_named(each.index)
        bound = show_bound(index, each.threshold)
        whose = "" if each.component == unit.subject else f"{each.component} "
        value = f"{whose}{short_name(index)} {show_value(index, each.value, each.threshold)} {bound}"
    words = (unit.subject, unit.load, amount, value, unit.ending)
    return f"[{unit.number}/{unit.of}] {'  '.join(filter(None, words))}"


def _describe_remaining(remaining: RemainingSettings | None, took: float = 0.0) -> str:
    """Write as `12 s to about 40 s left`; empty if this is unknown or nothing is left.

    A setting that takes longer than those before may end at once.
    """
    if remaining is None:
        return ""
    of_this = min(took, remaining.setting_seconds)
    least, most = (1000 * (count * remaining.setting_seconds - of_this) for count in (remaining.least, remaining.most))
    return f"{forecast(least, most)} left" if most > 0 else ""


def share_done(experiment: Experiment, reserve: ReservePercent, series: Mapping[str, Series]) -> float:
    """Return the part of a setting's longest duration that is over, 1 at its end."""
    budget_ms = experiment.budget.at(reserve)
    return min(
        min(1.0, until_share(seen, run.ends), max(len(seen.samples) / MOST_SAMPLES, seen.elapsed_ms / budget_ms))
        for seen, run in ((series[name], run) for name, run in experiment.runs.items())
    )


def samples_of(by_component: Mapping[str, Series]) -> str:
    """Write as `143 samples`; of several components the fewest."""
    return counted(min((len(series.samples) for series in by_component.values()), default=0), "sample")


def brief(indexes: Sequence[MeasuredIndex], *, several: bool = False) -> str:
    """Return the values alone: `mean 94.1 ms`; of several components `vision 94.1 ms`."""
    values = [
        f"{index.component if several else short_name(index_named(index.index))} "
        f"{show_value(index_named(index.index), index.estimate.value, index.threshold)}"
        for index in indexes
        if index.estimate is not None
    ]
    return ", ".join(values) or "no values yet"


def _subject(experiment: Experiment) -> str:
    return f"{experiment.name} with {experiment.setup.interference}"


def _setting(experiment: Experiment, reserve: int) -> str:
    return show_processors(guaranteed(reserve, experiment.setup.processors))


ENDINGS = {
    SamplingEnd.UNTIL: "",
    SamplingEnd.RUNNING: ", still running",
    SamplingEnd.CLOSED: ", ended early",
    SamplingEnd.FAILURES: ", ended by failed samples",
}


INDEXES = (Column("index"), Column("measured", wraps=True), Column("threshold"), Column("verdict"))


def sample_text(component: str, number: int, sample: Sample) -> str:
    """Return a line: `face-detection 12  at 1.204 s  response 10.6 ms`, and what is special about it."""
    parts = [f"{component} {number:>4}", f"at {sample.began_ms / 1000:.3f} s"]
    if sample.failure:
        return "  ".join([*parts, f"failed: {visible(sample.failure, keep='')}"]) + "\n"
    if sample.response_ms is not None:
        parts.append(f"response {show_number(sample.response_ms)} ms")
    if sample.count != 1.0:
        parts.append(f"count {show_number(sample.count)}")
    if not sample.successful:
        parts.append("not successful")
    return "  ".join(parts) + "\n"


def _summary_text(ran: ComponentRunResult) -> "RenderableType":
    """Return the result of the samples: a line, and a row for each index of the APT."""
    verdicts = {index: f"{verdict_word(verdict)} in this run" for index, verdict in ran.verdicts.items()}
    apt = ran.component.apt
    bounds = {index: show_bound(index_named(index), threshold) for index, threshold in apt.items()}
    rows = [
        (index, _estimate(index, estimate, apt.get(index)), bounds.get(index, ""), verdicts.get(index, ""))
        for index, estimate in ran.estimates.items()
    ]
    skipped = ran.skipped_lines
    notes = [paragraph(f"{describe_skipped(ran.run.samples, skipped)}.")] if skipped.count else []
    heard = ran.heard_messages
    notes += [paragraph(delay)] if heard and (delay := delay_sentence({ran.component.name: heard})) else []
    return stack(paragraph(_head(ran)), Table(INDEXES, rows, indent=2), *notes)


def _head(ran: ComponentRunResult) -> str:
    series = ran.series
    cpu = (
        ""
        if series.cpu_ms is None
        else f"; {show_number(series.cpu_ms / 1000)} s of processor time, its start included"
    )
    memory = "" if ran.memory_peak is None else f"; at most {show_bytes(ran.memory_peak)} of memory"
    failed = f", {ran.failed} failed" if ran.failed else ""
    elapsed = show_number(series.elapsed_ms / 1000)
    samples = counted(len(series.samples), "sample")
    return f"{ran.component.name}: {samples}{failed} in {elapsed} s{ENDINGS[ran.ending]}{cpu}{memory}"


def _estimate(index: str, estimate: Estimate | NoEstimate, threshold: Threshold | None) -> str:
    match estimate:
        case NoEstimate(reason=reason):
            return reason
        case Estimate():
            return show_estimate(index, estimate, threshold)


FAILURE_LINES = 10
"""Lines of the stream without samples that are shown where samples failed."""


class Screen(Protocol):
    """The place in which samples are shown."""

    def data(self, text: str) -> None:
        """Write what was asked for."""

    def show(self, content: "RenderableType") -> None:
        """Write what was asked for, laid out."""

    def talk(self, content: "RenderableType") -> None:
        """Write what is said next to it."""

    def tell(self, text: str) -> None:
        """Write sentences next to it, wrapped between words."""

    def flush(self) -> None:
        """Show all of it now."""


class FailureReporter(SampleReporter):
    """A `SampleReporter` that shows the last other output of a component whose samples failed."""

    def __init__(self, screen: Screen) -> None:
        self._screen = screen

    def place_chosen(self, message: str) -> None:
        """Say it with the samples."""
        self._screen.tell(message)

    def waits(self, component: str, missing: str) -> None:
        """Say it at once."""
        self._screen.tell(f"{component} has no sample yet: {missing}.")

    def ended(self, result: ComponentRunResult, last_words: str) -> None:
        """Show the last lines."""
        is_failing = result.failed or not any(sample.successful for sample in result.series.samples)
        if is_failing and last_words.strip():
            last = last_words.strip().splitlines()[-FAILURE_LINES:]
            lines = "\n".join(f"  {visible(line, keep='')}" for line in last)
            other = STREAM_NAMES[result.run.samples.other_stream]
            self._screen.talk(f"Last lines of {result.component.name} on {other}:\n{lines}")


class LiveSampleReporter(FailureReporter):
    """Shows how a run ends, and every sample as it happens."""

    def sample(self, component: str, number: int, sample: Sample) -> None:
        """Show it now."""
        self._screen.data(sample_text(component, number, sample))
        self._screen.flush()

    def ended(self, result: ComponentRunResult, last_words: str) -> None:
        """Show what the samples come to."""
        self._screen.show(_summary_text(result))
        super().ended(result, last_words)
