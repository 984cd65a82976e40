"""Taking the last run on a host back: its steps' undos, the last one first, as a run of its own."""

from collections.abc import Mapping
from dataclasses import replace
from typing import assert_never

from rarms_iac.applying import refusals
from rarms_iac.applying.preconditions import no_rights
from rarms_iac.applying.robot_runs import RunJob, run_there
from rarms_iac.applying.run_report import RunEnding, RunReport
from rarms_iac.applying.run_script import (
    UndoneStep,
    abandon_script,
    finish_job,
    not_undone,
    run_job,
    steps_undone_by_script,
    undo_job,
)
from rarms_iac.applying.run_steps import UNATTENDED_RUN, RunControl, failed_run, run_steps
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.journal import (
    Closing,
    Journal,
    RunClosed,
    RunKind,
    RunOrigin,
    RunStarted,
    ScriptRun,
    history_of,
    run_to_undo,
)
from rarms_iac.model.plan import Step, UndoLevel
from rarms_iac.model.state import Rights
from rarms_iac.model.step_titles import reversal
from rarms_iac.model.version import __version__
from rarms_iac.providers.interface import (
    NO_WAITING,
    HostError,
    LiveHost,
    RobotHost,
    ScriptedHost,
    StepwiseHost,
    WaitLimits,
)


def undo(host: LiveHost, origin: RunOrigin, control: RunControl = UNATTENDED_RUN) -> RunReport:
    """Take the last apply back, finished or not; an undo that was interrupted is finished. The host is held."""
    try:
        match host:
            case RobotHost():
                last = host.journal()
                journal = run_to_undo(last)
                if journal is None or not can_be_undone(journal):
                    return _nothing_to_undo(host, journal)
                asked = RunJob(plan=journal.started.plan, waits=control.waits)
                return run_there(host, "undo", asked, control)
            case StepwiseHost():
                last = host.journal()
                journal = run_to_undo(last)
                if last is None or not isinstance(journal, Journal) or not can_be_undone(journal):
                    return _nothing_to_undo(host, journal)
                return without_rights(host) or _walk_back(host, journal, last, origin, control)
            case ScriptedHost():
                run = host.journal()
                if run is None or not can_be_undone(run):
                    return _nothing_to_undo(host, run)
                job = finish_job(host.name, run) if run.started.run is RunKind.UNDO else undo_job(host.name, run)
                if refused := without_rights(host):
                    return refused
                report = run_job(host, job, control)
                return replace(report, findings=(*report.findings, *not_undone_findings(host.name, run)))
            case _:
                assert_never(host)
    except HostError as error:
        return failed_run(error)


def can_be_undone(journal: Journal | ScriptRun) -> bool:
    """Whether the last run was an apply, or an undo that was interrupted."""
    return journal.started.run is RunKind.APPLY or journal.unfinished


def without_rights(host: LiveHost) -> RunReport | None:
    """Why nothing is begun on a host that does not show what is there; None where the rights are proven."""
    facts = host.observe().facts
    if facts.rights is Rights.PROVEN:
        return None
    return RunReport(ending=RunEnding.FAILED, findings=(no_rights(facts),))


def _walk_back(
    host: StepwiseHost, journal: Journal, last: Journal, origin: RunOrigin, control: RunControl
) -> RunReport:
    if (other := refusals.begun_by_another_version(host.name, journal)) is not None:
        return RunReport(ending=RunEnding.REFUSED, findings=(other,))
    if journal.started.run is RunKind.UNDO:
        return run_steps(host, journal, control)
    started = undo_run(journal, origin, last)
    host.start_run(started)
    report = run_steps(host, Journal(started=started), control)
    return replace(report, findings=(*report.findings, *not_undone_findings(host.name, journal)))


def abandon(host: LiveHost, waits: WaitLimits = NO_WAITING) -> RunReport:
    """Close an unfinished run; the host stays as it is. The host is held, but for a robot, which holds itself."""
    try:
        match host:
            case RobotHost():
                unfinished = host.unfinished()
                if unfinished is None:
                    return RunReport(ending=RunEnding.NOTHING)
                asked = RunJob(plan=unfinished.started.plan, waits=waits)
                return run_there(host, "abandon", asked, UNATTENDED_RUN)
            case StepwiseHost():
                journal = host.journal()  # read whole: one that is damaged anywhere tells of no run that ended
                if journal is None or not journal.unfinished:
                    return RunReport(ending=RunEnding.NOTHING)
                host.record(RunClosed(closing=Closing.ABANDONED))
                return RunReport(ending=RunEnding.DONE)
            case ScriptedHost():
                run = host.unfinished()
                return abandon_script(host, run, waits) if run else RunReport(ending=RunEnding.NOTHING)
            case _:
                assert_never(host)
    except HostError as error:
        return failed_run(error)


def steps_undone(journal: Journal | ScriptRun) -> tuple[UndoneStep, ...]:
    """What an undo would do, in its order, and what it cannot, for a person."""
    match journal:
        case Journal():
            changes = journal.started.host_plan.changes_by_address
            return tuple(
                UndoneStep(
                    address=str(step.address),
                    title=reversal(step, changes).title if step.undo.operation else step.title,
                    level=step.undo.level,
                )
                for _, step in steps_to_undo(journal)
                if step.undo.operation is not None
                or step.undo.level is not UndoLevel.FULL  # else it goes with its machine
            )
        case ScriptRun():
            return steps_undone_by_script(journal)


def steps_to_undo(journal: Journal) -> tuple[tuple[int, Step], ...]:
    """The steps that the run may have done, with their numbers, the last one first.

    What was done to a machine before it was removed went with it: only the removal itself is told.
    """
    touched = journal.touched()
    gone: set[str] = set()
    steps: list[tuple[int, Step]] = []
    for number, step in reversed(list(enumerate(journal.started.steps))):
        if number not in touched or step.address.partition in gone:
            continue
        steps.append((number, step))
        if is_removal(step):
            gone.add(step.address.partition)
    return tuple(steps)


def is_removal(step: Step) -> bool:
    """Whether a machine went with this step and does not come back."""
    is_machine = bool(step.address.partition and not step.address.task)
    return is_machine and step.undo.operation is None and step.after.get("exists") is False


def not_undone_findings(host: str, journal: Journal | ScriptRun) -> tuple[Diagnostic, ...]:
    """A warning for each step of the run that cannot be taken back, or not wholly."""
    match journal:
        case Journal():
            return tuple(
                refusals.undo_partial(host, step)
                for _, step in steps_to_undo(journal)
                if step.undo.level is not UndoLevel.FULL
            )
        case ScriptRun():
            return tuple(refusals.undo_script_partial(host, lost) for lost in not_undone(journal.started.undo))


def undo_run(journal: Journal, origin: RunOrigin, last: Journal) -> RunStarted:
    """The run that takes the journal's steps back. It raises the serial: what was planned before it is stale.

    Args:
        journal: the run that is taken back.
        origin: of the undo.
        last: the last run on the host.
    """
    started = journal.started
    changes = started.host_plan.changes_by_address
    steps = tuple(reversal(step, changes) for _, step in steps_to_undo(journal) if step.undo.operation is not None)
    return replace(
        started,
        run=RunKind.UNDO,
        steps=steps,
        started_by=origin.by,
        started_at=origin.at,
        rarms=__version__,
        history=history_of(last),
        serials=raised_serials(last.started.serials, started.application),
    )


def raised_serials(serials: Mapping[str, int], application: str) -> Mapping[str, int]:
    """The serials with this application's counted up by one; a first run makes it 1."""
    return {**serials, application: serials.get(application, 0) + 1}


def _nothing_to_undo(host: LiveHost, journal: Journal | ScriptRun | None) -> RunReport:
    why = (
        "rarms has applied nothing there"
        if journal is None
        else f"the last run there was the undo of plan {journal.started.plan}"
    )
    return RunReport(ending=RunEnding.NOTHING, findings=(refusals.nothing_to_undo(host.name, why),))
