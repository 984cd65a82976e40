"""Components that run on this machine, one after the other or together: in their partitions where those are here.

Begin at `run_components`: it shows whether the manifest's `run` is right, before anything is measured.
"""

import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from pathlib import Path
from threading import Event, Lock, Thread
from typing import Literal, NoReturn

from rarms_iac.app.control import UNATTENDED, Control
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.manifests import Manifest, start_warnings
from rarms_iac.app.requests import argument, flag, option, read_time, refuse_unknown
from rarms_iac.app.this_machine import find_place
from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError
from rarms_iac.measuring.exec_processes import exec_name, refuse_running
from rarms_iac.measuring.findings import MISSED_UNRESERVED, failed_samples
from rarms_iac.measuring.on_robot import SAMPLES, ExperimentListener, ask_robot
from rarms_iac.measuring.other_work import work_of_evidence
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.outcomes import Estimate, Missed, NoEstimate, TooManyFailures, Verdict
from rarms_iac.model.output import Internal, output
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.run import AttachedContainer, AttachedService, Call, Elapsed, Run, SampleCount
from rarms_iac.model.series import HeardMessages, Sample, Series, SkippedLines
from rarms_iac.model.setting import Setting, SettingEvidence
from rarms_iac.model.system import Component, System, Threshold, run_of
from rarms_iac.running.component import ComponentRun, run_in_parallel
from rarms_iac.running.kernel_files import UnreadableFile, most_memory_below
from rarms_iac.running.loads import InterferingLoad, LoadEnded
from rarms_iac.running.orders import CannotStart, ProcessPlace, RunningError, StartContext
from rarms_iac.running.samples import SamplingEnd
from rarms_iac.running.start import become, order_of
from rarms_iac.running.work_places import WorkPlaces
from rarms_iac.statistics.distributions import ERROR
from rarms_iac.statistics.estimates import estimate_steady
from rarms_iac.statistics.verdicts import judge_each
from rarms_iac.texts.findings import CANNOT_RUN
from rarms_iac.texts.messages import in_a_row
from rarms_iac.texts.quantities import show_duration

_WHY_SAMPLES_FAIL = (
    "Check the standard error of the component, and compare `run.samples` with its output. The component must "
    "flush each line. `run.failures` allows failed samples. With a `success_rate` in the APT, a job "
    "of `per_run` may end with any exit code."
)

_WHY_MESSAGES_FAIL = (
    "Read the standard error of the component. See who publishes the two topics, for example with `rostopic info`: "
    "`samples.input` is what the component subscribes to, `samples.output` what it publishes, with the stamp of the "
    "input. A job that takes longer than `run.timeout` fails."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentRunResult:
    """A component that was run, and what it showed: a setting without a reservation."""

    component: Internal[Component]
    run: Internal[Run]
    setting: Internal[Setting]  # with the component's series alone; its evidence is that of all that ran at once
    ending: SamplingEnd
    memory_peak: int | None = None  # bytes, the most of all its processes; None: not counted

    @output
    def series(self) -> Series:
        """All of its samples."""
        (series,) = self.setting.series
        return series

    @output
    def skipped_lines(self) -> SkippedLines:
        """Lines of its output that are not samples."""
        return self.evidence.skipped_lines.get(self.component.name, SkippedLines())

    @output
    def heard_messages(self) -> HeardMessages | None:
        """The messages that its samples come from; None: they come from elsewhere."""
        return self.evidence.messages.get(self.component.name)

    @property
    def evidence(self) -> SettingEvidence:
        """What was counted while it ran."""
        return self.setting.evidence or SettingEvidence()

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
    """The results of all components, with the faults in them."""

    kind: Literal["component_run"] = "component_run"
    results: tuple[ComponentRunResult, ...]
    findings: tuple[Diagnostic, ...]


_LOOK_EVERY_S = 0.25

UNRESERVED = 0
"""The reservation of a setting in which components run with everything else on the machine, in per cent."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRequest:
    """The request of `rarms run`.

    Raises:
        RequestError: it says how long and how many samples, or no time at all.
    """

    components: tuple[str, ...] = argument("[COMPONENT]...", default=())  # none: all that say how
    for_ms: int | None = option(
        "--for", metavar="TIME", read=read_time, help="Run for this long: 5s. [default: `run.until`]"
    )
    samples: int | None = option(
        "--samples", least=1, help="Run until this many samples are recorded. [default: `run.until`]"
    )
    interference: str | None = option(
        "--interference", metavar="NAME", help="Run with this load of the manifest. [default: none]"
    )
    together: bool = flag("--together", help="Run all at once. [default: one after the other]")

    def __post_init__(self) -> None:
        if self.for_ms is not None and self.for_ms < 1:
            raise RequestError("--for must be at least 1 ms.")
        if self.for_ms is not None and self.samples is not None:
            raise RequestError("Give --for or --samples, not both.")


class SampleReporter:
    """Receives what components show while they run; must not raise. This one drops it."""

    def place_chosen(self, message: str) -> None:
        """Take note of where a component is about to run.

        Args:
            message: in words; a component that nothing could reserve for has none.
        """

    def sample(self, component: str, number: int, sample: Sample) -> None:
        """Take note of a sample as soon as it is read.

        Args:
            number: which of its samples this is, from 1.
        """

    def waits(self, component: str, missing: str) -> None:
        """Take note that a component has no sample after some seconds.

        Args:
            missing: which messages do not come.
        """

    def ended(self, result: ComponentRunResult, last_words: str) -> None:
        """Take note that a component ended.

        Args:
            last_words: the end of its standard error, or of its standard output where samples come from standard error.
        """


def run_components(manifest: Manifest, request: RunRequest, reporter: SampleReporter | None = None) -> RunOutcome:
    """Run components on this machine as the manifest says, until each has its samples or its time is over.

    Args:
        manifest: Words of `run` that name files are relative to its folder.
        reporter: Hears of every sample; None: no reporter.

    Returns:
        The samples of each component in the order in which they ran, and a finding for each that failed.

    Raises:
        UseCaseError: One cannot be started (failed), or does not say how (negative).
        RequestError: Nothing has a name that was given.
    """
    system, chosen = manifest.system, _chosen(manifest, request)
    base = manifest.code_folder.resolve()
    results: list[ComponentRunResult] = []
    findings = [*start_warnings(manifest, [component for component, _ in chosen])]
    listener = reporter or SampleReporter()
    try:
        refuse_running(manifest, [component.name for component, _ in chosen])
        places = {component.name: find_place(manifest, component, listener.place_chosen) for component, _ in chosen}
        with _load(system, request, base) as load:
            for group in [chosen] if request.together else [[component] for component in chosen]:
                ran = _run_group(group, base, places, load, listener)
                results += ran
                names = [each.component.name for each in ran]
                reserved = all(places[name] != ProcessPlace() for name in names)
                evidence = [ran[0].evidence]
                findings += work_of_evidence(names, evidence, manifest.places, evidence if reserved else ())
    except (LoadEnded, CannotStart) as problem:
        if isinstance(problem, CannotStart) and problem.component in system.components:
            finding = cannot_start(manifest, problem)
        else:
            name = problem.load if isinstance(problem, LoadEnded) else problem.component
            finding = load_problem(name, problem.message)
        raise UseCaseError(Outcome.FAILED, [finding], manifest.sources) from problem
    except UnreadableFile as problem:
        advice = "Compare the file with the kernel's documentation. A tool may have mounted another file over it."
        finding = CANNOT_RUN.at(None, "{reason}.", advice, reason=str(problem))
        raise UseCaseError(Outcome.FAILED, [finding], manifest.sources) from problem
    except RunningError as problem:
        finding = CANNOT_RUN.at(
            None, "{reason}.", "Another program ended it. Run the same command again.", reason=str(problem)
        )
        raise UseCaseError(Outcome.FAILED, [finding], manifest.sources) from problem
    for result in results:
        reserved = places[result.component.name] != ProcessPlace()
        findings += findings_of_run(result, manifest, reserved=reserved, load=request.interference)
    return RunOutcome(results=tuple(results), findings=tuple(findings))


def run_components_of(
    hosts: Hosts, request: RunRequest, reporter: SampleReporter | None = None, control: Control = UNATTENDED
) -> RunOutcome:
    """Run components on this machine, or on the one chosen host that is a robot.

    Returns:
        As `run_components`.

    Raises:
        UseCaseError: As of `run_components`; or the robot cannot be asked (failed).
        RequestError: Nothing has a name that was given, or several robots are chosen.
    """
    robots = [name for name in hosts.chosen if hosts.robot(name) is not None]
    if not robots:
        return run_components(hosts.manifest, request, reporter)
    if len(robots) > 1:
        advice = prose("Choose one host: ", command("run", *request.components, host=robots[0]), ".")
        raise RequestError(f"Components can run on {in_a_row(robots)}.", advice)
    chosen = [component.name for component, _ in _chosen(hosts.manifest, request)]
    loads = () if request.interference is None else (request.interference,)
    refuse_unknown(loads, hosts.system.interference, "interference")
    reporters = {SAMPLES: (SampleReporter, reporter or SampleReporter())}
    listener = ExperimentListener(hosts=hosts, host=robots[0], control=control, reporters=reporters)
    return ask_robot(listener, "run", request, RunOutcome, components=chosen, loads=loads)


def become_component(manifest: Manifest, name: str, reporter: SampleReporter) -> NoReturn:
    """Turn this process into a component, in its partition and task class: no samples are taken, and it is not ended.

    Raises:
        UseCaseError: It cannot be started (failed), or does not say how (negative).
        RequestError: no such component, it is a call, or this is Windows, where no process becomes another.
    """
    ((component, run),) = _chosen(manifest, RunRequest(components=(name,)))
    if sys.platform == "win32" or isinstance(run.start, Call | AttachedService | AttachedContainer):
        raise RequestError(f"--exec needs a `command` on Linux or a similar system. Run {name} without --exec.")
    context = StartContext(
        base=manifest.code_folder.resolve(), inside=find_place(manifest, component, reporter.place_chosen)
    )
    try:
        become(order_of(name, run, context), exec_name(manifest, name))
    except CannotStart as problem:
        finding = cannot_start(manifest, problem)
        raise UseCaseError(Outcome.FAILED, [finding], manifest.sources) from problem


def _chosen(manifest: Manifest, request: RunRequest) -> list[tuple[Component, Run]]:
    system = manifest.system
    refuse_unknown(request.components, system.components, "component")
    names = tuple(dict.fromkeys(request.components)) or tuple(
        component.name for component in system.components.values() if component.run
    )
    components = [system.components[name] for name in names]
    lacking = [each.name for each in components if each.run is None] or ([] if names else list(system.components))
    if lacking or not names:
        raise UseCaseError(Outcome.NEGATIVE, [nothing_to_run(manifest, name) for name in lacking], manifest.sources)
    return [(component, _until(run_of(component), request)) for component in components]


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
    """Run components at once, as a setting without a reservation."""
    looked, began = WorkPlaces(folder for place in places.values() for folder in place.groups), time.perf_counter()
    runs = [
        ComponentRun(component.name, run, StartContext(base=base, inside=places[component.name]))
        for component, run in group
    ]
    memory: dict[str, int] = {}
    heard = _OneAtATime(reporter)

    def look_at_end(of: ComponentRun) -> None:
        looked.look([run.place for run in runs])
        if of.has_own_time and of.process is not None:
            memory[of.component] = most_memory_below(of.process)

    for run in runs:
        run.call_before_end(partial(look_at_end, run))
        run.call_while_waiting(partial(heard.waits, run.component))
    numbers = {run.component: 0 for run in runs}
    with _looking(looked, runs), run_in_parallel(runs) as samples:
        for name, sample in samples:
            numbers[name] += 1
            if load is not None:
                load.check()
            heard.sample(name, numbers[name], sample)
    evidence = _evidence_of(runs, looked, 1000 * (time.perf_counter() - began))
    results = [
        ComponentRunResult(
            component=component,
            run=run,
            setting=Setting(reserve=UNRESERVED, series=(process.series(),), evidence=evidence),
            ending=process.ending,
            memory_peak=memory.get(component.name) or None,
        )
        for (component, run), process in zip(group, runs, strict=True)
    ]
    for result, process in zip(results, runs, strict=True):
        reporter.ended(result, process.tail)
    return results


class _OneAtATime(SampleReporter):
    """Has a reporter hear one thing at a time: each component has a thread of its own that reads its samples."""

    def __init__(self, reporter: SampleReporter) -> None:
        self._reporter = reporter
        self._lock = Lock()

    def sample(self, component: str, number: int, sample: Sample) -> None:
        """Pass it on."""
        with self._lock:
            self._reporter.sample(component, number, sample)

    def waits(self, component: str, missing: str) -> None:
        """Pass it on."""
        with self._lock:
            self._reporter.waits(component, missing)


def _evidence_of(runs: Sequence[ComponentRun], looked: WorkPlaces, elapsed_ms: float) -> SettingEvidence:
    """Return what was counted while components ran."""
    return SettingEvidence(
        elapsed_ms=elapsed_ms,
        skipped_lines={run.component: run.skipped for run in runs if run.skipped.count},
        messages={run.component: heard for run in runs if (heard := run.heard)},
        outside=looked.outside([run.place for run in runs], elapsed_ms),
        others=looked.others(elapsed_ms, elapsed_ms),
        out_of_memory={run.component: killed for run in runs if (killed := run.killed_for_memory)},
        threads={run.component: run.threads for run in runs if not run.threads.is_fine},
    )


@contextmanager
def _looking(looked: WorkPlaces, runs: Sequence[ComponentRun]) -> Iterator[None]:
    """Look meanwhile, too: at the end, the container of a job that has ended is not there any more."""
    ended = Event()

    def look_often() -> None:
        with suppress(UnreadableFile):  # the look at the end raises it
            while not ended.wait(_LOOK_EVERY_S):
                looked.look([run.place for run in runs])

    thread = Thread(target=look_often, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def findings_of_run(
    result: ComponentRunResult, manifest: Manifest, *, reserved: bool, load: str | None
) -> Iterator[Diagnostic]:
    """Report what is wrong with a run.

    Args:
        reserved: whether it ran in a partition, so that an APT that is missed says nothing.
        load: the interfering load that ran meanwhile; None: none.

    Yields:
        Too many failed samples, or each APT that is missed although nothing was reserved.
    """
    name, places = result.component.name, manifest.places
    if result.ending is SamplingEnd.FAILURES:
        failed = TooManyFailures(
            component=name,
            failures=tuple(sample.failure for sample in result.series.samples if sample.failure),
            allowed=result.run.failures,
            out_of_memory=result.evidence.out_of_memory.get(name, 0),
        )
        advice = _WHY_MESSAGES_FAIL if result.run.samples.source == "ros" else _WHY_SAMPLES_FAIL
        yield failed_samples(failed, "on this machine", places, advice=advice)
        return
    missed = [index for index, verdict in result.verdicts.items() if isinstance(verdict, Missed)]
    for index in () if reserved else missed:
        busy = _describe_others(result, load)
        yield MISSED_UNRESERVED.at(
            places.key("components", name, "apt", index),
            "{component} misses its threshold for {index} without a reservation. {_others}",
            prose(
                "Measure whether a reservation helps: ",
                command("measure", name),
                ". Or stop other programs, and run the component again.",
            )
            if busy
            else "Relax the threshold, make the component faster, or run it on the target machine.",
            address=f"component/{name}",
            component=name,
            index=index,
            _others=busy or "Other programs used little processor time, so a reservation would not help.",
        )


_LEAST_OTHERS = 0.05
"""Part of a run's time from which the processor time of other programs may have delayed a component."""


def _describe_others(result: ComponentRunResult, load: str | None) -> str:
    """Describe who may have taken processor time from a component that ran without a reservation; empty: nobody.

    A container or a service is not separated from other programs here.
    """
    if load is not None:
        return f"The load {load} ran at the same time. A reservation may help."
    elapsed_ms = result.evidence.elapsed_ms
    others_ms = sum(work.cpu_ms for work in result.evidence.others if work.name != "rarms")
    if others_ms < _LEAST_OTHERS * elapsed_ms:
        return ""
    return (
        f"During the run of {show_duration(elapsed_ms)}, other programs used {show_duration(others_ms)} of "
        "processor time. A reservation may help."
    )


def cannot_start(manifest: Manifest, problem: CannotStart) -> Diagnostic:
    """Make the finding of a component that cannot be started."""
    name = problem.component
    return CANNOT_RUN.at(
        manifest.places.key("components", name, "run"),
        '"{component}" cannot be started: {reason}.',
        problem.advice
        or (
            "`run.folder` and the files in `run.command` are relative to the manifest. rarms searches for "
            "programs on the PATH. A module of `run.call` is relative to the manifest's folder."
        ),
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
        'The load "{interference}" cannot be started: {reason}.',
        "Start its program by hand to see the error. A browser load needs Chromium, or a browser based on "
        "Chromium, on the PATH.",
        address=f"interference/{name}",
        interference=name,
        reason=message,
    )


def nothing_to_run(manifest: Manifest, name: str) -> Diagnostic:
    """Make the finding of a component that does not say how it is run."""
    return CANNOT_RUN.at(
        manifest.places.key("components", name),
        '"{component}" does not have a `run`.',
        "Add `run` with a `command` or a `call`.",
        address=f"component/{name}",
        component=name,
    )
