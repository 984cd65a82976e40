"""Partitions of the application are stopped while it is measured where they run, and started again afterwards.

They are stopped and started by plans like any other, under the lock of the measurement. Their marks say that a
measurement stopped them, so that after a kill the next `measure`, `start` or `apply` starts them.
"""

from dataclasses import replace

from rarms_iac.app.control import Reporter
from rarms_iac.app.hosts import Hosts, run_origin
from rarms_iac.app.planning import plan_from_states, plan_request
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.applying.execute import apply_plan, finish_unfinished
from rarms_iac.applying.requested_changes import stopped_partition
from rarms_iac.applying.run_report import RunEnding
from rarms_iac.measuring import measuring_findings
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Facts
from rarms_iac.model.journal import part_of_measurement
from rarms_iac.model.plan import Purpose
from rarms_iac.model.state import Partition, State, StoppedBy
from rarms_iac.model.wording import natural_order
from rarms_iac.providers.measuring import MeasuringHost


def stop_to_measure(hosts: Hosts, host: MeasuringHost, names: tuple[str, ...]) -> None:
    """Stop partitions of the application by a plan, and mark them as stopped by a measurement.

    Raises:
        UseCaseError: They cannot be stopped (refused or failed).
    """
    _run(hosts, host, Purpose.STOP, names)


def start_again(hosts: Hosts, host: MeasuringHost) -> tuple[str, ...]:
    """Start the partitions of the application that a measurement stopped on this host.

    Returns:
        Their names, sorted; none where none is stopped.

    Raises:
        UseCaseError: They cannot be started; its first finding says so, the others why.
    """
    names = stopped_by_measurement(host.observe(), hosts.system.application.name)
    if names:
        try:
            _run(hosts, host, Purpose.START, names)
        except UseCaseError as error:
            message = f"On {host.name} these were stopped to measure, and could not be started: {', '.join(names)}."
            advice = prose("Mend what keeps them from it, then start them: ", command("start", *names), ".")
            values: Facts = {"host": host.name, "partitions": names}
            finding = measuring_findings.STILL_STOPPED.at(
                None, message, advice, address=f"host/{host.name}", values=values
            )
            raise UseCaseError(error.outcome, (finding, *error.findings)) from None
    return names


def own_running(state: State, application: str) -> tuple[str, ...]:
    """Name the partitions of an application that run on a host, in order.

    Returns:
        Their names in the manifest, sorted.
    """
    own = state.of(application).partitions
    return tuple(
        sorted(
            (partition.mark.name for partition in own if partition.mark and partition.settings.running),
            key=natural_order,
        )
    )


def stopped_by_measurement(state: State, application: str) -> tuple[str, ...]:
    """Name the partitions of an application that a measurement stopped and has not started again, in order.

    Returns:
        Their names in the manifest, sorted.
    """
    marks = (partition.mark for partition in state.of(application).partitions)
    return tuple(
        sorted((mark.name for mark in marks if mark and mark.stopped_by is StoppedBy.MEASUREMENT), key=natural_order)
    )


def stopped_to_measure(state: State, application: str) -> State:
    """What a host looks like once the partitions of an application that run have been stopped to measure.

    Returns:
        The same host with these partitions off, and marked as stopped by a measurement.
    """

    def stopped(partition: Partition) -> Partition:
        is_own = partition.mark is not None and partition.mark.application == application
        runs = is_own and partition.settings.running
        return stopped_partition(partition, StoppedBy.MEASUREMENT) if runs else partition

    return replace(state, partitions=tuple(map(stopped, state.partitions)))


def finish_stop_or_start(host: MeasuringHost, reporter: Reporter) -> None:
    """Finish a run that was killed while it stopped partitions to measure, or started them again.

    Raises:
        UseCaseError: It cannot be finished (failed).
    """
    journal = host.unfinished()
    if journal is None or not part_of_measurement(journal):
        return
    finished = finish_unfinished([host])
    if finished is None or finished.ending is not RunEnding.DONE:
        raise UseCaseError(Outcome.FAILED, finished.findings if finished else ())
    reporter.message(f"{host.name}: finished the stop or start of partitions that an earlier measurement had begun.")


def _run(hosts: Hosts, host: MeasuringHost, purpose: Purpose, names: tuple[str, ...]) -> None:
    """Plan, and do it, on one held host.

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
