"""Stopping partitions of the application for a measurement, and starting them again afterwards.

A partition's mark says that a measurement stopped it before it is stopped, and until it runs again. So after a kill at
any moment the next `measure`, `start` or `apply` starts it. On a host that only scripts change a script does it, and
the host's journal knows how far it got.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from rarms_iac.app.hosts import Hosts, host_errors
from rarms_iac.app.plan_files import plan_key
from rarms_iac.app.planning import outcome_of
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.applying import refusals
from rarms_iac.applying.desired_hosts import criticality_of, locator
from rarms_iac.applying.requested_changes import start_changes, steps_without_plan, stop_changes, stopped_partition
from rarms_iac.applying.run_report import RunEnding
from rarms_iac.applying.run_script import apply_job, run_job
from rarms_iac.applying.run_steps import UNATTENDED_RUN
from rarms_iac.applying.scripts import scripts_of
from rarms_iac.diff.disruption import grace_ms
from rarms_iac.diff.step_context import claim_of
from rarms_iac.measuring import findings
from rarms_iac.measuring.findings import OCCUPIED
from rarms_iac.measuring.partitions import MEASURING
from rarms_iac.measuring.session import MeasuringSession
from rarms_iac.model.capacity import capacity_of, fits, foreign_claims
from rarms_iac.model.commands import PLAN, START, command, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import Host
from rarms_iac.model.operations import StartPartition, StopPartition, WriteMark
from rarms_iac.model.plan import HostSteps, Purpose, RunIdentity, Scope
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import Partition, State, StoppedBy
from rarms_iac.model.version import __version__
from rarms_iac.providers.measuring import MeasuringHost, ScriptedMeasuringHost, StepwiseMeasuringHost
from rarms_iac.storage.plan_file import run_id, signed_scripts
from rarms_iac.texts.messages import in_a_row, natural_order


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
                    "Running partitions on {host} would change the measurement: {_names}.",
                    prose(
                        "To stop these partitions and restart them afterwards: ",
                        command(session.command, stop_partitions=True),
                        ". Or stop them yourself: ",
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
    them = "it" if len(names) == 1 else "them"
    message = f"{host.name}: stopped {in_a_row(names)} to measure. rarms starts {them} again afterwards."
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
                (
                    "rarms could not restart these partitions on {host} after measuring: {_names}. With the "
                    "current manifest, the host does not have room for them."
                ),
                prose(PLAN, " shows the cause. Correct the manifest before you measure."),
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
                message = f"{host.name}: started {in_a_row(names)} again, stopped by a measurement."
                session.control.reporter.message(message)
    return errors


def stop_to_measure(hosts: Hosts, host: MeasuringHost, names: tuple[str, ...]) -> None:
    """Stop partitions of the application, the least critical first, and mark them as stopped by a measurement.

    Raises:
        UseCaseError: They cannot be stopped (refused or failed).
    """
    with host_errors():
        state = host.observe()
        to_stop = _by_criticality(hosts, state, names)
        if isinstance(host, ScriptedMeasuringHost):
            _run_script(hosts, host, Purpose.STOP, state, to_stop)
            return
        for partition in to_stop:
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
        UseCaseError: The host cannot be observed; or they cannot be started, and the first finding says so, the others
            why.
    """
    with host_errors():
        state = host.observe()
    names = stopped_by_measurement(state, hosts.system.application.name)
    stopped = _by_criticality(hosts, state, names)[::-1]
    if names and not _have_room(hosts.system.hosts[host.name], state, hosts.system.application.name, stopped):
        raise UseCaseError(
            Outcome.REFUSED, [_still_stopped(host.name, names, " The host does not have room for them now.")]
        )
    try:
        if names and isinstance(host, ScriptedMeasuringHost):
            _run_script(hosts, host, Purpose.START, state, stopped)
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
    template = "rarms stopped these partitions on {host} to measure and could not start them again: {_names}.{_why}"
    advice = prose("Correct the cause, then start them: ", command("start", *names), ".")
    return findings.STILL_STOPPED.of_host(host, template, advice, partitions=names, _names=", ".join(names), _why=why)


def _by_criticality(hosts: Hosts, state: State, names: Collection[str]) -> list[Partition]:
    """Return these partitions of the application, the least critical first."""
    criticality = criticality_of(hosts.system)
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
    """Return the state of a host once the running partitions of an application have been stopped to measure.

    Returns:
        The same host with these partitions off, and marked as stopped by a measurement.
    """

    def stopped(partition: Partition) -> Partition:
        is_own = partition.mark is not None and partition.mark.application == application
        runs = is_own and partition.settings.running
        return stopped_partition(partition, StoppedBy.MEASUREMENT) if runs else partition

    return replace(state, partitions=tuple(map(stopped, state.partitions)))


def _run_script(
    hosts: Hosts, host: ScriptedMeasuringHost, purpose: Purpose, state: State, partitions: Sequence[Partition]
) -> None:
    """Stop or start partitions of a host that only scripts change.

    Raises:
        UseCaseError: It is refused, or cannot be done.
    """
    system, manifest = hosts.system, hosts.manifest
    locate = locator(system, manifest.places, host.name, {})
    if purpose is Purpose.STOP:
        changes = stop_changes(partitions, StoppedBy.MEASUREMENT, "stopped to measure", locate)
    else:
        changes = start_changes(partitions, "started again after a measurement", locate)
    seen = SeenHost(host=system.hosts[host.name], application=system.application.name, state=state)
    on, refused = steps_without_plan(system, manifest.places, seen, changes)
    if not refused and not on.steps:
        return
    run = _identity(hosts, purpose, on)
    scripts, unwritable = scripts_of(on, run)
    if problems := (*refused, *unwritable):
        raise UseCaseError(outcome_of(problems), problems, manifest.sources)
    key = plan_key()
    with host_errors():
        if (last := host.unfinished()) is not None:
            raise UseCaseError(Outcome.REFUSED, [refusals.unfinished(host.name, last)])
        job = apply_job(run, on, scripts if key is None else signed_scripts(scripts, key))
        report = run_job(host, job, UNATTENDED_RUN)  # to its end: half of it is of no use
    if report.ending is not RunEnding.DONE:
        outcome = Outcome.REFUSED if report.ending is RunEnding.REFUSED else Outcome.FAILED
        raise UseCaseError(outcome, report.findings)


def _identity(hosts: Hosts, purpose: Purpose, on: HostSteps) -> RunIdentity:
    run = RunIdentity(
        id="",
        rarms_version=__version__,
        application=hosts.system.application.name,
        robot=hosts.system.application.robot,
        purpose=purpose,
        manifest=hosts.manifest.source.manifest,
        manifest_digest=hosts.manifest.loaded.digest,
        accepted=(),
    )
    return replace(run, id=run_id(run, on))
