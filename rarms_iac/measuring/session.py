"""A session of measuring: the hosts that one command holds, and the partitions that it stops and starts there.

A partition's mark says that a measurement stopped it before it is stopped, and until it runs again. So after a kill at
any moment the next `measure`, `start` or `apply` starts it.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from rarms_iac.app.control import UNATTENDED, Control
from rarms_iac.app.decision_logs import record_choices
from rarms_iac.app.hosts import Hosts, host_errors, refuse_unfinished, run_origin
from rarms_iac.app.manifests import Manifest, unaccepted_short_secrets
from rarms_iac.app.measurement_files import log_errors
from rarms_iac.app.planning import plan_from_states, plan_request
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.applying import refusals
from rarms_iac.applying.execute import apply_plan
from rarms_iac.applying.requested_changes import stopped_partition
from rarms_iac.applying.run_report import RunEnding
from rarms_iac.diff.disruption import grace_ms
from rarms_iac.diff.step_context import claim_of
from rarms_iac.measuring import findings
from rarms_iac.measuring.duration import WallTimes
from rarms_iac.measuring.findings import OCCUPIED, UNABLE
from rarms_iac.measuring.partitions import MEASURING, remove_test_partitions
from rarms_iac.model.capacity import capacity_of, fits, foreign_claims
from rarms_iac.model.commands import PLAN, START, command, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.host import Host, ProviderKind, SimulatedHost
from rarms_iac.model.loads import Interference
from rarms_iac.model.operations import StartPartition, StopPartition, WriteMark
from rarms_iac.model.plan import Purpose, Scope
from rarms_iac.model.state import Partition, State, StoppedBy
from rarms_iac.model.system import Component
from rarms_iac.model.wording import in_a_row, natural_order
from rarms_iac.planner.groups import groups_of
from rarms_iac.providers.measuring import MeasuringHost, ScriptedMeasuringHost, StepwiseMeasuringHost
from rarms_iac.storage.datalog.log import Remeasurement
from rarms_iac.storage.writing import owner


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuringSession:
    """Where and how a command measures."""

    hosts: Hosts
    control: Control = UNATTENDED
    command: Literal["measure", "tune", "prove"] = "measure"
    seed: int | None = None  # of the random numbers; None: the largest that settings in the log have, or the usual one
    remeasurements: Mapping[Path, Remeasurement] = field(default_factory=dict)  # by data log that is measured again
    on_busy_host: bool = False  # measure although other partitions run there
    lock_timeout_ms: int = 0  # how long to wait for another run, at a host and at a data log
    wall_times: WallTimes = field(default_factory=WallTimes)  # of the settings that this command has run
    held_hosts: Mapping[str, MeasuringHost] = field(default_factory=dict)  # by name; their locks are held

    @property
    def application(self) -> str:
        """The name of the manifest's application."""
        return self.hosts.system.application.name

    def host_of(self, experiment: Experiment) -> MeasuringHost:
        """Return the held host that an experiment is run on."""
        return self.held_hosts[experiment.host.name]


UNMODELLED_SMT = (
    "`smt: true` says which logical processors share a core, and so what partitions take of the host. What is measured "
    "there does not change by it: the simulation runs every logical processor at full speed."
)


@contextmanager
def hold_measuring_hosts(session: MeasuringSession, names: Iterable[str]) -> Iterator[MeasuringSession]:
    """Hold hosts that are measured on, and remove what a killed measurement left there.

    Args:
        session: It holds no host yet; its reporter hears what was removed.
        names: Hosts that can be measured on; a name may be repeated.

    Yields:
        Once, the session with these hosts; they are held until the context ends.

    Raises:
        UseCaseError: A host is held by another run, or has an unfinished run (refused); or what a `HostError` inside
            the context becomes.
    """
    refuse_unfinished(session.hosts)
    held: dict[str, MeasuringHost] = {}
    with host_errors(), ExitStack() as locks:
        for name in sorted(set(names)):
            host = session.hosts.open_to_measure(name)
            assert host is not None, "only hosts that can be measured on are chosen"
            locks.enter_context(host.lock(owner(), session.lock_timeout_ms))
            # A run may have begun, and been killed, while the lock was waited for.
            if isinstance(host, StepwiseMeasuringHost) and (run := host.unfinished()) is not None:
                raise UseCaseError(Outcome.REFUSED, [refusals.unfinished(name, run)])
            if removed := remove_test_partitions(host):
                session.control.reporter.message(f"{name}: {' and '.join(removed)}. Earlier results are kept and used.")
            held[name] = host
            settings = session.hosts.system.hosts[name].settings
            if isinstance(settings, SimulatedHost) and settings.smt:
                session.control.reporter.message(f"{name}: {UNMODELLED_SMT}")
        yield replace(session, held_hosts=held)


def short_secrets_of(manifest: Manifest, started: Iterable[tuple[Host, str]]) -> tuple[Diagnostic, ...]:
    """Return the findings on short secrets of components that run as processes: those of no simulated host.

    Args:
        started: Hosts with the names of the components that run on them.
    """
    names = dict.fromkeys(name for host, name in started if host.provider is not ProviderKind.SIMULATED)
    return unaccepted_short_secrets(manifest, [manifest.system.components[name] for name in names])


def no_measurable_host(hosts: Hosts, advice: str) -> UseCaseError:
    """Make the error that rarms can run components on none of the chosen hosts (failed)."""
    template, names = "rarms can run components on none of these hosts: {_names}.", ", ".join(hosts.chosen)
    chosen = tuple(hosts.chosen)
    return UseCaseError(
        Outcome.FAILED, [UNABLE.at(None, template, advice, hosts=chosen, _names=names or "there are none")]
    )


def refuse_what_cannot_run(
    session: MeasuringSession,
    host: MeasuringHost,
    *,
    components: Mapping[str, Component] = MappingProxyType({}),
    loads: Mapping[str, Interference] = MappingProxyType({}),
    in_their_partitions: bool = False,
) -> None:
    """Refuse a component or a load that a host cannot run.

    The host would refuse it too; here the line of the manifest can be named, and nothing was changed yet.

    Args:
        loads: By name; they run in test partitions.
        in_their_partitions: Whether the components are to run in those that were applied for them.

    Raises:
        UseCaseError: There is such a component or load (negative).
    """
    manifest = session.hosts.manifest
    named = [("components", name, component) for name, component in components.items()]
    for section, name, subject in [*named, *(("interference", name, load) for name, load in loads.items())]:
        in_its_partition = in_their_partitions and section == "components"
        if obstacle := host.obstacle(subject, in_its_partition=in_its_partition):
            finding = UNABLE.at(
                manifest.places.key(section, name),
                "{host} cannot run {name}: {reason}.",
                obstacle.advice,
                address=f"{section.removesuffix('s')}/{name}",
                host=host.name,
                name=name,
                reason=obstacle.reason,
            )
            raise UseCaseError(Outcome.NEGATIVE, [finding], manifest.sources)


def stop_own_partitions(session: MeasuringSession, host: MeasuringHost) -> None:
    """Stop what runs of the application on a held host, if that is consented to.

    Raises:
        UseCaseError: Without consent, or they cannot be stopped (refused or failed).
    """
    state = host.observe()
    names = own_running(state, session.application)
    if not names:
        return
    _refuse_without_return(session, host, state, names)
    if not session.control.consents(host.name, names):
        raise UseCaseError(
            Outcome.REFUSED,
            [
                OCCUPIED.of_host(
                    host.name,
                    "On {host} these run, and would change what is measured: {_names}.",
                    prose(
                        "Let ",
                        command(session.command, stop_partitions=True),
                        " stop them and start them again afterwards, or do it yourself: ",
                        command("stop"),
                        ", later ",
                        START,
                        ".",
                    ),
                    partitions=names,
                    _names=", ".join(names),
                )
            ],
        )
    stop_to_measure(session.hosts, host, names)
    message = f"{host.name}: stopped {in_a_row(names)} to measure. They start again afterwards."
    session.control.reporter.message(message)


def _refuse_without_return(
    session: MeasuringSession, host: MeasuringHost, state: State, names: tuple[str, ...]
) -> None:
    """Refuse to stop partitions that could not be started again: they run, and the host has less to promise since.

    Raises:
        UseCaseError: They have no room by the manifest (refused).
    """
    running = [each for each in state.of(session.application).partitions if each.settings.running]
    if _have_room(session.hosts.system.hosts[host.name], state, session.application, running):
        return
    raise UseCaseError(
        Outcome.REFUSED,
        [
            OCCUPIED.of_host(
                host.name,
                "On {host} these run, and could not be started again after measuring: {_names}. The host has no room "
                "for them by the manifest.",
                prose(PLAN, " shows what is too much. Correct the manifest before you measure."),
                partitions=names,
                _names=", ".join(names),
            )
        ],
    )


@contextmanager
def starting_again(session: MeasuringSession) -> Iterator[list[Diagnostic]]:
    """Start, at the end, what this measurement or one that was killed stopped on the held hosts.

    Args:
        session: Its hosts must still be held at the end. Its reporter hears what was started; after an exception, what
            could not be started, too. A request to stop waits until all are started.

    Yields:
        Once, a list that holds after the end an error for each host where partitions could not be started, and why.
    """
    errors: list[Diagnostic] = []
    try:
        yield errors
    except BaseException:
        session.control.reporter.findings(_start_all(session), session.hosts.manifest.sources)
        raise
    errors += _start_all(session)


def _start_all(session: MeasuringSession) -> list[Diagnostic]:
    errors: list[Diagnostic] = []
    with session.control.stop.gently():
        for host in session.held_hosts.values():
            try:
                names = start_again(session.hosts, host)
            except UseCaseError as error:
                errors += error.findings
                continue
            if names:
                message = f"{host.name}: started {in_a_row(names)} again, which a measurement had stopped."
                session.control.reporter.message(message)
    return errors


def stop_to_measure(hosts: Hosts, host: MeasuringHost, names: tuple[str, ...]) -> None:
    """Stop partitions of the application, the least critical first, and mark them as stopped by a measurement.

    Raises:
        UseCaseError: They cannot be stopped (refused or failed).
    """
    if isinstance(host, ScriptedMeasuringHost):
        _run_script(hosts, host, Purpose.STOP, names)
        return
    with host_errors():
        for partition in _by_criticality(hosts, host.observe(), names):
            _set_mark(host, partition, StoppedBy.MEASUREMENT)
            entry = hosts.system.partitions.get(partition.shown_name)
            graces = {} if entry is None else {partition.shown_name: entry.stop.grace}
            grace = grace_ms(graces, partition.shown_name) if partition.can_be_asked else 0
            stop = StopPartition(partition=partition.shown_name, grace_ms=grace, machine=partition.id)
            host.execute(stop, _scope(partition))


def start_again(hosts: Hosts, host: MeasuringHost) -> tuple[str, ...]:
    """Start the partitions of the application that a measurement stopped on this host, the most critical first.

    Returns:
        Their names, sorted; none where none is stopped.

    Raises:
        UseCaseError: They cannot be started; its first finding says so, the others why.
    """
    state = host.observe()
    names = stopped_by_measurement(state, hosts.system.application.name)
    stopped = _by_criticality(hosts, state, names)[::-1]
    if names and not _have_room(hosts.system.hosts[host.name], state, hosts.system.application.name, stopped):
        raise UseCaseError(Outcome.REFUSED, [_still_stopped(host.name, names, " The host has no room for them now.")])
    try:
        if names and isinstance(host, ScriptedMeasuringHost):
            _run_script(hosts, host, Purpose.START, names)
        elif isinstance(host, StepwiseMeasuringHost):
            for partition in stopped:
                _start(host, partition)
    except UseCaseError as error:
        raise UseCaseError(error.outcome, (_still_stopped(host.name, names), *error.findings)) from None
    return names


def _start(host: StepwiseMeasuringHost, partition: Partition) -> None:
    """Start a partition, unless a killed measurement marked it and did not stop it yet; then correct its mark."""
    with host_errors():
        if not partition.settings.running:
            start = StartPartition(partition=partition.shown_name, machine=partition.id)
            host.execute(start, _scope(partition))
        _set_mark(host, partition, StoppedBy.NO_USER)


def _still_stopped(host: str, names: tuple[str, ...], why: str = "") -> Diagnostic:
    template = "On {host} these were stopped to measure, and could not be started: {_names}.{_why}"
    advice = prose("Correct what prevents it, then start them: ", command("start", *names), ".")
    return findings.STILL_STOPPED.of_host(host, template, advice, partitions=names, _names=", ".join(names), _why=why)


def _by_criticality(hosts: Hosts, state: State, names: Collection[str]) -> list[Partition]:
    """Return these partitions of the application, the least critical first."""
    criticality = {group.name: group.criticality for group in groups_of(hosts.system)}
    own = [each for each in state.of(hosts.system.application.name).partitions if each.shown_name in names]
    return sorted(own, key=lambda each: (criticality.get(each.shown_name, 0), each.shown_name))


def _have_room(host: Host, state: State, application: str, to_run: Sequence[Partition]) -> bool:
    """Tell whether the host can keep its promises to these partitions and to all that run there.

    Other partitions of the application count only while they run, as when `rarms start` starts these.
    """
    own = [claim_of(each) for each in state.of(application).partitions if each not in to_run]
    claims = (*foreign_claims(state, application), *own, *(each.claim for each in to_run))
    return fits(capacity_of(host, state.facts), claims)


def _set_mark(host: StepwiseMeasuringHost, partition: Partition, stopped_by: StoppedBy) -> None:
    """Write who stopped a partition; all else in its mark stays."""
    mark = partition.mark
    assert mark is not None, "partitions of the application have marks"
    operation = WriteMark(
        partition=mark.name,
        application=mark.application,
        name=mark.name,
        set=mark.set,
        stopped_by=stopped_by,
        robot=mark.robot,
        protected=mark.protected,
        machine=partition.id,
    )
    host.execute(operation, _scope(partition))


def _scope(partition: Partition) -> Scope:
    return Scope(application=partition.mark.application if partition.mark else "", plan=MEASURING)


def own_running(state: State, application: str) -> tuple[str, ...]:
    """Name the partitions of an application that run on a host, in order."""
    return _names(each for each in state.of(application).partitions if each.settings.running)


def stopped_by_measurement(state: State, application: str) -> tuple[str, ...]:
    """Name the partitions of an application that a measurement stopped and has not started again, in order."""
    own = state.of(application).partitions
    return _names(each for each in own if each.mark and each.mark.stopped_by is StoppedBy.MEASUREMENT)


def _names(partitions: Iterable[Partition]) -> tuple[str, ...]:
    return tuple(sorted((each.mark.name for each in partitions if each.mark), key=natural_order))


def stopped_to_measure(state: State, application: str) -> State:
    """Return what a host looks like once the partitions of an application that run have been stopped to measure.

    Returns:
        The same host with these partitions off, and marked as stopped by a measurement.
    """

    def stopped(partition: Partition) -> Partition:
        is_own = partition.mark is not None and partition.mark.application == application
        runs = is_own and partition.settings.running
        return stopped_partition(partition, StoppedBy.MEASUREMENT) if runs else partition

    return replace(state, partitions=tuple(map(stopped, state.partitions)))


def _run_script(hosts: Hosts, host: ScriptedMeasuringHost, purpose: Purpose, names: tuple[str, ...]) -> None:
    """Stop or start partitions of a host that only scripts change: a script is made of a plan.

    Raises:
        UseCaseError: It cannot be planned or done.
    """
    request = replace(
        plan_request(hosts.only(host.name)), purpose=purpose, partitions=names, stopped_by=StoppedBy.MEASUREMENT
    )
    plan = plan_from_states(hosts, request, {host.name: host.observe()})
    report = apply_plan(plan, {host.name: host}, run_origin())  # to its end: half of it is of no use
    if report.ending not in {RunEnding.DONE, RunEnding.NOTHING}:
        outcome = Outcome.REFUSED if report.ending is RunEnding.REFUSED else Outcome.FAILED
        raise UseCaseError(outcome, report.findings)


def record_reservations(hosts: Hosts) -> None:
    """Write the reservations that follow from the data logs now into the configuration logs.

    Args:
        hosts: those of the manifest, which is read again.

    Raises:
        UseCaseError: One of them is damaged (negative), or held by another run (refused).
    """
    with log_errors():
        record_choices(hosts.reloaded().manifest)  # a level may have been chosen meanwhile
