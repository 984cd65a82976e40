"""What `rarms run` shows: each sample of a component as it happens, and what they come to beside the APT."""

from collections.abc import Iterator, Sequence
from math import isfinite

from rarms_iac.app.run_component import ComponentRunResult, meets, noise
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.indexes import find_index
from rarms_iac.model.measurement import Sample
from rarms_iac.model.outcomes import Estimate, NoEstimate
from rarms_iac.model.quantities import Unit
from rarms_iac.model.system import AtLeast, AtMost, Threshold
from rarms_iac.running.samples import RunEnding
from rarms_iac.views.as_json import as_json
from rarms_iac.views.diagnostics.layout import visible
from rarms_iac.views.diagnostics.text import counted
from rarms_iac.views.output.runs import ComponentRunOutput, RanComponentOutput, RanIndexOutput, SampleOutput

UNIT_NAMES = {Unit.TIME: "ms", Unit.SHARE: "%", Unit.RATE: "/s"}

ENDINGS = {
    RunEnding.UNTIL: "",
    RunEnding.RUNNING: ", still running",
    RunEnding.CLOSED: ", ended early",
    RunEnding.FAILURES: ", ended by failed samples",
}


def sample_text(component: str, number: int, sample: Sample) -> str:
    """A line: `face-detection 12  at 1.204 s  response 10.64 ms`, and what is special about it."""
    parts = [f"{component} {number:>4}", f"at {sample.began_ms / 1000:.3f} s"]
    if sample.failure:
        return "  ".join([*parts, f"failed: {visible(sample.failure, keep='')}"]) + "\n"
    if sample.response_ms is not None:
        parts.append(f"response {figure(sample.response_ms)} ms")
    if sample.count != 1.0:
        parts.append(f"count {figure(sample.count)}")
    if not sample.successful:
        parts.append("not successful")
    return "  ".join(parts) + "\n"


def summary_text(ran: ComponentRunResult) -> str:
    """What the samples come to: a line, and one an index of the APT."""
    return "".join(f"{line}\n" for line in _summary(ran))


def _summary(ran: ComponentRunResult) -> Iterator[str]:
    series = ran.series
    cpu = "" if series.cpu_ms is None else f"; {figure(series.cpu_ms / 1000)} s of processor time, its start included"
    failed = f", {ran.failed} failed" if ran.failed else ""
    yield (
        f"{ran.component.name}: {counted(len(series.samples), 'sample')}{failed} in "
        f"{figure(series.elapsed_ms / 1000)} s{ENDINGS[ran.ending]}{cpu}"
    )
    for index, found in ran.estimates.items():
        yield f"  {index}: {_estimate(index, found)}{_beside(ran.component.apt.get(index), index, found)}"


def _estimate(index: str, found: Estimate | NoEstimate) -> str:
    match found:
        case NoEstimate(reason=why):
            return why
        case Estimate(value=value, lower=lower, upper=upper):
            sure = [figure(one) for one in (lower, upper) if isfinite(one)]
            between = f" ({sure[0]} to {sure[1]})" if len(sure) == 2 and sure[0] != sure[1] else ""
            return f"{figure(value)} {unit_of(index)}{between}"


def _beside(threshold: Threshold | None, index: str, found: Estimate | NoEstimate) -> str:
    if threshold is None:
        return ""
    wanted = "at most" if isinstance(threshold, AtMost) else "at least"
    says = ""
    if isinstance(found, Estimate):
        says = ", met here" if meets(found.value, threshold) else ", missed here"
        says += " within the noise" if noise(found, threshold) else ""
    return f"; APT {wanted} {figure(float(threshold.value))} {unit_of(index)}{says}"


def unit_of(index: str) -> str:
    """The unit in which an index's values are given."""
    known = find_index(index)
    return "" if known is None else UNIT_NAMES.get(known.unit, "")


def figure(value: float) -> str:
    """Four digits at most, without needless ones: `10.64`, `98`, `1204`."""
    if not value or not isfinite(value):
        return f"{value:g}"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.4g}"


def ran_json(ran: Sequence[ComponentRunResult], findings: Sequence[Diagnostic]) -> str:
    """The same for programs, samples included."""
    return as_json(ComponentRunOutput(components=tuple(map(_output, ran)), findings=tuple(findings)))


def _output(ran: ComponentRunResult) -> RanComponentOutput:
    series = ran.series
    return RanComponentOutput(
        component=ran.component.name,
        ending=ran.ending.value,
        elapsed_ms=series.elapsed_ms,
        cpu_ms=series.cpu_ms,
        failed=ran.failed,
        indexes=tuple(_index(index, found, ran.component.apt.get(index)) for index, found in ran.estimates.items()),
        samples=tuple(
            SampleOutput(
                began_ms=sample.began_ms,
                response_ms=sample.response_ms,
                successful=sample.successful,
                count=sample.count,
                failure=sample.failure,
            )
            for sample in series.samples
        ),
    )


def _index(index: str, found: Estimate | NoEstimate, threshold: Threshold | None) -> RanIndexOutput:
    known = found if isinstance(found, Estimate) else None
    return RanIndexOutput(
        index=index,
        unit=unit_of(index),
        value=known.value if known else None,
        lower=known.lower if known and isfinite(known.lower) else None,
        upper=known.upper if known and isfinite(known.upper) else None,
        at_most=float(threshold.value) if isinstance(threshold, AtMost) else None,
        at_least=float(threshold.value) if isinstance(threshold, AtLeast) else None,
        met=meets(known.value, threshold) if known and threshold else None,
    )
