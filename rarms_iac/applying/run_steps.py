"""Walking a run's steps on one host, and runs that a robot's own rarms does whole.

A step is read, compared, set, and read again, and the journal says how far the run got. The same walk serves a fresh
run and one that was killed: every step looks before it acts, so that a step which was begun and did its work is found
done. `rarms_iac.robot` does at a robot what `run_there` asks for here.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

from rarms_iac.applying import refusals
from rarms_iac.applying.run_report import HostReport, RunBegun, RunEnding, RunReport, RunReporter
from rarms_iac.diff.readings import readings
from rarms_iac.model.changes import Address
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.facets import Reading, Readings
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.journal import (
    Closing,
    Journal,
    RunClosed,
    RunKind,
    RunStarted,
    StepRecorded,
    StepStatus,
    open_starts,
)
from rarms_iac.model.operations import StartPartition
from rarms_iac.model.plan import HostPlan, Scope, Step
from rarms_iac.providers.interface import (
    NO_WAITING,
    HostError,
    HostFailed,
    HostLocked,
    LiveHost,
    RobotHost,
    RobotListener,
    StepwiseHost,
    WaitLimits,
)
from rarms_iac.providers.robot import EndedThere
from rarms_iac.storage.codec import NotDecodable, decode, encode


@dataclass(frozen=True, slots=True, kw_only=True)
class RunControl:
    """The caller's part in a run: it hears of each step, may end the run between steps, and says how long to wait."""

    reporter: RunReporter = RunReporter()
    should_stop: Callable[[], bool] = lambda: False  # asked before every step
    waits: WaitLimits = NO_WAITING


_LOOK_S = 0.1
"""How often it is asked during a wait whether the run is to end."""

UNATTENDED_RUN = RunControl()
"""No report, no early end, and nothing is waited for."""


def run_steps(host: StepwiseHost, journal: Journal, control: RunControl) -> RunReport:
    """Do what is left of the journal's run and close it. The caller holds the host's lock."""
    if (other := refusals.begun_by_another_version(host.name, journal)) is not None:
        return RunReport(ending=RunEnding.REFUSED, findings=(other,))
    started, reporter = journal.started, control.reporter
    done: dict[int, StepStatus] = {
        record.number: record.status for record in journal.steps if record.status is not StepStatus.BEGUN
    }
    begun = journal.touched() - set(done)
    reporter.run_started(_begin(host.name, started, done))
    scope = Scope(application=started.application, plan=started.plan)

    def report(ending: RunEnding, *problems: Diagnostic) -> RunReport:
        return RunReport(ending=ending, hosts=(_host_report(host.name, journal, done, ending),), findings=problems)

    total, just_started = len(started.steps), False
    for number in (number for number in range(total) if number not in done):
        step = started.steps[number]
        if control.should_stop() and not step.wait_ms:
            return report(RunEnding.INTERRUPTED)
        reporter.step_started(host.name, number + 1, total, step)
        if step.wait_ms and just_started and started.host_plan.host.provider is not ProviderKind.SIMULATED:
            _wait(step.wait_ms, control.should_stop)
        outcome = _perform(host, scope, number, step, was_begun=number in begun)
        if isinstance(outcome, Diagnostic):
            refused = outcome.code in {refusals.MOVED.code, refusals.LOCKED.code}
            return report(RunEnding.REFUSED if refused else RunEnding.FAILED, outcome)
        done[number] = outcome
        just_started = isinstance(step.operation, StartPartition) and outcome is StepStatus.CHANGED
        reporter.step_ended(host.name, number + 1, total, step, outcome)

    # Every step is done: another run would find nothing left of a deviation.
    host.record(RunClosed(closing=Closing.DONE))
    deviations = tuple(_deviations(host, started, scope))
    return report(RunEnding.FAILED if deviations else RunEnding.DONE, *deviations)


def _wait(time_ms: int, should_stop: Callable[[], bool]) -> None:
    until = time.monotonic() + time_ms / 1000
    while not should_stop() and (left := until - time.monotonic()) > 0:
        time.sleep(min(_LOOK_S, left))


def take_back_starts(host: StepwiseHost, journal: Journal) -> Diagnostic | None:
    """Give back what partitions had for their starts, where a killed run did not; the rest of the run stays undone.

    The caller holds the host's lock.

    Returns:
        Why one could not be given back; None: nothing is left.
    """
    scope = Scope(application=journal.started.application, plan=journal.started.plan)
    for number, step in open_starts(journal):
        outcome = _perform(host, scope, number, step, was_begun=True)
        if isinstance(outcome, Diagnostic):
            return outcome
    return None


def _begin(host: str, started: RunStarted, done: Mapping[int, StepStatus]) -> RunBegun:
    return RunBegun(
        host=host,
        run=started.run,
        plan=started.plan,
        done=len(done),
        purpose=started.purpose,
        addresses=[str(step.address) for number, step in enumerate(started.steps) if number not in done],
        components=started.host_plan.components,
    )


def _host_report(host: str, journal: Journal, done: Mapping[int, StepStatus], ending: RunEnding) -> HostReport:
    started = journal.started
    changed = sum(status is StepStatus.CHANGED for status in done.values())
    return HostReport(
        host=host,
        plan=started.plan,
        run=started.run,
        ending=ending,
        changed=changed,
        unchanged=len(done) - changed,
        total=len(started.steps),
        purpose=started.purpose,
        resumed=bool(journal.steps),
        host_plan=started.host_plan if started.run is RunKind.APPLY else None,
    )


def _perform(host: StepwiseHost, scope: Scope, number: int, step: Step, *, was_begun: bool) -> StepStatus | Diagnostic:
    try:
        live = host.read(step.address, scope)
        if matches(live, step.after):
            # NOTE: a step that was begun by a killed run and is found done was our doing: an undo must reverse it.
            status = StepStatus.CHANGED if was_begun else StepStatus.UNCHANGED
            host.record(StepRecorded(number=number, status=status))
            return status
        if not matches(live, step.before):
            return refusals.step_moved(host.name, step, live)
        host.record(StepRecorded(number=number, status=StepStatus.BEGUN))
        host.execute(step.operation, scope)
        live = host.read(step.address, scope)
    except HostLocked as error:
        return refusals.lock_held(error.host, error.message)
    except HostError as error:
        return refusals.step_failed(host.name, step, error)
    if not matches(live, step.after):
        return refusals.step_missed(host.name, step, live)
    host.record(StepRecorded(number=number, status=StepStatus.CHANGED))
    return StepStatus.CHANGED


def matches(live: Readings, expected: Readings) -> bool:
    """Return whether each expected reading is live; others may have any value."""
    return all(name in live and live[name] == value for name, value in expected.items())


def _deviations(host: StepwiseHost, started: RunStarted, scope: Scope) -> Iterator[Diagnostic]:
    """Yield looking again: every address against the last reading that a step of the run expects of it."""
    state = host.observe()
    for address, wanted in sorted(_expected(started.steps).items()):
        live = readings(state, address, scope)
        if not matches(live, wanted):
            yield refusals.not_reached(host.name, str(address), refusals.differences(live, wanted))


def _expected(steps: Iterable[Step]) -> Mapping[Address, Readings]:
    """Return the readings of each address once these steps are done, in their order."""
    expected: dict[Address, dict[str, Reading]] = {}
    for step in steps:
        # A machine that is made again has the address of the old one, but not its id: the last address counts.
        before = expected.pop(step.address, {})
        expected[step.address] = {**({} if step.after.get("exists") is False else before), **step.after}
    return expected


@contextmanager
def hold(hosts: "tuple[LiveHost, ...]", owner: str, timeout_ms: int) -> Iterator[None]:
    """Hold all the hosts, taken in the order of their names, so that two runs cannot wait for each other.

    A host that runs scripts is held by each of them as long as it runs.
    """
    stepwise = [host for host in hosts if isinstance(host, StepwiseHost)]
    if not stepwise:
        yield
        return
    first, *rest = sorted(stepwise, key=lambda host: host.name)
    with first.lock(owner, timeout_ms), hold(tuple(rest), owner, timeout_ms):
        yield


def failed_run(error: HostError) -> RunReport:
    """Return the report of a run that ended with this error."""
    if isinstance(error, HostLocked):
        return RunReport(ending=RunEnding.REFUSED, findings=(refusals.lock_held(error.host, error.message),))
    if isinstance(error, EndedThere):
        endings = {ending.value: ending for ending in (RunEnding.REFUSED, RunEnding.INTERRUPTED)}
        return RunReport(ending=endings.get(error.outcome, RunEnding.FAILED), findings=error.findings)
    return RunReport(ending=RunEnding.FAILED, findings=(refusals.host_failed(error),))


GRAVEST_FIRST = (RunEnding.FAILED, RunEnding.REFUSED, RunEnding.INTERRUPTED, RunEnding.DONE)


def combined_report(reports: Iterable[RunReport]) -> RunReport:
    """Make one report of several hosts', in order: it ended as the gravest of them."""
    reports = tuple(reports)
    endings = {report.ending for report in reports}
    return RunReport(
        ending=next((ending for ending in GRAVEST_FIRST if ending in endings), RunEnding.NOTHING),
        hosts=tuple(host for report in reports for host in report.hosts),
        findings=tuple(problem for report in reports for problem in report.findings),
    )


STEPS = "steps"
"""The `RunReporter` of this side, as calls name it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ApplyJob:
    """A plan for the robot: its whole file."""

    plan: str
    waits: WaitLimits


@dataclass(frozen=True, slots=True, kw_only=True)
class RunJob:
    """A run of the robot that is finished or closed: the one of this plan, or nothing is done."""

    plan: str  # its id
    waits: WaitLimits


@dataclass(frozen=True, slots=True, kw_only=True)
class UndoJob(RunJob):
    """A run of the robot that is undone."""

    keep: bool  # as of `undo.undo`


def run_there(host: RobotHost, command: str, job: ApplyJob | RunJob, control: RunControl) -> RunReport:
    """Have the robot do a run, and return its report.

    Args:
        command: `apply`, `finish`, `abandon` or `undo`.
        control: hears of each step, and is asked whether to stop.

    Raises:
        HostError: the robot cannot be reached, refuses, or the connection broke.
    """
    listener = RobotListener(reporters={STEPS: (RunReporter, control.reporter)}, should_stop=control.should_stop)
    answer = host.ask(command, encode(job), listener)
    try:
        return decode(RunReport, answer)
    except NotDecodable as problem:
        raise HostFailed(host.name, f"its report cannot be read: {problem}", "Check the host: rarms history.") from None


def without_plans(report: RunReport) -> RunReport:
    """Return a report as it travels, without its plan, which the other side has."""
    return replace(report, hosts=tuple(replace(host, host_plan=None) for host in report.hosts))


def with_plan(report: RunReport, part: HostPlan) -> RunReport:
    """Return a report that came, with the plan whose run it is about."""
    return replace(report, hosts=tuple(replace(host, host_plan=part) for host in report.hosts))
