"""Measuring from the command line: experiments with their data logs, on hosts that are held meanwhile."""

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.hosts import Hosts, host_errors, owner, refuse_unfinished
from rarms_iac.app.measure import ExperimentResult
from rarms_iac.app.wiring import open_bench
from rarms_iac.cli.books import Kept, book_of, kept, path_for
from rarms_iac.cli.experiments import MeasureOptions
from rarms_iac.cli.locks import held_log
from rarms_iac.cli.session import Session
from rarms_iac.cli.telling import tell
from rarms_iac.measuring import findings
from rarms_iac.measuring.loop import MeasuringContext, Strategy, highest_seed, measure
from rarms_iac.measuring.partitions import (
    HostBudget,
    highest_reserve,
    host_budget,
    other_running_partitions,
    partition_name,
    remove_test_partitions,
)
from rarms_iac.measuring.search import STRATEGIES
from rarms_iac.measuring.setup import Experiment
from rarms_iac.measuring.strategies import Agreeing, Searching, Sweeping, Verifying, apts_of, goal_of
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.state import Partition
from rarms_iac.model.system import ProviderKind
from rarms_iac.planner.groups import groups_of
from rarms_iac.providers.measuring import MeasuringHost, PartitionWork
from rarms_iac.statistics.curves import curves_of, least_reserve
from rarms_iac.views.measuring_progress import MeasuringProgress

PAPER = "paper"
USUAL_SEED = 1


@contextmanager
def held_benches(
    session: Session, hosts: Hosts, names: Sequence[str], timeout_ms: int
) -> Iterator[dict[str, MeasuringHost]]:
    """These hosts, held, without unfinished runs and without what a killed measurement left there.

    Raises:
        UseCaseError: one is held by another run, or has an unfinished one (3).
    """
    refuse_unfinished(hosts)
    benches: dict[str, MeasuringHost] = {}
    with host_errors(), ExitStack() as held:
        for name in sorted(set(names)):
            bench = open_bench(hosts.system.hosts[name], hosts.folder, hosts.state_path(name))
            assert bench is not None, "only hosts that can be measured on are chosen"
            held.enter_context(bench.lock(owner(), timeout_ms))
            if left := remove_test_partitions(bench):
                says = f"{name}: {' and '.join(left)}. What the earlier run recorded is kept and used."
                tell(session.terminal, [findings.LEFT_BEHIND.at(None, says, "Nothing.", address=f"host/{name}")])
            benches[name] = bench
        yield benches


def run_experiment(
    session: Session,
    hosts: Hosts,
    experiment: Experiment,
    bench: MeasuringHost,
    options: MeasureOptions,
    strategy: Strategy | None = None,
) -> ExperimentResult:
    """Measure it as far as its data log does not say it already; `strategy`: None, as the options ask.

    Raises:
        UseCaseError: the host is busy or has other reservations (3); it has no room, there is nothing to run or to
            search for, or the log is damaged (4).
        HostError: the host did not do what was asked.
    """
    with held_log(Path(hosts.folder), path_for(hosts, experiment), options.lock_timeout_ms):
        return _measured(session, hosts, experiment, bench, options, strategy)


def _measured(
    session: Session,
    hosts: Hosts,
    experiment: Experiment,
    bench: MeasuringHost,
    options: MeasureOptions,
    strategy: Strategy | None,
) -> ExperimentResult:
    seen = _look(experiment, bench)
    recorded = kept(hosts, experiment, bench)
    book = book_of(recorded, options.seed, seen.running)
    if recorded.changed:
        session.terminal.talk(_told_stale(recorded))
    terminal = session.terminal

    def checked() -> HostBudget:
        _refuse(hosts, experiment, options, seen)
        return seen.room

    around = MeasuringContext(
        host=bench,
        budget=checked,
        seed=options.seed or highest_seed(book.settings()) or USUAL_SEED,
        reporter=MeasuringProgress(terminal.talk, time.monotonic, terminal.live_table()),
        should_stop=session.interrupts.should_stop,
        others=tuple(_going_on(hosts, seen.running)),
    )
    ended = measure(experiment, strategy or _strategy(hosts, experiment, options, seen), book, around)
    if ended.new and seen.running:
        tell(terminal, [_busy_warning(experiment, seen.running)])
    return ExperimentResult(
        experiment=experiment,
        conclusion=ended.conclusion,
        settings=ended.settings,
        new=ended.new,
        planned=least_reserve(curves_of(ended.settings, experiment.runs, apts_of(experiment))),
        log=book.path.as_posix(),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Seen:
    """What there is on the host."""

    room: HostBudget
    running: tuple[Partition, ...]  # what is in the way
    top: int  # the highest CR that it can give


def _look(experiment: Experiment, bench: MeasuringHost) -> _Seen:
    state = bench.observe()
    room = host_budget(experiment.host, state, experiment.application)
    return _Seen(room=room, running=other_running_partitions(state), top=highest_reserve(room, experiment.setup))


def refuse_what_cannot_run(hosts: Hosts, experiment: Experiment, bench: MeasuringHost, options: MeasureOptions) -> None:
    """Asked before anything is run.

    Raises:
        UseCaseError: the host is busy or has other reservations (3); there is no room, or nothing to run (4).
    """
    _refuse(hosts, experiment, options, _look(experiment, bench))


def _strategy(hosts: Hosts, experiment: Experiment, options: MeasureOptions, seen: _Seen) -> Strategy:
    """What the options ask for.

    Raises:
        UseCaseError: a search, and no threshold (4).
    """
    if options.reserves:
        return Sweeping(reserves=options.reserves)
    for member in experiment.members:
        if not member.apt:
            place = hosts.manifest.places.key("components", member.name)
            says = f"{member.name} has no `apt`."
            advice = f"Give it one, or measure chosen settings: rarms measure {member.name} --from 10% --to 100%."
            raise UseCaseError(
                Outcome.NEGATIVE,
                [findings.NO_THRESHOLD.at(place, says, advice, address=f"component/{member.name}")],
                hosts.manifest.sources,
            )
    goal = goal_of(experiment)
    # Where something is in the way it is refused, by name, before anything runs: that says more than a lack of room.
    refused = bool(seen.running) and not options.on_busy_host
    verifying = Verifying(goal=goal, most=100 if refused else seen.top)
    if options.verify:
        return verifying
    to_the_letter = options.strategy == PAPER
    search = Searching(
        goal=goal, next_step=STRATEGIES[options.strategy], most=seen.top, own_settings_only=to_the_letter
    )
    return search if to_the_letter else Agreeing(search=search, verifying=verifying)


def _refuse_what_has_no_demand(hosts: Hosts, experiment: Experiment) -> None:
    """NOTE: the host would refuse it, too; here the line of the manifest is told.

    Raises:
        UseCaseError: a member or the load is nothing that this host can run (4).
    """
    places, host = hosts.manifest.places, experiment.host
    for member in experiment.members:
        if host.provider is ProviderKind.SIMULATED and member.simulation is None:
            says = f"{host.name} is simulated, and {member.name} does not say what it demands there."
            advice = "Say it: `simulation: { work: 20 ms }`."
            found = findings.NOTHING_TO_RUN.at(
                places.key("components", member.name), says, advice, address=f"component/{member.name}"
            )
            raise UseCaseError(Outcome.NEGATIVE, [found], hosts.manifest.sources)


def _refuse(hosts: Hosts, experiment: Experiment, options: MeasureOptions, seen: _Seen) -> None:
    """Asked once something must really be run.

    Raises:
        UseCaseError: something runs on the host, or has reservations that the paper does not know (3); there is nothing
            to run, or no room (4).
    """
    _refuse_what_has_no_demand(hosts, experiment)
    host = experiment.host.name
    if seen.running and not options.on_busy_host:
        names = ", ".join(partition_name(partition) for partition in seen.running)
        says = f"On {host} these run, and would change what is measured: {names}."
        advice = (
            "Stop them: of the application's own, `rarms undo` takes the last apply back, and `rarms destroy` all of "
            "them. Or give --on-busy-host: the log says so."
        )
        raise UseCaseError(Outcome.REFUSED, [findings.BUSY_HOST.at(None, says, advice, address=f"host/{host}")])
    if options.strategy == PAPER and not options.reserves and not seen.room.unreserved:
        says = f"On {host} a part of the processors is kept for the host or reserved by other machines."
        advice = "Use the default strategy, or free the host: `keep_for_host: { processor: 0 % }`."
        raise UseCaseError(Outcome.REFUSED, [findings.RESERVED_HOST.at(None, says, advice, address=f"host/{host}")])
    if seen.top == 0 or (options.reserves and max(options.reserves) > seen.top):
        says = (
            f"{host} can give P1 at most {seen.top} % of each of its {experiment.setup.processors} processors, and P2 "
            "some memory beside it."
        )
        advice = "Stop other machines, lower keep_for_host, give the component less memory, or ask for lower settings."
        raise UseCaseError(Outcome.NEGATIVE, [findings.NO_ROOM.at(None, says, advice, address=f"host/{host}")])


def _going_on(hosts: Hosts, running: Sequence[Partition]) -> Iterator[PartitionWork]:
    """What the application's own partitions do meanwhile: their components, under names that nobody looks for.

    What machines of others do, nobody can say: a simulated host has them idle.
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


def _told_stale(recorded: Kept) -> str:
    what = "; ".join(str(one) for one in recorded.changed)
    return f"{recorded.path.as_posix()} is stale and is begun anew: {what}."


def _busy_warning(experiment: Experiment, running: Sequence[Partition]) -> Diagnostic:
    names = ", ".join(partition_name(partition) for partition in running)
    return findings.MEASURED_BUSY.at(
        None,
        f"{experiment.name} was measured while these ran on {experiment.host.name}: {names}. Its log says so.",
        "Measure it again on a quiet host with --again: then this no longer counts.",
        address=f"host/{experiment.host.name}",
    )
