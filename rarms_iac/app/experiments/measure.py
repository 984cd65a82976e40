"""Measuring: experiments with their data logs, on hosts that are held meanwhile.

Begin at `measure_components`. A single experiment is `run_experiment`'s.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from rarms_iac.app.control import NEVER_STOP, SILENT, Reporter, StopSignal
from rarms_iac.app.data_logs import measurements_of
from rarms_iac.app.decision_logs import record_choices
from rarms_iac.app.errors import RequestError
from rarms_iac.app.experiments.experiment_log import data_log_path, end_remeasurements, remeasurements_for
from rarms_iac.app.experiments.level_prompt import LevelPrompt, SessionEnded, ask_levels
from rarms_iac.app.experiments.measure_request import ExperimentResult, MeasureRequest, experiments_of_request
from rarms_iac.app.experiments.run_experiment import refuse_or_make_room, run_experiment
from rarms_iac.app.experiments.stopping import (
    PartitionStopper,
    StopConsent,
    finish_stop_or_start,
    is_for_measuring,
    never_consents,
    starting_again,
)
from rarms_iac.app.hosts import Hosts, host_errors, owner, refuse_unfinished
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.measurement_files import log_errors
from rarms_iac.app.report_measurements import fixed_on
from rarms_iac.app.report_model import FixedReservation
from rarms_iac.app.scripts import PlanScript
from rarms_iac.app.wiring import open_bench
from rarms_iac.measuring import findings
from rarms_iac.measuring.findings import findings_of
from rarms_iac.measuring.loop import shapes_for, work_in_test_partitions
from rarms_iac.measuring.partitions import host_budget, remove_test_partitions
from rarms_iac.measuring.setup import Experiment, experiment_of
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.outcomes import SettingFailed, Stopped
from rarms_iac.providers.measuring import MeasuringHost, ScriptedMeasuringHost
from rarms_iac.storage.datalog.log import Remeasurement


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasureOutcome:
    """The results of all experiments that were begun, and the experiments that an early end left out."""

    results: tuple[ExperimentResult, ...]
    findings: tuple[Diagnostic, ...]
    not_begun: tuple[Experiment, ...] = ()
    fixed: Mapping[str, tuple[FixedReservation, ...]] = field(default_factory=dict)  # by host, by the manifest itself
    ended: bool = False  # somebody asked for an end at a question

    @property
    def stopped(self) -> bool:
        """Whether somebody asked for an end."""
        return any(isinstance(result.conclusion, Stopped) for result in self.results)


EVERYTHING = MeasureRequest()
"""Each component with a threshold, on one host of each platform."""


def measure_components(
    hosts: Hosts,
    request: MeasureRequest = EVERYTHING,
    *,
    reporter: Reporter = SILENT,
    stop: StopSignal = NEVER_STOP,
    prompt: LevelPrompt | None = None,
    consents: StopConsent = never_consents,
) -> MeasureOutcome:
    """Find the least reservations at which components meet their thresholds, by running them.

    Each setting is recorded in its data log when it is complete. A run that was stopped or killed goes on when the
    same is asked again; no recorded setting is run twice. What follows for the components is written into the
    configuration logs.

    Args:
        hosts: Where it may be measured; they are held meanwhile.
        request: Which components, and how.
        reporter: Hears of every setting, and of what does not keep the work from going on.
        stop: Asked between settings and while samples come.
        prompt: Asks for a level of performance after each experiment; None: nobody is asked.
        consents: Whether partitions of the application that run there may be stopped meanwhile. They start again
            afterwards, however it ends; after a kill, with the next `measure`, `start` or `apply`.

    Returns:
        A result for each experiment that was begun. One that fails does not end the others.

    Raises:
        RequestError: A name is not in the manifest.
        UseCaseError: No host can be measured on (failed); a host is busy, held or has other reservations (refused);
            there is no threshold, no room or nothing to run, or a log is damaged (negative).
    """
    outcome, complete = _measure_all(hosts, request, reporter, stop, prompt, consents)
    record_reservations(hosts)
    if not outcome.stopped:
        end_remeasurements(hosts, complete, request)  # last of all: until then the same request goes on
    return outcome


def _measure_all(
    hosts: Hosts,
    request: MeasureRequest,
    reporter: Reporter,
    stop: StopSignal,
    prompt: LevelPrompt | None,
    consents: StopConsent,
) -> tuple[MeasureOutcome, Mapping[Path, Remeasurement]]:
    """The outcome, and by data log the remeasurements that nothing is left to do for."""
    experiments = experiments_of_request(hosts, request)
    results: list[ExperimentResult] = []
    findings: list[Diagnostic] = []
    complete: dict[Path, Remeasurement] = {}
    ended = False
    names = [experiment.host.name for experiment in experiments]
    stopper = PartitionStopper(hosts=hosts, reporter=reporter, consents=consents)
    with (
        hold_benches(hosts, names, request.lock_timeout_ms, reporter) as benches,
        starting_again(hosts, benches, reporter, stop) as still_stopped,
    ):
        remeasurements = _remeasurements(hosts, experiments, benches, request, stopper)
        for experiment in experiments:
            path, bench = data_log_path(hosts, experiment), benches[experiment.host.name]
            remeasurement = remeasurements.get(path)
            seeded = replace(request, seed=remeasurement.seed) if remeasurement else request
            with stop.gently():
                result = run_experiment(hosts, experiment, bench, seeded, reporter=reporter, stop=stop, stopper=stopper)
            is_stopped = isinstance(result.conclusion, Stopped)
            if remeasurement and not (is_stopped or isinstance(result.conclusion, SettingFailed)):
                complete[path] = remeasurement
            if prompt is not None and not is_stopped:

                def more(reserves: tuple[int, ...], measured: Experiment = experiment) -> ExperimentResult:
                    further = replace(request, reserves=reserves)
                    return _measured_on(hosts, measured, benches[measured.host.name], further, reporter, stop, stopper)

                result, ended = _with_levels(hosts, result, prompt, more)
                is_stopped = isinstance(result.conclusion, Stopped)
            findings += findings_of(experiment, result.conclusion, result.settings, hosts.manifest.places)
            results.append(result)
            if is_stopped or ended:
                break
    outcome = MeasureOutcome(
        results=tuple(results),
        findings=(*findings, *still_stopped),
        not_begun=experiments[len(results) :],
        fixed={name: fixed_on(hosts.system, name) for name in names},
        ended=ended,
    )
    return outcome, complete


def _with_levels(
    hosts: Hosts,
    result: ExperimentResult,
    prompt: LevelPrompt,
    measure: Callable[[tuple[int, ...]], ExperimentResult],
) -> tuple[ExperimentResult, bool]:
    """The result beside the levels that somebody chose, and whether they asked for an end."""
    try:
        return ask_levels(hosts, result, prompt, measure), False
    except SessionEnded:
        return result, True


def _measured_on(
    hosts: Hosts,
    experiment: Experiment,
    bench: MeasuringHost,
    request: MeasureRequest,
    reporter: Reporter,
    stop: StopSignal,
    stopper: PartitionStopper,
) -> ExperimentResult:
    """Measure these settings, or else search for the thresholds that the manifest has now; nothing is run twice."""
    fresh = replace(hosts, manifest=load_manifest(hosts.manifest.source))
    setup = experiment.setup
    again = experiment_of(fresh.system, experiment.host, setup.members, setup.interference, request.samples)
    further = replace(request, coarse=False, again=False)
    with stop.gently():
        return run_experiment(fresh, again, bench, further, reporter=reporter, stop=stop, stopper=stopper)


def _remeasurements(
    hosts: Hosts,
    experiments: Sequence[Experiment],
    benches: Mapping[str, MeasuringHost],
    request: MeasureRequest,
    stopper: PartitionStopper,
) -> Mapping[Path, Remeasurement]:
    """By data log; none where nothing is to be measured once more."""
    if not request.again:
        return {}

    def refuse(experiment: Experiment) -> None:
        refuse_or_make_room(hosts, experiment, benches[experiment.host.name], request, stopper)

    return remeasurements_for(hosts, experiments, benches, request, refuse)


def record_reservations(hosts: Hosts) -> None:
    """Write the reservations that follow from the data logs now into the configuration logs.

    Args:
        hosts: those of the manifest, which is read anew.

    Raises:
        UseCaseError: One of them is damaged (negative), or held by another run (refused).
    """
    manifest = load_manifest(hosts.manifest.source)  # a level may have been chosen meanwhile
    with log_errors():
        record_choices(measurements_of(manifest))


@contextmanager
def hold_benches(
    hosts: Hosts, names: Sequence[str], timeout_ms: int, reporter: Reporter
) -> Iterator[dict[str, MeasuringHost]]:
    """Hold hosts that are measured on, and remove what a killed measurement left there.

    Args:
        hosts: Those of the manifest.
        names: Of hosts that can be measured on; more than once is once.
        timeout_ms: How long to wait for another run.
        reporter: Hears what was removed.

    Yields:
        Once, the hosts by name; they are held until the context ends.

    Raises:
        UseCaseError: One is held by another run, or has an unfinished one (refused).
    """
    refuse_unfinished(hosts, unless=is_for_measuring)
    benches: dict[str, MeasuringHost] = {}
    with host_errors(), ExitStack() as locks:
        for name in sorted(set(names)):
            bench = open_bench(hosts.system, name, hosts.folder, hosts.state_path(name))
            assert bench is not None, "only hosts that can be measured on are chosen"
            locks.enter_context(bench.lock(owner(), timeout_ms))
            finish_stop_or_start(bench, reporter)
            if removed := remove_test_partitions(bench):
                message = f"{name}: {' and '.join(removed)}. What the earlier run recorded is kept and used."
                finding = findings.LEFT_BEHIND.at(None, message, "Nothing.", address=f"host/{name}")
                reporter.findings([finding])
            benches[name] = bench
        yield benches


def measuring_scripts(hosts: Hosts, request: MeasureRequest = EVERYTHING) -> tuple[PlanScript, ...]:
    """Return the scripts that `measure_components` would run on Hyper-V hosts; they are looked at, and nothing is run.

    One script measures an experiment: it makes P1 and P2, is told each setting, and removes them. A second one removes
    what a killed one left.

    Args:
        hosts: Where it may be measured.
        request: Which components, and how.

    Returns:
        `<host>.<experiment>.measure.ps1` and, once a host, `<host>.remove.measure.ps1`; inspected.

    Raises:
        RequestError: A name is not in the manifest, or no script would run, since rarms measures there itself.
        UseCaseError: No host can be measured on, or one cannot be observed (failed).
    """
    scripts: dict[str, PlanScript] = {}
    with host_errors():
        for experiment in experiments_of_request(hosts, request):
            name = experiment.host.name
            bench = open_bench(hosts.system, name, hosts.folder, hosts.state_path(name))
            if not isinstance(bench, ScriptedMeasuringHost):
                message = f"{experiment.name} is measured on {name} without a script: only Hyper-V hosts run scripts."
                raise RequestError(message)
            budget = host_budget(experiment.host, bench.observe(), experiment.application)
            shapes, work = shapes_for(experiment, budget), work_in_test_partitions(experiment)
            for title, text in (
                (experiment.name, bench.measuring_script(experiment.application, shapes, work)),
                ("remove", bench.measuring_script(experiment.application, (), ())),
            ):
                file = f"{name}.{title}.measure.ps1"
                scripts[file] = PlanScript(name=file, host=name, guest="", undo=False, text=text)
    return tuple(scripts.values())
