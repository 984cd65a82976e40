"""Components that run on this machine, one after the other or together: in their partitions where those are here.

Begin at `run_components`: it shows whether the manifest's `run` is right, before anything is measured.
"""

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Literal, NoReturn

from rarms_iac.app.errors import Outcome, RequestError, UseCaseError
from rarms_iac.app.experiments.measure_request import refuse_unknown
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.options import argument, flag, option, read_time
from rarms_iac.app.process_place import place_of
from rarms_iac.model.diagnostics import Diagnostic, Finding
from rarms_iac.model.outcomes import Estimate, Missed, NoEstimate, Verdict
from rarms_iac.model.output import Internal, output
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.run import Call, Elapsed, Run, SampleCount
from rarms_iac.model.series import Sample, Series
from rarms_iac.model.system import Component, System, Threshold
from rarms_iac.model.wording import counted
from rarms_iac.running.component import ComponentRun, run_in_parallel
from rarms_iac.running.loads import InterferingLoad, LoadEnded
from rarms_iac.running.samples import SamplingEnd
from rarms_iac.running.start import CannotStart, ProcessPlace, RunningError, StartContext, become, order_of
from rarms_iac.statistics.error_probability import ERROR
from rarms_iac.statistics.estimates import estimate_steady
from rarms_iac.statistics.verdicts import judge_each


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentRunResult:
    """A component that was run, and what it showed."""

    component: Internal[Component]
    run: Internal[Run]
    series: Series
    ending: SamplingEnd

    @property
    @output
    def apt(self) -> Mapping[str, Threshold]:
        """The threshold of each index that has one."""
        return self.component.apt

    @property
    @output
    def failed(self) -> int:
        """How many of the samples are failed ones."""
        return sum(bool(sample.failure) for sample in self.series.samples)

    @property
    @output
    def estimates(self) -> Mapping[str, Estimate | NoEstimate]:
        """Every index of the APT; without one, how long its jobs took and how many succeeded."""
        indexes = tuple(self.component.apt) or ("mean_response_time", "success_rate")
        return {index: estimate_steady(index, self._of_real_processes, self.run, error=ERROR) for index in indexes}

    @property
    @output
    def verdicts(self) -> Mapping[str, Verdict]:
        """On each index of the APT by itself, as it runs on this machine."""
        return judge_each(self._of_real_processes, self.component.apt, self.run)

    @property
    def _of_real_processes(self) -> Series:
        return replace(self.series, wanders=True)


CANNOT_START = Finding.error("RARMS285", "A component cannot be run")
TOO_MANY_FAILURES = Finding.error("RARMS286", "More failed samples than allowed")
LOAD_NOT_RUNNING = Finding.error("RARMS287", "An interfering load does not run")
MISSED_UNRESERVED = Finding.warning("RARMS288", "An APT is missed without any reservation")
NOTHING_TO_RUN = Finding.error("RARMS289", "Nothing says how a component is run")

FAILURES_SHOWN = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRequest:
    """Which components to run, for how long, against what.

    Raises:
        RequestError: it says how long and how many samples, or no time at all.
    """

    components: tuple[str, ...] = argument("[COMPONENT]...", default=())  # none: all that say how
    for_ms: int | None = option(
        "--for", metavar="TIME", read=read_time, help="For so long: 5s. [default: as `until` says]"
    )
    samples: int | None = option("--samples", least=1, help="Until there are so many. [default: as `until` says]")
    interference: str | None = option(
        "--interference", metavar="NAME", help="Against this load of the manifest. [default: none]"
    )
    together: bool = flag("--together", help="All at once. [default: one after the other]")

    def __post_init__(self) -> None:
        if self.for_ms is not None and self.for_ms < 1:
            raise RequestError("--for has to be at least 1 ms.")
        if self.for_ms is not None and self.samples is not None:
            raise RequestError("Give --for or --samples, not both.")


class SampleReporter:
    """Hears what components show while they run; must not raise. This one drops what it is told."""

    def place_chosen(self, message: str) -> None:
        """Take note of where a component is about to run.

        Args:
            message: in words; a component that nothing could reserve for has none.
        """

    def sample(self, component: str, number: int, sample: Sample) -> None:
        """Take note of a sample as soon as it is read.

        Args:
            component: the component's name.
            number: which of its samples this is, from 1.
            sample: the sample.
        """

    def ended(self, result: ComponentRunResult, last_words: str) -> None:
        """Take note that a component ended.

        Args:
            result: what it showed.
            last_words: the end of its standard error, as it was written.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOutcome:
    """What all of the components showed, and what is wrong with it."""

    kind: Literal["component_run"] = "component_run"
    results: tuple[ComponentRunResult, ...]
    findings: tuple[Diagnostic, ...]


def run_components(manifest: Manifest, request: RunRequest, reporter: SampleReporter | None = None) -> RunOutcome:
    """Run components on this machine as the manifest says, until each has its samples or its time is over.

    Args:
        manifest: Words of `run` that name files are relative to its folder.
        request: Which of them, for how long, against what.
        reporter: Hears of every sample; None: no reporter.

    Returns:
        The samples of each component in the order in which they ran, and a finding for each that failed.

    Raises:
        UseCaseError: One cannot be started (failed), or does not say how (negative).
        RequestError: Nothing has a name that was given.
    """
    system, chosen = manifest.system, _chosen(manifest, request)
    base = Path(manifest.folder).resolve()
    results: list[ComponentRunResult] = []
    listener = reporter or SampleReporter()
    places = {component.name: place_of(manifest, component, listener.place_chosen) for component, _ in chosen}
    try:
        with _load(system, request, base) as load:
            for group in [chosen] if request.together else [[component] for component in chosen]:
                results += _run_group(group, base, places, load, listener)
    except (LoadEnded, CannotStart) as problem:
        name = problem.load if isinstance(problem, LoadEnded) else problem.component
        of_load = isinstance(problem, LoadEnded) or name not in system.components
        finding = _load_problem(name, problem.message) if of_load else _cannot_start(manifest, name, problem.message)
        raise UseCaseError(Outcome.FAILED, [finding], manifest.sources) from problem
    except RunningError as problem:
        finding = CANNOT_START.at(
            None, f"{problem}.", "It was ended from outside: run it again.", values={"reason": str(problem)}
        )
        raise UseCaseError(Outcome.FAILED, [finding], manifest.sources) from problem
    findings = tuple(
        finding
        for result in results
        for finding in _findings(result, manifest, reserved=places[result.component.name] != ProcessPlace())
    )
    return RunOutcome(results=tuple(results), findings=findings)


def become_component(manifest: Manifest, name: str, reporter: SampleReporter) -> NoReturn:
    """Turn this process into a component, in its partition and task class: no samples are taken, and it is not ended.

    Args:
        manifest: As of `run_components`.
        name: Of a component that is run by a command.
        reporter: Hears where it runs.

    Raises:
        UseCaseError: It cannot be started (failed), or does not say how (negative).
        RequestError: There is no such component, it is a call, or this is Windows, where no process becomes another.
    """
    ((component, run),) = _chosen(manifest, RunRequest(components=(name,)))
    if sys.platform == "win32" or isinstance(run.start, Call):
        raise RequestError(f"--exec is for commands on Linux and the like: run {name} without it.")
    context = StartContext(
        base=Path(manifest.folder).resolve(), inside=place_of(manifest, component, reporter.place_chosen)
    )
    try:
        become(order_of(name, run, context))
    except CannotStart as problem:
        finding = _cannot_start(manifest, name, problem.message)
        raise UseCaseError(Outcome.FAILED, [finding], manifest.sources) from problem


def _findings(result: ComponentRunResult, manifest: Manifest, *, reserved: bool) -> Iterator[Diagnostic]:
    """Report what is wrong with a run."""
    name, places = result.component.name, manifest.places
    address = f"component/{name}"
    if result.ending is SamplingEnd.FAILURES:
        reasons = list(dict.fromkeys(sample.failure for sample in result.series.samples if sample.failure))
        count = counted(result.failed, "failed sample")
        yield TOO_MANY_FAILURES.at(
            places.key("components", name, "run"),
            f'"{name}" had {count} and may have {result.run.failures}: '
            f"{'; '.join(reasons[:FAILURES_SHOWN])}. Such a setting gets no verdict.",
            "Look at what it says on standard error (shown above), and whether `run.samples` fits its output; each "
            "line must be written at once (flushed). `run.failures` allows some.",
            address=address,
            values={
                "component": name,
                "failed_samples": result.failed,
                "allowed_failures": result.run.failures,
                "reasons": tuple(reasons[:FAILURES_SHOWN]),
            },
        )
        return
    missed = [index for index, verdict in result.verdicts.items() if isinstance(verdict, Missed)]
    for index in () if reserved else missed:
        yield MISSED_UNRESERVED.at(
            places.key("components", name, "apt", index),
            f'"{name}" misses its {index} on this machine although nothing takes processor time from it but what '
            "runs here anyway: no reservation would help it.",
            "Relax the APT, make the component faster, or run it on the machine that it is meant for.",
            address=address,
            values={"component": name, "index": index},
        )


def _chosen(manifest: Manifest, request: RunRequest) -> list[tuple[Component, Run]]:
    system = manifest.system
    refuse_unknown(request.components, system.components, "component")
    names = tuple(dict.fromkeys(request.components)) or tuple(
        component.name for component in system.components.values() if component.run
    )
    runs = [(system.components[name], system.components[name].run) for name in names]
    lacking = [component.name for component, run in runs if run is None] or ([] if runs else list(system.components))
    if lacking or not runs:
        raise UseCaseError(Outcome.NEGATIVE, [_nothing_to_run(manifest, name) for name in lacking], manifest.sources)
    return [(component, _until(run, request)) for component, run in runs if run is not None]


def _until(run: Run, request: RunRequest) -> Run:
    if request.for_ms is not None:
        return replace(run, until=Elapsed(time=Milliseconds(Fraction(request.for_ms))))
    return run if request.samples is None else replace(run, until=SampleCount(samples=request.samples))


@contextmanager
def _load(system: System, request: RunRequest, base: Path) -> Iterator[InterferingLoad | None]:
    if request.interference is None:
        yield None
        return
    refuse_unknown((request.interference,), system.interference, "interference")
    load = system.interference[request.interference]
    with InterferingLoad(request.interference, load, StartContext(base=base)) as running:
        yield running


def _run_group(
    group: Sequence[tuple[Component, Run]],
    base: Path,
    places: Mapping[str, ProcessPlace],
    load: InterferingLoad | None,
    reporter: SampleReporter,
) -> list[ComponentRunResult]:
    runs = [
        ComponentRun(component.name, run, StartContext(base=base, inside=places[component.name]))
        for component, run in group
    ]
    numbers = {run.component: 0 for run in runs}
    with run_in_parallel(runs) as samples:
        for name, sample in samples:
            numbers[name] += 1
            if load is not None:
                load.check()
            reporter.sample(name, numbers[name], sample)
    results = [
        ComponentRunResult(component=component, run=run, series=process.series(), ending=process.ending)
        for (component, run), process in zip(group, runs, strict=True)
    ]
    for result, process in zip(results, runs, strict=True):
        reporter.ended(result, process.tail)
    return results


def _cannot_start(manifest: Manifest, name: str, message: str) -> Diagnostic:
    return CANNOT_START.at(
        manifest.places.key("components", name, "run"),
        f'"{name}" cannot be started: {message}.',
        "Words of `run.command` that name files, and `run.folder`, are relative to the manifest; a program is looked "
        "for on the PATH. A module of `run.call` is found from the manifest's folder.",
        address=f"component/{name}",
        values={"component": name, "reason": message},
    )


def _load_problem(name: str, message: str) -> Diagnostic:
    return LOAD_NOT_RUNNING.at(
        None,
        f'The interference "{name}" does not run: {message}.',
        "Try its program by hand. Browsers need chromium or a relative of it on the PATH.",
        address=f"interference/{name}",
        values={"interference": name, "reason": message},
    )


def _nothing_to_run(manifest: Manifest, name: str) -> Diagnostic:
    return NOTHING_TO_RUN.at(
        manifest.places.key("components", name),
        f'"{name}" has no `run`.',
        "Add `run` with a `command` or a `call`.",
        address=f"component/{name}",
        values={"component": name},
    )
