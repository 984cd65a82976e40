"""Taking the last run on a host back (DESIGN section 4): its steps' undos, the last one first, as a run of its own."""

from collections.abc import Mapping
from dataclasses import replace

from rarms_iac.apply import refusals
from rarms_iac.apply.reports import Ending, RunReport, RunReporter
from rarms_iac.apply.void import no_rights
from rarms_iac.apply.walk import ShouldStop, walk
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.journal import Closing, Journal, RunClosed, RunKind, RunStarted
from rarms_iac.model.plan import Step, UndoLevel
from rarms_iac.model.state import Rights
from rarms_iac.providers.interface import HostError, StepwiseHost


def undo(host: StepwiseHost, owner: str, reporter: RunReporter, should_stop: ShouldStop) -> RunReport:
    """Take the last apply back, finished or not; an undo that was interrupted is finished. The host is held."""
    try:
        journal = host.journal()
        if journal is None:
            return _nothing(host, "rarms has applied nothing there")
        if journal.started.run is RunKind.UNDO:
            if journal.unfinished:
                return walk(host, journal, reporter, should_stop)
            return _nothing(host, f"the last run there was the undo of plan {journal.started.plan}")
        facts = host.observe().facts
        if facts.rights is not Rights.PROVEN:
            return RunReport(ending=Ending.FAILED, diagnostics=(no_rights(facts),))
        started = undo_run(journal, started_by=owner)
        host.start_run(started)
        report = walk(host, Journal(started=started), reporter, should_stop)
    except HostError as error:
        return RunReport(ending=Ending.FAILED, diagnostics=(refusals.host_failed(error),))
    return replace(report, diagnostics=(*report.diagnostics, *not_taken_back(host.name, journal)))


def abandon(host: StepwiseHost) -> RunReport:
    """Close an unfinished run; the host stays as it is. The host is held."""
    try:
        if host.unfinished() is None:
            return RunReport(ending=Ending.NOTHING)
        host.record(RunClosed(closing=Closing.ABANDONED))
    except HostError as error:
        return RunReport(ending=Ending.FAILED, diagnostics=(refusals.host_failed(error),))
    return RunReport(ending=Ending.DONE)


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


def not_taken_back(host: str, journal: Journal) -> tuple[Diagnostic, ...]:
    """A warning for each of those steps that cannot be taken back, or not wholly."""
    return tuple(
        refusals.undo_partial(host, step) for _, step in steps_to_undo(journal) if step.undo.level is not UndoLevel.FULL
    )


def undo_run(journal: Journal, *, started_by: str) -> RunStarted:
    """The run that takes the journal's steps back. It raises the serial: what was planned before it is stale."""
    started = journal.started
    steps = tuple(taken_back(step) for _, step in steps_to_undo(journal) if step.undo.operation is not None)
    return replace(
        started,
        run=RunKind.UNDO,
        steps=steps,
        started_by=started_by,
        serials=raised(started.serials, started.application),
    )


def raised(serials: Mapping[str, int], application: str) -> Mapping[str, int]:
    """The serials with this application's counted up by one; a first run makes it 1."""
    return {**serials, application: serials.get(application, 0) + 1}


def taken_back(step: Step) -> Step:
    """The step that undoes this one; undoing that does this one again."""
    operation = step.undo.operation
    assert operation is not None, "a step without an undo is not taken back"
    return replace(
        step,
        title=f"undo: {step.title}",
        operation=operation,
        before=step.after,
        after=step.before,
        undo=replace(step.undo, operation=step.operation),
        claim_before=step.claim_after,
        claim_after=step.claim_before,
    )


def _nothing(host: StepwiseHost, why: str) -> RunReport:
    return RunReport(ending=Ending.NOTHING, diagnostics=(refusals.nothing_to_undo(host.name, why),))
