"""A run by a host's own script: sent, followed, and reported like a run that rarms does itself.

The script takes the lock, keeps the journal and guards its steps; what it says is made into the same reports. Where
its end was not heard, nothing is guessed: the host's journal knows, and the next run asks it.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from rarms_iac.applying.refusals import GO_ON, MOVED, STEP_FAILED, lock_held
from rarms_iac.applying.run_report import HostReport, RunBegun, RunEnding, RunReport, TitledStep
from rarms_iac.applying.run_steps import UNATTENDED_RUN, RunControl
from rarms_iac.model.commands import APPLY, DRIFT, prose, sentences
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.journal import RunKind, ScriptRun, StepStatus
from rarms_iac.model.plan import HostSteps, Purpose, RunIdentity
from rarms_iac.powershell.literals import unreadable
from rarms_iac.powershell.render import script_name
from rarms_iac.powershell.templates import MODULE_FOLDER, shipped_module, without_signature
from rarms_iac.providers.interface import (
    EventKind,
    EventStatus,
    HostDamaged,
    RunEvent,
    ScriptBundle,
    ScriptedHost,
    ScriptExited,
    ScriptLost,
    WaitLimits,
)
from rarms_iac.texts.findings import SCRIPT_REFUSED, Finding
from rarms_iac.texts.messages import last_words

UNKNOWN_ENDING = Finding.error("RARMS250", "The result of the run is unknown")

REFUSED_CODE = 3
"""A script's exit code where it would not go on (docs/scripts.md)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptJob:
    """A script for a host, and what is known of its run already."""

    run: RunKind
    plan: str
    script: ScriptBundle
    earlier: Mapping[int, StepStatus]  # steps that an earlier run of it did
    purpose: Purpose = Purpose.APPLY  # of the plan


def apply_job(run: RunIdentity, on: HostSteps, scripts: Mapping[str, str]) -> ScriptJob:
    """Return the bytes of a host's scripts: the one that does the run there, and the one that undoes it."""
    name, undo = script_name(on), script_name(on, undo=True)
    files = {name: scripts[name], undo: scripts[undo], **_module_files(shipped_module())}
    return ScriptJob(run=RunKind.APPLY, plan=run.id, script=_bundle(name, files), earlier={}, purpose=run.purpose)


def finish_job(host: str, journal: ScriptRun) -> ScriptJob:
    """Return the unfinished run as the host's journal holds it, whatever plan, manifest or version there is now.

    Raises:
        HostDamaged: PowerShell cannot read the journal's script.
    """
    started = journal.started
    earlier = {step.number: step.status for step in journal.steps if step.status is not StepStatus.BEGUN}
    name = f"{host}{'.undo' if started.run is RunKind.UNDO else ''}.ps1"
    script = _recorded_script(host, name, started.script, started.module)
    return ScriptJob(run=started.run, plan=started.plan, script=script, earlier=earlier, purpose=started.purpose)


def undo_job(host: str, journal: ScriptRun) -> ScriptJob:
    """Return the undo script that the journal of an apply holds.

    Raises:
        HostDamaged: PowerShell cannot read the journal's script.
    """
    script = _recorded_script(host, f"{host}.undo.ps1", journal.started.undo, journal.started.module)
    started = journal.started
    return ScriptJob(run=RunKind.UNDO, plan=started.plan, script=script, earlier={}, purpose=started.purpose)


def _recorded_script(host: str, name: str, text: str, module: Mapping[str, str]) -> ScriptBundle:
    """Return a script of the journal with its module, which any version of rarms may have made, signed or not.

    The rights of its folder protect the journal; the script itself compares its module with the digests that it holds.

    Raises:
        HostDamaged: PowerShell cannot read it.
    """
    for problem in unreadable(without_signature(text).encode("utf-8", "surrogatepass"), name):
        line = f"line {problem.place.line}, " if problem.place else ""
        message = f"{name} in its journal is damaged: {line}{problem.detail}"
        raise HostDamaged(host, message, "check what the last run did, then remove the journal")
    return _bundle(name, {name: text, **_module_files(module)})


def _bundle(name: str, files: Mapping[str, str]) -> ScriptBundle:
    """Return the script of this name with what lies next to it, and the longest wait for a machine to stop."""
    graces = map(int, re.findall(r"GraceMs(?: =)? ([0-9]{1,9})\b", files[name]))
    return ScriptBundle(runs=name, files=files, longest_grace_ms=max(graces, default=0))


def _module_files(module: Mapping[str, str]) -> dict[str, str]:
    """Return the files of a module by their paths from the script that calls it."""
    return {f"{MODULE_FOLDER}/{name}": text for name, text in module.items()}


def run_job(host: ScriptedHost, job: ScriptJob, control: RunControl) -> RunReport:
    """Have the host run it and tell how it ended.

    Raises:
        HostError: the host could not be reached; nothing was run.
    """
    listener = RunListener(host.name, job, control)
    begun = RunBegun(host=host.name, run=job.run, plan=job.plan, done=len(job.earlier), purpose=job.purpose)
    control.reporter.run_started(begun)
    return listener.report(host.run_script(job.script, control.waits, listener))


def abandon_script(host: ScriptedHost, journal: ScriptRun, waits: WaitLimits) -> RunReport:
    """Have the journal's own script close its run; the host stays as it is.

    Raises:
        HostError: the host could not be reached.
    """
    job = finish_job(host.name, journal)
    listener = RunListener(host.name, job, UNATTENDED_RUN)
    ended = host.run_script(job.script, waits, listener, abandoning=True)
    return replace(listener.report(ended), hosts=())


def description_of(script: str) -> tuple[str, ...]:
    """Return the actions in the help of a script, a line each."""
    description = script.partition("\n.DESCRIPTION")[2].partition("\n.PARAMETER")[0]
    return tuple(line.removeprefix("    ").rstrip() for line in description.splitlines()[1:])


def lines_of_help(script: str, kind: str) -> tuple[str, ...]:
    """Return the lines of one kind of an undo script's help: what it cannot bring back, or foreign values."""
    begin = f"{kind}: "
    return tuple(line.removeprefix(begin) for line in description_of(script) if line.startswith(begin))


class RunListener:
    """An `EventListener` that keeps what a run's report needs, and passes the rest to a `RunReporter`."""

    def __init__(self, host: str, job: ScriptJob, control: RunControl) -> None:
        self._host = host
        self._job = job
        self._reporter = control.reporter
        self.should_stop = control.should_stop
        self._total = 0
        self._statuses = dict(job.earlier)
        self._running: RunEvent | None = None
        self._last: RunEvent | None = None  # that ends the run
        self._other_lines: list[str] = []

    def on_event(self, event: RunEvent) -> None:
        """Tell a step; keep what ends the run."""
        self._total = max(self._total, event.total)
        match event.kind:
            case EventKind.STEP if event.status in {EventStatus.READING, EventStatus.WAITED}:
                self._reporter.host_output(self._host, f"{event.address}: {event.detail}")
            case EventKind.STEP:
                self._step(event)
            case EventKind.RUN if event.status is EventStatus.NOTED:
                self._reporter.host_output(self._host, event.detail)
            case EventKind.LOCK | EventKind.REFUSED | EventKind.FAILED | EventKind.RUN:
                self._last = event

    def on_output(self, line: str) -> None:
        """Show it, and keep it for a run that ends without a word."""
        self._other_lines = [*self._other_lines[-2:], line]
        self._reporter.host_output(self._host, line)

    def _step(self, event: RunEvent) -> None:
        running = self._running
        if running is None or running.number != event.number or event.status is EventStatus.BEGUN:
            self._reporter.step_started(self._host, event.number + 1, event.total, _titled_step(event))
            self._running = event
        if event.status is EventStatus.BEGUN:
            return
        status = StepStatus.CHANGED if event.status is EventStatus.CHANGED else StepStatus.UNCHANGED
        step = _titled_step(running if running is not None and running.number == event.number else event)
        self._statuses.setdefault(event.number, status)
        self._reporter.step_ended(self._host, event.number + 1, event.total, step, status)
        self._running = None

    def report(self, ended: ScriptExited | ScriptLost) -> RunReport:
        """Report how the run ended."""
        ending, *problems = self._ending(ended)
        changed = sum(status is StepStatus.CHANGED for status in self._statuses.values())
        host_report = HostReport(
            host=self._host,
            plan=self._job.plan,
            run=self._job.run,
            ending=ending,
            changed=changed,
            unchanged=len(self._statuses) - changed,
            total=max(self._total, len(self._statuses)),
            purpose=self._job.purpose,
            resumed=bool(self._job.earlier),
        )
        return RunReport(ending=ending, hosts=(host_report,), findings=tuple(problems))

    def _ending(self, ended: ScriptExited | ScriptLost) -> "tuple[RunEnding, *tuple[Diagnostic, ...]]":
        last = self._last
        match ended:
            case ScriptLost(why=why):
                return RunEnding.FAILED, _unknown_ending(self._host, self._job.plan, why)
            case ScriptExited(code=0) if last is not None and last.status in _GOOD_ENDS:
                return (RunEnding.DONE,)
            case ScriptExited(code=code, last_lines=lines) if code == 0 or (last is None and self._total):
                said = " ".join([*self._other_lines, *lines[-3:]])
                why = f"the script ended with exit code {code} before its last event{': ' if said else ''}{said}"
                return RunEnding.FAILED, _unknown_ending(self._host, self._job.plan, why)
            case ScriptExited() if last is not None and last.status is EventStatus.STOPPED:
                return (RunEnding.INTERRUPTED,)
            case ScriptExited(code=code) if code == REFUSED_CODE and last is not None:
                return RunEnding.REFUSED, _script_refused(self._host, last)
            case ScriptExited(code=code, last_lines=lines):
                return RunEnding.FAILED, self._failed(code, lines)

    def _failed(self, code: int, lines: tuple[str, ...]) -> Diagnostic:
        last = self._last
        message = last.detail if last is not None else " ".join([*self._other_lines, *lines[-3:]])
        at = self._running.address if self._running is not None else ""
        return _script_failed(self._host, at, message, code)


_GOOD_ENDS = frozenset({EventStatus.DONE, EventStatus.ABANDONED, EventStatus.UNCHANGED})


def _titled_step(event: RunEvent) -> TitledStep:
    return TitledStep(address=event.address, title=event.detail or event.status.value)


def _unknown_ending(host: str, plan: str, why: str) -> Diagnostic:
    """Return the failure of a started script whose connection was lost before it said how it ended."""
    return UNKNOWN_ENDING.of_host(
        host,
        "Plan {plan} on {host}: {reason}. The script may have changed the host. It may still be running.",
        prose("Run ", APPLY, " to read the journal of the host and finish the run."),
        plan=plan,
        reason=why,
    )


def _script_refused(host: str, event: RunEvent) -> Diagnostic:
    """Return the script ended with exit code 3: before a step, or before any."""
    if event.kind is EventKind.LOCK:
        return lock_held(host, event.reason)
    if event.address == "host":
        return SCRIPT_REFUSED.of_host(
            host,
            "{host}: {reason}.",
            prose("No step was done. Show the state with ", DRIFT, ", then make a new plan."),
            reason=event.reason,
        )
    return MOVED.at(
        None,
        "{resource} on {host}: {reason}.",
        prose("Nothing more was changed. Show the state with ", DRIFT, ". ", GO_ON),
        address=event.address,
        host=host,
        resource=event.address,
        reason=event.reason,
    )


def _script_failed(host: str, at: str, printed: str, code: int) -> Diagnostic:
    """Return the script ended with another exit code, in the middle of a step or outside of all."""
    location, reason = f"{at} on {host}" if at else host, last_words(printed)
    return STEP_FAILED.at(
        None,
        "{_location}: {reason} (exit code {exit_code}).",
        sentences("Correct the cause on the host.", GO_ON),
        address=at or f"host/{host}",
        host=host,
        resource=at,
        exit_code=code,
        reason=reason,
        _location=location,
    )
