"""One experiment on a held host: what is in the way is refused or stopped, then setting after setting is run.

Begin at `run_experiment`. Which experiments there are, and in which order, is for `measure` and for tuning to say.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rarms_iac.app.control import NEVER_STOP, SILENT, Reporter, StopSignal
from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.experiments.experiment_log import ExperimentLog, data_log_path, read_experiment_log, settings_log_of
from rarms_iac.app.experiments.measure_request import USUAL_SEED, ExperimentResult, MeasureRequest, coarse_reserves
from rarms_iac.app.experiments.stopping import PartitionStopper, stopped_to_measure
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.measurement_files import hold_data_log
from rarms_iac.measuring import findings
from rarms_iac.measuring.duration import expected_duration
from rarms_iac.measuring.loop import MeasuringContext, SettingsLog, Strategy, measure
from rarms_iac.measuring.partitions import (
    MeasuringBudget,
    highest_reserve,
    host_budget,
    other_running_partitions,
    partition_name,
)
from rarms_iac.measuring.search import STRATEGIES
from rarms_iac.measuring.settling import Settling
from rarms_iac.measuring.setup import Experiment
from rarms_iac.measuring.strategies import Agreeing, Searching, Sweeping, Verifying, apts_of, goal_of
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.quantities import show_duration
from rarms_iac.model.state import Partition
from rarms_iac.model.wording import counted
from rarms_iac.planner.groups import groups_of
from rarms_iac.providers.measuring import MeasuringHost, PartitionWork
from rarms_iac.statistics.curves import curves_of, least_reserve

PAPER = "paper"


def run_experiment(
    hosts: Hosts,
    experiment: Experiment,
    bench: MeasuringHost,
    request: MeasureRequest,
    *,
    reporter: Reporter = SILENT,
    stop: StopSignal = NEVER_STOP,
    strategy: Strategy | None = None,
    stopper: PartitionStopper | None = None,
) -> ExperimentResult:
    """Measure an experiment as far as its data log does not say it already.

    Args:
        hosts: Those of the manifest.
        experiment: What is measured.
        bench: The host; the caller holds its lock.
        request: The options: reserves, strategy, seed, what is done on a busy host.
        reporter: Hears of every setting.
        stop: Asked between settings and while samples come.
        strategy: Which settings are measured; None: as the request says.
        stopper: Stops partitions of the application, where it may; None: nothing is stopped.

    Returns:
        How it ended, with every setting that this rests on, the recorded ones included.

    Raises:
        UseCaseError: The host is busy or has other reservations (refused); it has no room, there is nothing to run or
            to search for, or the log is damaged (negative).
        HostError: The host did not do what was asked.
    """
    with hold_data_log(Path(hosts.folder), data_log_path(hosts, experiment), request.lock_timeout_ms):
        return _run_held(hosts, experiment, bench, request, reporter, stop, strategy, stopper)


def refuse_or_make_room(
    hosts: Hosts, experiment: Experiment, bench: MeasuringHost, request: MeasureRequest, stopper: PartitionStopper
) -> None:
    """Refuse what cannot be measured, and stop what is in the way; nothing is run.

    Args:
        hosts: Those of the manifest.
        experiment: What is to be measured.
        bench: The host; the caller holds its lock.
        request: How.
        stopper: Stops partitions of the application, where it may.

    Raises:
        UseCaseError: As `run_experiment`.
    """
    _make_room(hosts, experiment, bench, request, _look_at_bench(experiment, bench, request), stopper)


def _run_held(
    hosts: Hosts,
    experiment: Experiment,
    bench: MeasuringHost,
    request: MeasureRequest,
    reporter: Reporter,
    stop: StopSignal,
    strategy: Strategy | None,
    stopper: PartitionStopper | None,
) -> ExperimentResult:
    bench_state = _look_at_bench(experiment, bench, request)
    log = read_experiment_log(hosts, experiment, bench)
    settings_log = settings_log_of(log, request.seed, bench_state.running)
    if log.changed:
        reporter.message(_describe_stale(log))

    def checked() -> MeasuringBudget:
        _make_room(
            hosts, experiment, bench, request, bench_state, stopper or PartitionStopper(hosts=hosts, reporter=reporter)
        )
        if strategy is None:  # a caller with its own strategy tells the user itself what it measures
            reporter.message(_describe_duration(experiment, request, bench_state, settings_log))
        return bench_state.budget

    context = MeasuringContext(
        host=bench,
        budget=checked,
        seed=request.seed or max((setting.seed for setting in settings_log.settings()), default=0) or USUAL_SEED,
        reporter=reporter.settings,
        should_stop=stop.should_stop,
        others=tuple(_work_beside(hosts, bench_state.running)),
    )
    measurement = measure(
        experiment, strategy or _strategy(hosts, experiment, request, bench_state), settings_log, context
    )
    if measurement.new and bench_state.running:
        reporter.findings([_busy_warning(experiment, bench_state.running)])
    return ExperimentResult(
        experiment=experiment,
        conclusion=measurement.conclusion,
        settings=measurement.settings,
        new=measurement.new,
        planned=least_reserve(curves_of(measurement.settings, experiment.runs, apts_of(experiment))),
        log=settings_log.path.as_posix(),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _BenchState:
    """What is free on the host, and what is in the way there."""

    budget: MeasuringBudget
    running: tuple[Partition, ...]  # what is in the way and is not to be stopped
    highest_reserve: int  # the highest CR that it can give
    memory_ms: float  # how long its scheduler remembers (`MeasuringHost.scheduler_memory_ms`)


def _look_at_bench(experiment: Experiment, bench: MeasuringHost, request: MeasureRequest) -> _BenchState:
    """Look at the host; partitions of the application are stopped, unless it is to be measured beside them."""
    observed = bench.observe()
    state = observed if request.on_busy_host else stopped_to_measure(observed, experiment.application)
    budget = host_budget(experiment.host, state, experiment.application)
    return _BenchState(
        budget=budget,
        running=other_running_partitions(state),
        highest_reserve=highest_reserve(budget, experiment.setup),
        memory_ms=bench.scheduler_memory_ms,
    )


def _strategy(hosts: Hosts, experiment: Experiment, request: MeasureRequest, bench_state: _BenchState) -> Strategy:
    """What the options ask for.

    Raises:
        UseCaseError: a search is asked for, and a member has no threshold (negative).
    """
    if request.coarse:
        return Sweeping(reserves=coarse_reserves(bench_state.highest_reserve))
    if request.reserves:
        return Sweeping(reserves=request.reserves)
    for member in experiment.members:
        if not member.apt:
            place = hosts.manifest.places.key("components", member.name)
            message = f"{member.name} has no `apt`."
            advice = f"Give it one, or measure chosen settings: `rarms measure {member.name} --from 10% --to 100%`."
            raise UseCaseError(
                Outcome.NEGATIVE,
                [findings.NO_THRESHOLD.at(place, message, advice, address=f"component/{member.name}")],
                hosts.manifest.sources,
            )
    goal = goal_of(experiment)
    # Other partitions on the host: `_refuse_host` names them before the first run. Do not end earlier for lack of room,
    # which says less.
    refused = bool(bench_state.running) and not request.on_busy_host
    verifying = Verifying(goal=goal, most=100 if refused else bench_state.highest_reserve)
    if request.verify:
        return verifying
    in_paper_steps = request.strategy == PAPER
    search = Searching(
        goal=goal,
        next_step=STRATEGIES[request.strategy],
        most=bench_state.highest_reserve,
        own_settings_only=in_paper_steps,
    )
    return search if in_paper_steps else Agreeing(search=search, verifying=verifying)


def _refuse_what_cannot_run(hosts: Hosts, experiment: Experiment, bench: MeasuringHost) -> None:
    """Refuse a member or a load that the host cannot run.

    The host would refuse it too; here the line of the manifest can be named, and nothing was changed yet.

    Raises:
        UseCaseError: there is such a member or load (negative).
    """
    members = [("components", member.name, member) for member in experiment.members]
    for section, name, subject in [*members, ("interference", experiment.setup.interference, experiment.load)]:
        if obstacle := bench.obstacle(subject):
            finding = findings.NOTHING_TO_RUN.at(
                hosts.manifest.places.key(section, name),
                f"{bench.name} cannot run {name}: {obstacle.reason}.",
                obstacle.advice,
                address=f"{section.removesuffix('s')}/{name}",
            )
            raise UseCaseError(Outcome.NEGATIVE, [finding], hosts.manifest.sources)


def _make_room(
    hosts: Hosts,
    experiment: Experiment,
    bench: MeasuringHost,
    request: MeasureRequest,
    bench_state: _BenchState,
    stopper: PartitionStopper,
) -> None:
    """Refuse what cannot be measured, then stop what is in the way.

    `run_experiment` calls it only where the data log does not hold every setting already.

    Raises:
        UseCaseError: As `_refuse_what_cannot_run` and `_refuse_host`; partitions of the application run, and may not be
            stopped (refused).
    """
    _refuse_what_cannot_run(hosts, experiment, bench)
    _refuse_host(experiment, request, bench_state)
    if request.on_busy_host:
        return
    if still_running := stopper.stop(bench):
        message = f"On {bench.name} these run, and would change what is measured: {', '.join(still_running)}."
        advice = (
            f"Let `rarms {stopper.command} --stop-partitions` stop them and start them again afterwards, or do it "
            "yourself: `rarms stop`, later `rarms start`."
        )
        address = f"host/{bench.name}"
        raise UseCaseError(Outcome.REFUSED, [findings.BUSY_HOST.at(None, message, advice, address=address)])


def _refuse_host(experiment: Experiment, request: MeasureRequest, bench_state: _BenchState) -> None:
    """Refuse a host that is busy, has reservations that the paper does not know, or has no room.

    Raises:
        UseCaseError: Something runs on the host, or it has reservations that the paper does not know (refused);
            there is no room (negative).
    """
    host = experiment.host.name
    if bench_state.running and not request.on_busy_host:
        names = ", ".join(partition_name(partition) for partition in bench_state.running)
        message = f"On {host} these run, and would change what is measured: {names}."
        advice = "Stop them on the host. Or give --on-busy-host: the log says so."
        raise UseCaseError(Outcome.REFUSED, [findings.BUSY_HOST.at(None, message, advice, address=f"host/{host}")])
    if request.strategy == PAPER and not request.reserves and not bench_state.budget.unreserved:
        message = f"On {host} a part of the processors is kept for the host or reserved by other machines."
        advice = "Use the default strategy, or free the host: `keep_for_host: { processor: 0 % }`."
        raise UseCaseError(Outcome.REFUSED, [findings.RESERVED_HOST.at(None, message, advice, address=f"host/{host}")])
    if bench_state.highest_reserve == 0 or (request.reserves and max(request.reserves) > bench_state.highest_reserve):
        message = (
            f"{host} can give P1 at most {bench_state.highest_reserve} % of each of its "
            f"{experiment.setup.processors} processors, "
            "and P2 some memory beside it."
        )
        advice = "Stop other machines, lower keep_for_host, give the component less memory, or ask for lower settings."
        raise UseCaseError(Outcome.NEGATIVE, [findings.NO_ROOM.at(None, message, advice, address=f"host/{host}")])


def _describe_duration(
    experiment: Experiment, request: MeasureRequest, bench_state: _BenchState, settings_log: SettingsLog
) -> str:
    """Say how long measuring takes: at least, while jobs are as fast as they should be, and at most."""
    bounds = expected_duration(
        experiment,
        settings_log.settings(),
        coarse_reserves(bench_state.highest_reserve) if request.coarse else request.reserves,
        highest=bench_state.highest_reserve,
        in_paper_steps=request.strategy == PAPER,
        earlier=replace(settings_log, seed=None).settings(),
        settles_ms=Settling(memory_ms=bench_state.memory_ms).least_ms,
    )
    settings = counted(bounds.most_settings, "setting")
    if bounds.least_settings != bounds.most_settings:
        settings = f"{bounds.least_settings} to {settings}"
    least = f"{show_duration(bounds.least_ms)} to " if 0 < bounds.least_ms < bounds.most_ms else ""
    clock = " (simulated)" if experiment.host.provider is ProviderKind.SIMULATED else ""
    most = show_duration(bounds.most_ms)
    most = f"{most}, as only `run.timeout` bounds a job" if bounds.by_timeout else f"about {most}"
    return f"{experiment.name} on {experiment.host.name}{clock}: {settings}, {least}{most}."


def _work_beside(hosts: Hosts, running: Sequence[Partition]) -> Iterator[PartitionWork]:
    """Yield the work of the application's partitions that go on running, their components under names of their own.

    What other partitions run is not known: a simulated host has them idle.
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
