"""Taking the last run on a host back: its steps' undos, the last one first, as a run of its own."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import assert_never

from rarms_iac.applying import refusals
from rarms_iac.applying.preconditions import no_rights
from rarms_iac.applying.run_report import RunEnding, RunReport
from rarms_iac.applying.run_script import abandon_script, description_of, finish_job, lines_of_help, run_job, undo_job
from rarms_iac.applying.run_steps import UNATTENDED_RUN, RunControl, RunJob, UndoJob, failed_run, run_steps, run_there
from rarms_iac.model.changes import Address
from rarms_iac.model.claims import Claim
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.journal import (
    Closing,
    Journal,
    RunClosed,
    RunKind,
    RunOrigin,
    RunStarted,
    ScriptRun,
    StepStatus,
    history_of,
)
from rarms_iac.model.plan import Step, UndoLevel
from rarms_iac.model.state import Rights
from rarms_iac.model.version import __version__
from rarms_iac.powershell.summary import FOREIGN, NOT_UNDONE
from rarms_iac.providers.interface import (
    NO_WAITING,
    HostError,
    LiveHost,
    RobotHost,
    ScriptedHost,
    StepwiseHost,
    WaitLimits,
)
from rarms_iac.storage.marks import ForeignValue, foreign_values
from rarms_iac.texts.messages import in_a_row
from rarms_iac.texts.plans import reversal_title


def undo(host: LiveHost, origin: RunOrigin, control: RunControl = UNATTENDED_RUN, *, keep: bool = False) -> RunReport:
    """Undo the last apply, finished or not; an undo that was interrupted is finished. The host is held.

    Args:
        keep: leave what `repaired_addresses` names as it was applied; `why_not_kept` was asked before.
    """
    try:
        match host:
            case RobotHost():
                journal = host.journal()
                if journal is None or not can_be_undone(journal):
                    return _nothing_to_undo(host, journal)
                asked = UndoJob(plan=journal.started.plan, waits=control.waits, keep=keep)
                return run_there(host, "undo", asked, control)
            case StepwiseHost():
                return _walk_back(host, origin, control, keep=keep)
            case ScriptedHost():
                run = host.journal()
                if run is None or not can_be_undone(run):
                    return _nothing_to_undo(host, run)
                job = finish_job(host.name, run) if run.started.run is RunKind.UNDO else undo_job(host.name, run)
                if refused := without_rights(host):
                    return refused
                report = run_job(host, job, control)
                return replace(report, findings=(*report.findings, *undo_findings(host, run)))
            case _:
                assert_never(host)
    except HostError as error:
        return failed_run(error)


def can_be_undone(journal: Journal | ScriptRun) -> bool:
    """Return whether the last run was an apply, or an undo that was interrupted."""
    return journal.started.run is RunKind.APPLY or journal.unfinished


def without_rights(host: LiveHost) -> RunReport | None:
    """Return the refusal of a host whose rights are not proven; None if they are."""
    facts = host.observe().facts
    if facts.rights is Rights.PROVEN:
        return None
    return RunReport(ending=RunEnding.FAILED, findings=(no_rights(facts),))


def _walk_back(host: StepwiseHost, origin: RunOrigin, control: RunControl, *, keep: bool) -> RunReport:
    journal = host.journal()
    if journal is None or not can_be_undone(journal):
        return _nothing_to_undo(host, journal)
    spared = repaired_addresses(journal) if keep else frozenset()
    if spared and not steps_undone(journal, spared):
        why = f"`--keep` keeps all changes of the last apply: {in_a_row(sorted(map(str, spared)))}"
        return RunReport(ending=RunEnding.NOTHING, findings=(refusals.nothing_to_undo(host.name, why),))
    if refused := without_rights(host):
        return refused
    if (other := refusals.begun_by_another_version(host.name, journal)) is not None:
        return RunReport(ending=RunEnding.REFUSED, findings=(other,))
    if journal.started.run is RunKind.UNDO:
        return run_steps(host, journal, control)
    started = undo_run(journal, origin, spared)
    host.start_run(started)
    report = run_steps(host, Journal(started=started), control)
    return replace(report, findings=(*report.findings, *undo_findings(host, journal, spared)))


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
                journal = host.journal()  # read whole: one that is damaged anywhere shows no run that ended
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


@dataclass(frozen=True, slots=True, kw_only=True)
class UndoneStep:
    """A step that an undo reverses, and how much of it."""

    address: str
    title: str
    level: UndoLevel


def steps_undone(journal: Journal, spared: frozenset[Address] = frozenset()) -> tuple[UndoneStep, ...]:
    """List what an undo would do, in its order, and what it cannot, for a person.

    Args:
        journal: the last run; of an undo that was interrupted, the steps that are left.
        spared: what is left as it was applied.
    """
    if journal.started.run is RunKind.UNDO:
        done = {record.number for record in journal.steps if record.status is not StepStatus.BEGUN}
        return tuple(
            UndoneStep(address=str(step.address), title=step.title, level=UndoLevel.FULL)
            for number, step in enumerate(journal.started.steps)
            if number not in done
        )
    changes = journal.started.host_plan.changes_by_address
    return tuple(
        UndoneStep(
            address=str(step.address),
            title=reversal_title(step, changes) if step.undo.operation else step.title,
            level=step.undo.level,
        )
        for _, step in steps_to_undo(journal, spared)
        if step.undo.operation is not None or step.undo.level is not UndoLevel.FULL  # else it goes with its machine
    )


def script_undone(run: ScriptRun) -> tuple[str, ...]:
    """Return the help of the host's undo script, without losses and foreign values, which are findings."""
    script = run.started.script if run.started.run is RunKind.UNDO else run.started.undo
    return tuple(line for line in description_of(script) if not line.startswith((NOT_UNDONE, FOREIGN)))


def steps_to_undo(journal: Journal, spared: frozenset[Address] = frozenset()) -> tuple[tuple[int, Step], ...]:
    """Return the steps that the run may have done, with their numbers, last one first, without those of what is kept.

    What was done to a machine before it was removed went with it: only the removal itself is reported.
    """
    touched = journal.touched()
    gone: set[str] = set()
    steps: list[tuple[int, Step]] = []
    for number, step in reversed(list(enumerate(journal.started.steps))):
        if number not in touched or step.address.partition in gone or _resource_of(step) in spared:
            continue
        steps.append((number, step))
        if is_removal(step):
            gone.add(step.address.partition)
    return tuple(steps)


def is_removal(step: Step) -> bool:
    """Return whether the step removed a machine that an undo does not bring back."""
    is_machine = bool(step.address.partition and not step.address.task)
    return is_machine and step.undo.operation is None and step.after.get("exists") is False


def undo_findings(
    host: LiveHost, journal: Journal | ScriptRun, spared: frozenset[Address] = frozenset()
) -> tuple[Diagnostic, ...]:
    """Warn of each step of the run that cannot be undone wholly, and of each foreign value that the undo sets again.

    Args:
        spared: what is left as it was applied.
    """
    match journal:
        case Journal():
            can_keep = not why_not_kept(host, journal)
            partial = [
                refusals.undo_partial(host.name, step)
                for _, step in steps_to_undo(journal, spared)
                if journal.started.run is RunKind.APPLY and step.undo.level is not UndoLevel.FULL
            ]
            values = (value for value in _foreign_values(journal) if value.address not in spared)
            return (*partial, *(refusals.undo_foreign(host.name, value, can_keep=can_keep) for value in values))
        case ScriptRun():
            script = journal.started.undo
            return (
                *(refusals.undo_script_partial(host.name, lost) for lost in lines_of_help(script, NOT_UNDONE)),
                *(refusals.undo_script_foreign(host.name, line) for line in lines_of_help(script, FOREIGN)),
            )


def repaired_addresses(journal: Journal | ScriptRun) -> frozenset[Address]:
    """Return the partitions and task classes whose foreign values the run replaced: `--keep` leaves them as applied."""
    is_apply = isinstance(journal, Journal) and journal.started.run is RunKind.APPLY
    return frozenset(value.address for value in _foreign_values(journal)) if is_apply else frozenset()


def why_not_kept(host: LiveHost, journal: Journal | ScriptRun) -> str:
    """Say why an undo of this run cannot leave `repaired_addresses` as they are; empty: it can."""
    if isinstance(host, ScriptedHost) or not isinstance(journal, Journal):
        return "the script of the host undoes the whole apply"
    if journal.started.run is RunKind.UNDO:
        return "the undo has begun"
    spared = repaired_addresses(journal)
    claims: dict[Address, tuple[Claim, Claim]] = {}  # before the apply, and after it
    for step in journal.started.steps:
        first, _ = claims.get(_resource_of(step), (step.claim_before, step.claim_after))
        claims[_resource_of(step)] = first, step.claim_after
    grown = [address for address in spared if address in claims and claims[address][0].is_less_than(claims[address][1])]
    growing = [
        address for address, (before, after) in claims.items() if address not in spared and after.is_less_than(before)
    ]
    if grown and growing:
        return f"{min(map(str, growing))} may need the capacity that {min(map(str, grown))} would keep"
    return ""


def _foreign_values(journal: Journal | ScriptRun) -> tuple[ForeignValue, ...]:
    """Return the foreign values that an undo of the run would set again."""
    if not isinstance(journal, Journal):
        return ()
    undone = {step.address for step in steps_undone(journal)}
    changes = journal.started.host_plan.changes
    return tuple(value for value in foreign_values(changes) if str(value.address) in undone)


def _resource_of(step: Step) -> Address:
    """Return the partition or task class that a step changes; a disk is its partition's."""
    return replace(step.address, disk="")


def undo_run(journal: Journal, origin: RunOrigin, spared: frozenset[Address] = frozenset()) -> RunStarted:
    """Return the run that undoes the journal's steps. It raises the serial: what was planned before it is stale.

    Args:
        spared: what is left as it was applied.
    """
    started = journal.started
    changes = started.host_plan.changes_by_address
    taken = (step for _, step in steps_to_undo(journal, spared) if step.undo.operation is not None)
    steps = tuple(step.reversed(reversal_title(step, changes)) for step in taken)
    return replace(
        started,
        run=RunKind.UNDO,
        steps=steps,
        started_by=origin.by,
        started_at=origin.at,
        rarms=__version__,
        history=history_of(journal),
        serials=raised_serials(started.serials, started.application),
    )


def raised_serials(serials: Mapping[str, int], application: str) -> Mapping[str, int]:
    """Return the serials with this application's counted up by one; a first run makes it 1."""
    return {**serials, application: serials.get(application, 0) + 1}


def _nothing_to_undo(host: LiveHost, journal: Journal | ScriptRun | None) -> RunReport:
    why = (
        "rarms has not applied a plan there"
        if journal is None
        else f"the last run there was the undo of plan {journal.started.plan}"
    )
    return RunReport(ending=RunEnding.NOTHING, findings=(refusals.nothing_to_undo(host.name, why),))
