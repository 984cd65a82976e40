"""What components showed that were run on this machine, and the findings on it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from rarms_iac.app.manifests import Manifest
from rarms_iac.measuring.findings import FAILURES, MORE_MEMORY, memory_kills
from rarms_iac.model.diagnostics import Diagnostic, Finding
from rarms_iac.model.outcomes import Estimate, Missed, NoEstimate, Verdict
from rarms_iac.model.output import Internal, output
from rarms_iac.model.run import Run
from rarms_iac.model.series import Series, SkippedLines
from rarms_iac.model.system import Component, Threshold
from rarms_iac.model.wording import counted
from rarms_iac.running.samples import SamplingEnd
from rarms_iac.running.start import CannotStart
from rarms_iac.statistics.error_probability import ERROR
from rarms_iac.statistics.estimates import estimate_steady
from rarms_iac.statistics.verdicts import judge_each

CANNOT_RUN = Finding.error("RARMS285", "A component or a load cannot be run")

MISSED_UNRESERVED = Finding.warning("RARMS288", "An APT is missed without any reservation")

FAILURES_SHOWN = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentRunResult:
    """A component that was run, and what it showed."""

    component: Internal[Component]
    run: Internal[Run]
    series: Series
    ending: SamplingEnd
    skipped_lines: SkippedLines = SkippedLines()
    killed_for_memory: Internal[int] = 0  # so many of its processes the kernel killed, whose group had no memory left

    @output
    def apt(self) -> Mapping[str, Threshold]:
        """The threshold of each index that has one."""
        return self.component.apt

    @output
    def failed(self) -> int:
        """How many of the samples are failed ones."""
        return sum(bool(sample.failure) for sample in self.series.samples)

    @output
    def estimates(self) -> Mapping[str, Estimate | NoEstimate]:
        """Every index of the APT; without one, how long its jobs took and how many succeeded."""
        indexes = tuple(self.component.apt) or ("mean_response_time", "success_rate")
        return {index: estimate_steady(index, self._of_real_processes, self.run, error=ERROR) for index in indexes}

    @output
    def verdicts(self) -> Mapping[str, Verdict]:
        """On each index of the APT by itself, as it runs on this machine."""
        return judge_each(self._of_real_processes, self.component.apt, self.run)

    @property
    def _of_real_processes(self) -> Series:
        return replace(self.series, wanders=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOutcome:
    """What all of the components showed, and what is wrong with it."""

    kind: Literal["component_run"] = "component_run"
    results: tuple[ComponentRunResult, ...]
    findings: tuple[Diagnostic, ...]


def findings_of_run(result: ComponentRunResult, manifest: Manifest, *, reserved: bool) -> Iterator[Diagnostic]:
    """Report what is wrong with a run.

    Args:
        reserved: whether it ran in a partition, so that an APT that is missed says nothing.

    Yields:
        Too many failed samples, or each APT that is missed although nothing was reserved.
    """
    name, places = result.component.name, manifest.places
    if result.killed_for_memory:
        yield from memory_kills({name: result.killed_for_memory}, places)
    address = f"component/{name}"
    if result.ending is SamplingEnd.FAILURES:
        reasons = list(dict.fromkeys(sample.failure for sample in result.series.samples if sample.failure))
        count = counted(result.failed, "failed sample")
        yield FAILURES.at(
            places.key("components", name, "run"),
            '"{component}" had {_count} and may have {allowed_failures}: {reasons:;}. Such a setting gets no verdict.',
            MORE_MEMORY
            if result.killed_for_memory
            else "Look at what it writes on standard error, and whether `run.samples` fits its output; "
            "it must write each line at once (flush it). `run.failures` allows some; a job of `per_run` may end with "
            "any exit code where the APT has a `success_rate`.",
            address=address,
            component=name,
            failed_samples=result.failed,
            allowed_failures=result.run.failures,
            reasons=tuple(reasons[:FAILURES_SHOWN]),
            _count=count,
        )
        return
    missed = [index for index, verdict in result.verdicts.items() if isinstance(verdict, Missed)]
    for index in () if reserved else missed:
        yield MISSED_UNRESERVED.at(
            places.key("components", name, "apt", index),
            '"{component}" misses its {index} on this machine although nothing takes processor time from '
            "it but what runs here anyway: no reservation would help it.",
            "Relax the APT, mend or speed up the component, or run it on the machine that it is meant for.",
            address=address,
            component=name,
            index=index,
        )


def cannot_start(manifest: Manifest, problem: CannotStart) -> Diagnostic:
    """Make the finding of a component that cannot be started."""
    name = problem.component
    return CANNOT_RUN.at(
        manifest.places.key("components", name, "run"),
        '"{component}" cannot be started: {reason}.',
        problem.advice
        or "Words of `run.command` that name files, and `run.folder`, are relative to the manifest; a program is "
        "looked for on the PATH. A module of `run.call` is found from the manifest's folder.",
        address=f"component/{name}",
        component=name,
        reason=problem.message,
    )


def load_problem(name: str, message: str) -> Diagnostic:
    """Make the finding of an interfering load that does not run.

    Args:
        message: why, as the end of a sentence.
    """
    return CANNOT_RUN.at(
        None,
        'The interference "{interference}" does not run: {reason}.',
        "Try its program by hand. Browsers need chromium or a relative of it on the PATH.",
        address=f"interference/{name}",
        interference=name,
        reason=message,
    )


def nothing_to_run(manifest: Manifest, name: str) -> Diagnostic:
    """Make the finding of a component that does not say how it is run."""
    return CANNOT_RUN.at(
        manifest.places.key("components", name),
        '"{component}" has no `run`.',
        "Add `run` with a `command` or a `call`.",
        address=f"component/{name}",
        component=name,
    )
