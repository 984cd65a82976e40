"""Runs of steps: those of a plan that was sent, and those that the machine's journal holds."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from rarms_iac.app.applying import refuse_provisional, refuse_unsigned, refuse_unsigned_runs, run_control
from rarms_iac.app.control import Control, SilentAppReporter
from rarms_iac.app.hosts import hold_hosts, run_origin
from rarms_iac.app.plan_files import plan_in, plan_key
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.app.wiring import open_host
from rarms_iac.applying import refusals
from rarms_iac.applying.execute import apply_plan, finish_unfinished
from rarms_iac.applying.run_report import RunReporter
from rarms_iac.applying.run_steps import STEPS, ApplyJob, RunControl, RunJob, UndoJob, without_plans
from rarms_iac.applying.undo import abandon as abandon_run
from rarms_iac.applying.undo import undo as undo_run
from rarms_iac.model.host import Host
from rarms_iac.model.journal import Journal, RunKind, ScriptRun
from rarms_iac.providers.interface import LiveHost, WaitLimits
from rarms_iac.robot.caller import Caller
from rarms_iac.storage.codec import Json, decode, encode


def apply(host: Host, job: Json, caller: Caller) -> Json:
    """Apply the part of a plan that is this host's."""
    asked = decode(ApplyJob, job)
    plan = plan_in("the plan that was sent", asked.plan.encode("utf-8"))
    if plan_key() is not None:
        refuse_unsigned(plan)
    refuse_provisional(plan)
    parts = [part for part in plan.hosts if part.host.name == host.name]
    live = open_host(host, Path(), "")
    with _held(live, asked.waits, caller) as control:
        return encode(
            without_plans(apply_plan(replace(plan, hosts=tuple(parts)), {host.name: live}, run_origin(), control))
        )


def finish(host: Host, job: Json, caller: Caller) -> Json:
    """Finish the unfinished run that the other side saw."""
    asked = decode(RunJob, job)
    live = open_host(host, Path(), "")
    with _held(live, asked.waits, caller) as control:
        _refuse_another(asked, live.unfinished(), host.name)
        if plan_key() is not None:
            refuse_unsigned_runs([live], needs_key=False)
        report = finish_unfinished([live], control)
    assert report is not None, "there was an unfinished run, and the host is held"
    return encode(without_plans(report))


def abandon(host: Host, job: Json, caller: Caller) -> Json:
    """Close the unfinished run that the other side saw."""
    asked = decode(RunJob, job)
    live = open_host(host, Path(), "")
    with _held(live, asked.waits, caller):
        _refuse_another(asked, live.unfinished(), host.name)
        return encode(abandon_run(live))


def undo(host: Host, job: Json, caller: Caller) -> Json:
    """Undo the apply that the other side saw."""
    asked = decode(UndoJob, job)
    live = open_host(host, Path(), "")
    with _held(live, asked.waits, caller) as control:
        last = live.journal()
        _refuse_another(asked, last, host.name)
        if plan_key() is not None and last is not None and last.started.run is RunKind.UNDO:
            refuse_unsigned_runs([live], needs_key=False)
        return encode(without_plans(undo_run(live, run_origin(), control, keep=asked.keep)))


@contextmanager
def _held(live: LiveHost, waits: WaitLimits, caller: Caller) -> Iterator[RunControl]:
    with hold_hosts((live,), waits.lock_ms), caller.interrupts.gently():
        reporter = SilentAppReporter()
        reporter.steps = caller.sends(RunReporter, STEPS)
        yield run_control(Control(reporter=reporter, stop=caller.interrupts), waits)


def _refuse_another(asked: RunJob, run: Journal | ScriptRun | None, host: str) -> None:
    if run is None or run.started.plan != asked.plan:
        raise UseCaseError(Outcome.REFUSED, [refusals.used(host, asked.plan)])


COMMANDS = {"apply": apply, "finish": finish, "abandon": abandon, "undo": undo}
