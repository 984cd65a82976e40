"""Measuring: experiments with their data logs, on hosts that are held meanwhile.

Begin at `measure_components`. `run_experiment` is one experiment, for who asks for single settings as tuning does.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from rarms_iac.app.configuration_log import record_choices
from rarms_iac.app.control import NEVER_STOP, SILENT, Reporter, StopSignal
from rarms_iac.app.data_logs import measurements_of
from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.experiment_logs import (
    ExperimentLog,
    data_log_path,
    end_remeasurements,
    read_experiment_log,
    remeasurements_for,
    settings_log_of,
)
from rarms_iac.app.experiments import ExperimentResult, MeasureRequest, coarse_reserves, experiments_of_request
from rarms_iac.app.hosts import Hosts, host_errors, owner, refuse_unfinished
from rarms_iac.app.level_prompt import LevelPrompt, SessionEnded, ask_levels
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.measurement_files import hold_data_log, log_errors
from rarms_iac.app.report_measurements import fixed_on
from rarms_iac.app.report_model import FixedReservation
from rarms_iac.app.resting import (
    PartitionRest,
    StopConsent,
    at_rest,
    finish_rest,
    is_for_measuring,
    never_consents,
    starting_again,
)
from rarms_iac.app.wiring import open_bench
from rarms_iac.measuring import findings
from rarms_iac.measuring.duration import expected_duration
from rarms_iac.measuring.findings import findings_of
from rarms_iac.measuring.loop import MeasuringContext, SettingsLog, Strategy, highest_seed, measure
from rarms_iac.measuring.partitions import (
    MeasuringBudget,
    highest_reserve,
    host_budget,
    other_running_partitions,
    partition_name,
    remove_test_partitions,
)
from rarms_iac.measuring.search import STRATEGIES
from rarms_iac.measuring.settling import Settling
from rarms_iac.measuring.setup import Experiment, experiment_of
from rarms_iac.measuring.strategies import Agreeing, Searching, Sweeping, Verifying, apts_of, goal_of
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.outcomes import SettingFailed, Stopped
from rarms_iac.model.quantities import show_duration
from rarms_iac.model.state import Partition
from rarms_iac.model.wording import counted
from rarms_iac.planner.groups import groups_of
from rarms_iac.providers.measuring import MeasuringHost, PartitionWork
from rarms_iac.statistics.curves import curves_of, least_reserve
from rarms_iac.storage.datalog.log import Remeasurement

PAPER = "paper"
USUAL_SEED = 1


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
    rest = PartitionRest(hosts=hosts, reporter=reporter, consents=consents)
    with (
        hold_benches(hosts, names, request.lock_timeout_ms, reporter) as benches,
        starting_again(hosts, benches, reporter, stop),
    ):
        remeasurements = _remeasurements(hosts, experiments, benches, request, rest)
        for experiment in experiments:
            path, bench = data_log_path(hosts, experiment), benches[experiment.host.name]
            remeasurement = remeasurements.get(path)
            seeded = replace(request, seed=remeasurement.seed) if remeasurement else request
            with stop.gently():
                result = run_experiment(hosts, experiment, bench, seeded, reporter=reporter, stop=stop, rest=rest)
            is_stopped = isinstance(result.conclusion, Stopped)
            if remeasurement and not isinstance(result.conclusion, Stopped | SettingFailed):
                complete[path] = remeasurement
            if prompt is not None and not is_stopped:

                def more(
                    reserves: tuple[int, ...], bench: MeasuringHost = bench, experiment: Experiment = experiment
                ) -> ExperimentResult:
                    return _measured_on(
                        hosts, experiment, bench, replace(request, reserves=reserves), reporter, stop, rest
                    )

                try:
                    result = ask_levels(hosts, result, prompt, more)
                except SessionEnded:
                    ended = True
                is_stopped = isinstance(result.conclusion, Stopped)
            findings += findings_of(experiment, result.conclusion, result.settings, hosts.manifest.places)
            results.append(result)
            if is_stopped or ended:
                break
    not_begun = experiments[len(results) :]
    outcome = MeasureOutcome(
        results=tuple(results),
        findings=tuple(findings),
        not_begun=not_begun,
        fixed={name: fixed_on(hosts.system, name) for name in names},
        ended=ended,
    )
    return outcome, complete


def _measured_on(
    hosts: Hosts,
    experiment: Experiment,
    bench: MeasuringHost,
    request: MeasureRequest,
    reporter: Reporter,
    stop: StopSignal,
    rest: PartitionRest,
) -> ExperimentResult:
    """Measure these settings, or else search for the thresholds that the manifest has now; nothing is run twice."""
    fresh = replace(hosts, manifest=load_manifest(hosts.manifest.source))
    setup = experiment.setup
    again = experiment_of(fresh.system, experiment.host, setup.members, setup.interference, request.samples)
    further = replace(request, coarse=False, again=False)
    with stop.gently():
        return run_experiment(fresh, again, bench, further, reporter=reporter, stop=stop, rest=rest)


def _remeasurements(
    hosts: Hosts,
    experiments: Sequence[Experiment],
    benches: Mapping[str, MeasuringHost],
    request: MeasureRequest,
    rest: PartitionRest,
) -> Mapping[Path, Remeasurement]:
    """By data log; none where nothing is to be measured once more."""
    if not request.again:
        return {}

    def refuse(experiment: Experiment) -> None:
        bench = benches[experiment.host.name]
        _make_room(hosts, experiment, bench, request, _look_at_bench(experiment, bench, request), rest)

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
            bench = open_bench(hosts.system.hosts[name], hosts.folder, hosts.state_path(name))
            assert bench is not None, "only hosts that can be measured on are chosen"
            locks.enter_context(bench.lock(owner(), timeout_ms))
            finish_rest(bench, reporter)
            if removed := remove_test_partitions(bench):
                message = f"{name}: {' and '.join(removed)}. What the earlier run recorded is kept and used."
                finding = findings.LEFT_BEHIND.at(None, message, "Nothing.", address=f"host/{name}")
                reporter.findings([finding])
            benches[name] = bench
        yield benches


def run_experiment(
    hosts: Hosts,
    experiment: Experiment,
    bench: MeasuringHost,
    request: MeasureRequest,
    *,
    reporter: Reporter = SILENT,
    stop: StopSignal = NEVER_STOP,
    strategy: Strategy | None = None,
    rest: PartitionRest | None = None,
) -> ExperimentResult:
    """Measure an experiment as far as its data log does not say it already.

    Args:
        hosts: Those of the manifest.
        experiment: What is measured.
        bench: The host; the caller holds its lock.
        request: How.
        reporter: Hears of every setting.
        stop: Asked between settings and while samples come.
        strategy: Which settings; None: as the request says.
        rest: Stops what is in the way, where it may; None: nothing is stopped.

    Returns:
        How it ended, with every setting that this rests on, the recorded ones included.

    Raises:
        UseCaseError: The host is busy or has other reservations (refused); it has no room, there is nothing to run or
            to search for, or the log is damaged (negative).
        HostError: The host did not do what was asked.
    """
    with hold_data_log(Path(hosts.folder), data_log_path(hosts, experiment), request.lock_timeout_ms):
        return _run_held(hosts, experiment, bench, request, reporter, stop, strategy, rest)


def _run_held(
    hosts: Hosts,
    experiment: Experiment,
    bench: MeasuringHost,
    request: MeasureRequest,
    reporter: Reporter,
    stop: StopSignal,
    strategy: Strategy | None,
    rest: PartitionRest | None,
) -> ExperimentResult:
    seen = _look_at_bench(experiment, bench, request)
    log = read_experiment_log(hosts, experiment, bench)
    book = settings_log_of(log, request.seed, seen.running)
    if log.changed:
        reporter.message(_describe_stale(log))

    def checked() -> MeasuringBudget:
        _make_room(hosts, experiment, bench, request, seen, rest or PartitionRest(hosts=hosts, reporter=reporter))
        if strategy is None:  # who asks for single settings says himself what they are for
            reporter.message(_describe_duration(experiment, request, seen, book))
        return seen.budget

    around = MeasuringContext(
        host=bench,
        budget=checked,
        seed=request.seed or highest_seed(book.settings()) or USUAL_SEED,
        reporter=reporter.settings,
        should_stop=stop.should_stop,
        others=tuple(_going_on(hosts, seen.running)),
    )
    ended = measure(experiment, strategy or _strategy(hosts, experiment, request, seen), book, around)
    if ended.new and seen.running:
        reporter.findings([_busy_warning(experiment, seen.running)])
    return ExperimentResult(
        experiment=experiment,
        conclusion=ended.conclusion,
        settings=ended.settings,
        new=ended.new,
        planned=least_reserve(curves_of(ended.settings, experiment.runs, apts_of(experiment))),
        log=book.path.as_posix(),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _BenchState:
    """What there is on the host."""

    budget: MeasuringBudget
    running: tuple[Partition, ...]  # what is in the way and is not to be stopped
    top: int  # the highest CR that it can give
    memory_ms: float  # its scheduler's


def _look_at_bench(experiment: Experiment, bench: MeasuringHost, request: MeasureRequest) -> _BenchState:
    """Look at the host; partitions of the application rest, unless it is to be measured beside them."""
    seen = bench.observe()
    state = seen if request.on_busy_host else at_rest(seen, experiment.application)
    budget = host_budget(experiment.host, state, experiment.application)
    return _BenchState(
        budget=budget,
        running=other_running_partitions(state),
        top=highest_reserve(budget, experiment.setup),
        memory_ms=bench.scheduler_memory_ms,
    )


def _strategy(hosts: Hosts, experiment: Experiment, request: MeasureRequest, seen: _BenchState) -> Strategy:
    """What the options ask for.

    Raises:
        UseCaseError: a search, and no threshold (negative).
    """
    if request.coarse:
        return Sweeping(reserves=coarse_reserves(seen.top))
    if request.reserves:
        return Sweeping(reserves=request.reserves)
    for member in experiment.members:
        if not member.apt:
            place = hosts.manifest.places.key("components", member.name)
            message = f"{member.name} has no `apt`."
            advice = f"Give it one, or measure chosen settings: rarms measure {member.name} --from 10% --to 100%."
            raise UseCaseError(
                Outcome.NEGATIVE,
                [findings.NO_THRESHOLD.at(place, message, advice, address=f"component/{member.name}")],
                hosts.manifest.sources,
            )
    goal = goal_of(experiment)
    # Other partitions on the host: `_refuse` names them before the first run. Do not end earlier for lack of room,
    # which says less.
    refused = bool(seen.running) and not request.on_busy_host
    verifying = Verifying(goal=goal, most=100 if refused else seen.top)
    if request.verify:
        return verifying
    to_the_letter = request.strategy == PAPER
    search = Searching(
        goal=goal, next_step=STRATEGIES[request.strategy], most=seen.top, own_settings_only=to_the_letter
    )
    return search if to_the_letter else Agreeing(search=search, verifying=verifying)


def _refuse_what_has_no_demand(hosts: Hosts, experiment: Experiment) -> None:
    """Refuse a member without `simulation` on a simulated host.

    The host would refuse it too; here the line of the manifest can be named.

    Raises:
        UseCaseError: a member or the load is nothing that this host can run (negative).
    """
    places, host = hosts.manifest.places, experiment.host
    for member in experiment.members:
        if host.provider is ProviderKind.SIMULATED and member.simulation is None:
            message = f"{host.name} is simulated, and {member.name} does not say what it demands there."
            advice = "Say it: `simulation: { work: 20 ms }`."
            finding = findings.NOTHING_TO_RUN.at(
                places.key("components", member.name), message, advice, address=f"component/{member.name}"
            )
            raise UseCaseError(Outcome.NEGATIVE, [finding], hosts.manifest.sources)


def _make_room(
    hosts: Hosts,
    experiment: Experiment,
    bench: MeasuringHost,
    request: MeasureRequest,
    seen: _BenchState,
    rest: PartitionRest,
) -> None:
    """Refuse what cannot be measured, then stop what is in the way. Asked once something must really be run.

    Raises:
        UseCaseError: As `_refuse`; partitions of the application run, and may not be stopped (refused).
    """
    _refuse(hosts, experiment, request, seen)
    if request.on_busy_host:
        return
    if still_running := rest.stop(bench):
        message = f"On {bench.name} these run, and would change what is measured: {', '.join(still_running)}."
        advice = (
            f"Let `rarms {rest.command} --stop-partitions` stop them and start them again afterwards, or do it "
            "yourself: `rarms stop`, later `rarms start`."
        )
        address = f"host/{bench.name}"
        raise UseCaseError(Outcome.REFUSED, [findings.BUSY_HOST.at(None, message, advice, address=address)])


def _refuse(hosts: Hosts, experiment: Experiment, request: MeasureRequest, seen: _BenchState) -> None:
    """Asked once something must really be run.

    Raises:
        UseCaseError: Something runs on the host, or it has reservations that the paper does not know (refused);
            there is nothing to run, or no room (negative).
    """
    _refuse_what_has_no_demand(hosts, experiment)
    host = experiment.host.name
    if seen.running and not request.on_busy_host:
        names = ", ".join(partition_name(partition) for partition in seen.running)
        message = f"On {host} these run, and would change what is measured: {names}."
        advice = "Stop them on the host. Or give --on-busy-host: the log says so."
        raise UseCaseError(Outcome.REFUSED, [findings.BUSY_HOST.at(None, message, advice, address=f"host/{host}")])
    if request.strategy == PAPER and not request.reserves and not seen.budget.unreserved:
        message = f"On {host} a part of the processors is kept for the host or reserved by other machines."
        advice = "Use the default strategy, or free the host: `keep_for_host: { processor: 0 % }`."
        raise UseCaseError(Outcome.REFUSED, [findings.RESERVED_HOST.at(None, message, advice, address=f"host/{host}")])
    if seen.top == 0 or (request.reserves and max(request.reserves) > seen.top):
        message = (
            f"{host} can give P1 at most {seen.top} % of each of its {experiment.setup.processors} processors, and P2 "
            "some memory beside it."
        )
        advice = "Stop other machines, lower keep_for_host, give the component less memory, or ask for lower settings."
        raise UseCaseError(Outcome.NEGATIVE, [findings.NO_ROOM.at(None, message, advice, address=f"host/{host}")])


def _describe_duration(experiment: Experiment, request: MeasureRequest, seen: _BenchState, book: SettingsLog) -> str:
    """Say how long measuring takes, at least and at most."""
    bounds = expected_duration(
        experiment,
        book.settings(),
        coarse_reserves(seen.top) if request.coarse else request.reserves,
        top=seen.top,
        to_the_letter=request.strategy == PAPER,
        earlier=replace(book, seed=None).settings(),
        settles_ms=Settling(memory_ms=seen.memory_ms).least_ms,
    )
    settings = counted(bounds.most_settings, "setting")
    if bounds.least_settings != bounds.most_settings:
        settings = f"{bounds.least_settings} to {settings}"
    least = f"{show_duration(bounds.least_ms)} to " if bounds.least_ms else "at most "
    clock = " (simulated)" if experiment.host.provider is ProviderKind.SIMULATED else ""
    most = f"{show_duration(bounds.most_ms)}{clock}"
    return f"{experiment.name} on {experiment.host.name}: {settings}, {least}{most}."


def _going_on(hosts: Hosts, running: Sequence[Partition]) -> Iterator[PartitionWork]:
    """Yield what the application's own partitions do meanwhile: their components, under names that nobody looks for.

    What machines of others do is not known: a simulated host has them idle.
    """
    application = hosts.system.application.name
    names = {
        partition.mark.name for partition in running if partition.mark and partition.mark.application == application
    }
    for group in groups_of(hosts.system):
        if group.name in names:
            members = tuple(
                replace(member, name=f"{member.name} in {group.name}")
                for member in group.members
                if member.simulation is not None
            )
            yield PartitionWork(partition=group.name, components=members)


def _describe_stale(log: ExperimentLog) -> str:
    changes = "; ".join(map(str, log.changed))
    return f"{log.path.as_posix()} is stale and is begun anew: {changes}."


def _busy_warning(experiment: Experiment, running: Sequence[Partition]) -> Diagnostic:
    names = ", ".join(partition_name(partition) for partition in running)
    return findings.MEASURED_BUSY.at(
        None,
        f"{experiment.name} was measured while these ran on {experiment.host.name}: {names}. Its log says so.",
        "Measure it again on a quiet host with --again: then this no longer counts.",
        address=f"host/{experiment.host.name}",
    )
