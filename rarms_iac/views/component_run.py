"""`rarms run`: each sample of a component as it happens, and the indexes of all of them beside the APT."""

from typing import TYPE_CHECKING, Protocol

from rarms_iac.measuring.component_results import ComponentRunResult
from rarms_iac.measuring.run_component import SampleReporter
from rarms_iac.model.indexes import index_named, show_bound
from rarms_iac.model.outcomes import Estimate, NoEstimate, verdict_word
from rarms_iac.model.quantities import show_number
from rarms_iac.model.run import STREAM_NAMES
from rarms_iac.model.series import Sample
from rarms_iac.model.wording import counted
from rarms_iac.running.reading import describe_skipped
from rarms_iac.running.samples import SamplingEnd
from rarms_iac.views.console import Table, paragraph, stack
from rarms_iac.views.harmless import visible
from rarms_iac.views.measure import show_estimate

if TYPE_CHECKING:
    from rich.console import RenderableType

ENDINGS = {
    SamplingEnd.UNTIL: "",
    SamplingEnd.RUNNING: ", still running",
    SamplingEnd.CLOSED: ", ended early",
    SamplingEnd.FAILURES: ", ended by failed samples",
}


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
    """Return what the samples come to: a line, and a row an index of the APT."""
    verdicts = {index: f"{verdict_word(verdict)} here" for index, verdict in ran.verdicts.items()}
    bounds = {index: show_bound(index_named(index), threshold) for index, threshold in ran.component.apt.items()}
    rows = [
        (index, _estimate(index, estimate), bounds.get(index, ""), verdicts.get(index, ""))
        for index, estimate in ran.estimates.items()
    ]
    skipped = ran.skipped_lines
    notes = [paragraph(f"{describe_skipped(ran.run.samples, skipped)}.")] if skipped.count else []
    return stack(paragraph(_head(ran)), Table(rows, wrap=(1,), indent=2), *notes)


def _head(ran: ComponentRunResult) -> str:
    series = ran.series
    cpu = (
        ""
        if series.cpu_ms is None
        else f"; {show_number(series.cpu_ms / 1000)} s of processor time, its start included"
    )
    failed = f", {ran.failed} failed" if ran.failed else ""
    elapsed = show_number(series.elapsed_ms / 1000)
    samples = counted(len(series.samples), "sample")
    return f"{ran.component.name}: {samples}{failed} in {elapsed} s{ENDINGS[ran.ending]}{cpu}"


def _estimate(index: str, estimate: Estimate | NoEstimate) -> str:
    match estimate:
        case NoEstimate(reason=reason):
            return reason
        case Estimate():
            return show_estimate(index, estimate)


FAILURE_LINES = 10
"""Lines of the stream without samples that are shown where samples failed."""


class Screen(Protocol):
    """Where samples are shown."""

    def data(self, text: str) -> None:
        """Write what was asked for."""

    def show(self, content: "RenderableType") -> None:
        """Write what was asked for, laid out."""

    def talk(self, content: "RenderableType") -> None:
        """Write what is said beside it."""

    def tell(self, text: str) -> None:
        """Write sentences beside it, wrapped between words."""

    def flush(self) -> None:
        """Show all of it now."""


class FailureReporter(SampleReporter):
    """A `SampleReporter` that shows the last other output of a component whose samples failed."""

    def __init__(self, screen: Screen) -> None:
        self._screen = screen

    def place_chosen(self, message: str) -> None:
        """Say it beside the samples."""
        self._screen.tell(message)

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
