"""Partitions of the application are stopped while it is measured where they run, and started again afterwards.

They are stopped and started by plans like any other, under the lock of whoever measures. Their marks say that a
measurement stopped them, so that after a kill the next `measure`, `start` or `apply` starts them.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

from rarms_iac.app.control import NEVER_STOP, Reporter, StopSignal
from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.hosts import Hosts, run_origin
from rarms_iac.app.planning import make_plan, plan_request
from rarms_iac.applying.execute import apply_plan, finish_unfinished
from rarms_iac.applying.requested_changes import stopped_partition
from rarms_iac.applying.run_report import RunEnding, RunReporter
from rarms_iac.measuring import findings
from rarms_iac.model.changes import Update
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.journal import Journal, ScriptRun
from rarms_iac.model.plan import Plan, Purpose
from rarms_iac.model.state import Partition, State, StoppedBy
from rarms_iac.model.wording import in_a_row
from rarms_iac.providers.measuring import MeasuringHost

StopConsent = Callable[[str, tuple[str, ...]], bool]
"""Whether these partitions of a host may be stopped while it is measured: asked once a host, before the first."""


def never_consents(_host: str, _partitions: tuple[str, ...]) -> bool:
    """Stop nothing: the measurement is refused, as nobody was asked.

    Args:
        _host: not looked at.
        _partitions: not looked at.

    Returns:
        False.
    """
    return False


def always_consents(_host: str, _partitions: tuple[str, ...]) -> bool:
    """Stop what runs, as the options ask for.

    Args:
        _host: not looked at.
        _partitions: not looked at.

    Returns:
        True.
    """
    return True


@dataclass(frozen=True, slots=True, kw_only=True)
class PartitionStopper:
    """Stops the application's own partitions of a held host, where somebody consents."""

    hosts: Hosts
    reporter: Reporter
    consents: StopConsent = never_consents
    command: str = "measure"  # that could have been asked to stop them

    def stop(self, bench: MeasuringHost) -> tuple[str, ...]:
        """Stop what runs of the application on this host, if that is consented to.

        Args:
            bench: A host whose lock the caller holds.

        Returns:
            The partitions that still run, since nobody consented; empty: none does.

        Raises:
            UseCaseError: They cannot be stopped (refused or failed).
        """
        names = own_running(bench.observe(), self.hosts.system.application.name)
        if not names or not self.consents(bench.name, names):
            return names
        _run(self.hosts, bench, Purpose.STOP, names)
        self.reporter.message(f"{bench.name}: stopped {in_a_row(names)} to measure. They start again afterwards.")
        return ()


@contextmanager
def starting_again(
    hosts: Hosts, benches: Mapping[str, MeasuringHost], reporter: Reporter, stop: StopSignal = NEVER_STOP
) -> Iterator[list[Diagnostic]]:
    """At the end, start what a measurement stopped on these hosts: this one, or an earlier one that was killed.

    Args:
        hosts: Those of the manifest.
        benches: Held hosts, by name; they must still be held at the end.
        reporter: Hears what was started; after an exception, what could not be started, too.
        stop: A request to stop waits until all are started.

    Yields:
        Once, a list that holds after the end an error for each host where partitions could not be started, and why.
    """
    errors: list[Diagnostic] = []
    try:
        yield errors
    except BaseException:
        reporter.findings(_start_all(hosts, benches, reporter, stop), hosts.manifest.sources)
        raise
    errors += _start_all(hosts, benches, reporter, stop)


def _start_all(
    hosts: Hosts, benches: Mapping[str, MeasuringHost], reporter: Reporter, stop: StopSignal
) -> tuple[Diagnostic, ...]:
    with stop.gently():
        return tuple(error for bench in benches.values() for error in _start_again(hosts, bench, reporter))


def _start_again(hosts: Hosts, bench: MeasuringHost, reporter: Reporter) -> tuple[Diagnostic, ...]:
    names = stopped_by_measurement(bench.observe(), hosts.system.application.name)
    if not names:
        return ()
    try:
        _run(hosts, bench, Purpose.START, names)
    except UseCaseError as error:
        message = f"On {bench.name} these were stopped to measure, and could not be started: {', '.join(names)}."
        advice = f"Mend what keeps them from it, then start them: `rarms start {' '.join(names)}`."
        return findings.STILL_STOPPED.at(None, message, advice, address=f"host/{bench.name}"), *error.diagnostics
    reporter.message(f"{bench.name}: started {in_a_row(names)} again, which a measurement had stopped.")
    return ()


def own_running(state: State, application: str) -> tuple[str, ...]:
    """Name the partitions of an application that run on a host, in order.

    Args:
        state: the host as observed.
        application: whose partitions.

    Returns:
        Their names in the manifest, sorted.
    """
    own = state.of(application).partitions
    return tuple(sorted(partition.mark.name for partition in own if partition.mark and partition.settings.running))


def stopped_by_measurement(state: State, application: str) -> tuple[str, ...]:
    """Name the partitions of an application that a measurement stopped and has not started again, in order.

    Args:
        state: the host as observed.
        application: whose partitions.

    Returns:
        Their names in the manifest, sorted.
    """
    marks = (partition.mark for partition in state.of(application).partitions)
    return tuple(sorted(mark.name for mark in marks if mark and mark.stopped_by is StoppedBy.MEASUREMENT))


def stopped_to_measure(state: State, application: str) -> State:
    """What a host looks like once the partitions of an application that run have been stopped to measure.

    Args:
        state: the host as observed.
        application: whose partitions.

    Returns:
        The same host with these partitions off, and marked as stopped by a measurement.
    """

    def stopped(partition: Partition) -> Partition:
        is_own = partition.mark is not None and partition.mark.application == application
        runs = is_own and partition.settings.running
        return stopped_partition(partition, StoppedBy.MEASUREMENT) if runs else partition

    return replace(state, partitions=tuple(map(stopped, state.partitions)))


def all_stopped_to_measure(states: Mapping[str, State], application: str) -> Mapping[str, State]:
    """Return the same of several hosts, by name.

    Args:
        states: by host name.
        application: whose partitions.

    Returns:
        By host name.
    """
    return {name: stopped_to_measure(state, application) for name, state in states.items()}


def is_for_measuring(run: Journal | ScriptRun) -> bool:
    """Tell whether a run does nothing but stop partitions to measure, or start them again.

    Args:
        run: finished or not.

    Returns:
        False for a run that changes nothing, and for a script's.
    """
    if not isinstance(run, Journal) or not run.started.host_plan.changes:
        return False
    return all(
        isinstance(change, Update) and _is_stopped_to_measure(change.before, change.after)
        for change in run.started.host_plan.changes
    )


def _is_stopped_to_measure(before: object, after: object) -> bool:
    both = (before, after)
    marks = [partition.mark for partition in both if isinstance(partition, Partition) and partition.mark]
    return any(mark.stopped_by is StoppedBy.MEASUREMENT for mark in marks)


def finish_stop_or_start(bench: MeasuringHost, reporter: Reporter) -> None:
    """Finish a run that was killed while it stopped partitions to measure, or started them again.

    Args:
        bench: A host whose lock the caller holds.
        reporter: Hears that it was finished.

    Raises:
        UseCaseError: It cannot be finished (failed).
    """
    journal = bench.unfinished()
    if journal is None or not is_for_measuring(journal):
        return
    report = finish_unfinished([bench], RunReporter(), _never)
    if report is None or report.ending is not RunEnding.DONE:
        raise UseCaseError(Outcome.FAILED, report.diagnostics if report else ())
    reporter.message(f"{bench.name}: finished the stop or start of partitions that an earlier measurement had begun.")


def _run(hosts: Hosts, bench: MeasuringHost, purpose: Purpose, partitions: tuple[str, ...]) -> None:
    """Stop or start partitions on one held host.

    Raises:
        UseCaseError: It cannot be planned or done.
    """
    request = replace(
        plan_request(hosts.only(bench.name)),
        purpose=purpose,
        partitions=partitions,
        stopped_by=StoppedBy.MEASUREMENT,
    )
    _apply(make_plan(hosts, request, {bench.name: bench.observe()}), bench)


def _apply(plan: Plan, bench: MeasuringHost) -> None:
    report = apply_plan(plan, {bench.name: bench}, run_origin(), RunReporter(), _never)
    if report.ending not in {RunEnding.DONE, RunEnding.NOTHING}:
        outcome = Outcome.REFUSED if report.ending is RunEnding.REFUSED else Outcome.FAILED
        raise UseCaseError(outcome, report.diagnostics)


def _never() -> bool:
    """All of it is done: partitions that are stopped half-way help nobody."""
    return False
