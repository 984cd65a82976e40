"""Running a plan at a terminal: show it, ask, do it, and report how it ended."""

import shlex
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rarms_iac.app.applying import apply, finish_runs, refuse_provisional
from rarms_iac.app.control import Control
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.plan_files import plan_key, write_plan_file
from rarms_iac.app.planning import plan as make_plan
from rarms_iac.app.requests import RunOptions
from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError, declined
from rarms_iac.applying.plan_request import PlanRequest
from rarms_iac.applying.refusals import UNFINISHED
from rarms_iac.applying.run_report import RunEnding, RunReport
from rarms_iac.applying.run_steps import combined_report
from rarms_iac.cli.command import overlay_words
from rarms_iac.cli.ending import ExitCode, Interrupted
from rarms_iac.cli.messages import TerminalReporter, tell
from rarms_iac.cli.session import Session
from rarms_iac.manifest.checks.names import NOT_USED
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, Sources
from rarms_iac.model.plan import Plan, Purpose
from rarms_iac.providers.interface import LiveHost
from rarms_iac.texts.findings import ROUNDED
from rarms_iac.views.json_output import json_of
from rarms_iac.views.plan import plan_text
from rarms_iac.views.run import next_command, run_text


def show_plan(session: Session, plan: Plan, sources: Sources) -> None:
    """Show a plan that was made now, as text, or as JSON for a program."""
    session.answer(lambda: json_of(plan), lambda: plan_text(plan, sources=sources))


def write_and_advise(session: Session, path: str, plan: Plan) -> None:
    """Write the plan and say how to use it, or why it cannot be used."""
    write_plan_file(path, plan)
    if plan.needs_key and plan_key() is None:
        advice = (
            " It is not signed, but the manifest has `signed_plans: true`, so `rarms apply` will refuse it. "
            "Set RARMS_PLAN_KEY or RARMS_PLAN_KEY_FILE, and plan again."
        )
    else:
        words = shlex.join(["rarms", "apply", path, *overlay_words(plan.overlays)])
        advice = f" Apply it with: {words}" if plan.has_changes else ""
        if not plan.accepts_provisional and any(host.needs_consent for host in plan.hosts):
            advice = (
                " It sets provisional reservations, so `rarms apply` will refuse it. Run `rarms measure`, "
                "or plan again with --accept-provisional."
            )
    session.terminal.tell(f"Wrote the plan to {path}.{advice}")


def finish_first(
    session: Session, live: tuple[LiveHost, ...], how: RunOptions, *, needs_key: bool = False
) -> RunReport | None:
    """Finish what an earlier run left on these hosts, asking nothing; None if nothing was unfinished."""
    with TerminalReporter(session, steps_as_json=session.as_json) as reporter:
        control = Control(reporter=reporter, stop=session.interrupts)
        return finish_runs(live, waits=how.waits, control=control, needs_key=needs_key)


def plan_ask_apply(session: Session, hosts: Hosts, request: PlanRequest, how: RunOptions) -> ExitCode:
    """Plan, then write the plan (`how.out`), or show it, ask, and do it.

    An unfinished run is finished first. If that did what the command asks for, there is nothing left to ask.
    """
    if how.out is not None:
        written = make_plan(hosts, request)
        show_plan(session, written, hosts.manifest.sources)
        write_and_advise(session, how.out, written)
        return ExitCode.DONE
    needs_key = hosts.system.policy.signed_plans
    finished: list[RunReport] = []
    plan = None
    while plan is None:
        looked = hosts.with_one_look()
        live = tuple(looked.open(name) for name in hosts.chosen)
        earlier = finish_first(session, live, how, needs_key=needs_key)
        if earlier is not None:
            if earlier.ending is not RunEnding.DONE:
                return report_end(session, earlier, before=finished)
            tell(session.terminal, earlier.findings)
            session.terminal.talk(run_text(earlier))
            finished.append(earlier)
            if session.interrupts.exit_code is not None:  # asked for during its last step
                raise Interrupted(session.interrupts.exit_code)
        plan = _plan_or_wait(looked if earlier is None else hosts, request, how)
    is_idle = not any(part.steps for part in plan.hosts)
    if not (how.auto_approve or session.terminal.answers or (finished and is_idle)):
        raise _no_terminal(request.purpose)
    text = plan_text(_as_asked(plan), sources=hosts.manifest.sources)
    if session.as_json:
        session.terminal.talk(text)
    else:
        session.terminal.show(text)
    if is_idle:
        return report_end(session, RunReport(ending=RunEnding.NOTHING), before=finished, quiet=True)
    refuse_provisional(plan)
    if not how.auto_approve:
        ask(session, "Run this plan?")
    return report_end(session, apply_and_show(session, plan, hosts.folder, how), before=finished)


def _no_terminal(purpose: Purpose) -> RequestError:
    return RequestError(
        "rarms cannot ask: standard input is not a terminal.",
        prose(
            "Use --auto-approve, or write a plan file and apply it: ",
            command("plan" if purpose is Purpose.APPLY else purpose.value, out="FILE"),
            ", then ",
            command("apply", "FILE"),
            ".",
        ),
    )


def _as_asked(plan: Plan) -> Plan:
    """Return the plan without the findings that do not help to decide.

    `validate` and `plan` say what the manifest does not use. Where no reservation is made, none of the manifest is
    rounded; a machine's own fraction, which has no place in the manifest, is said.
    """
    left_out = {NOT_USED.code} | ({ROUNDED.code} if plan.purpose is not Purpose.APPLY else set())
    return replace(
        plan, findings=tuple(each for each in plan.findings if each.code not in left_out or each.place is None)
    )


def _plan_or_wait(hosts: Hosts, request: PlanRequest, how: RunOptions) -> Plan | None:
    """Return the plan; None where another run began meanwhile and this one is to wait for it."""
    try:
        return make_plan(hosts, request)
    except UseCaseError as refusal:
        if how.lock_timeout_ms and any(finding.code == UNFINISHED.code for finding in refusal.findings):
            return None
        raise


def apply_and_show(session: Session, plan: Plan, folder: Path | None, how: RunOptions) -> RunReport:
    """Do what the plan says; the first signal stops after the running step."""
    with TerminalReporter(session, steps_as_json=session.as_json) as reporter:
        return apply(plan, folder=folder, waits=how.waits, control=Control(reporter=reporter, stop=session.interrupts))


def ask(session: Session, question: str, other: str = "") -> str:
    """Go on only after a yes.

    Args:
        question: ends with a question mark, or with what the other answer does.
        other: an answer apart from `yes`; empty: none.

    Returns:
        The answer.

    Raises:
        UseCaseError: the answer was another, or a signal.
    """
    try:
        session.terminal.flush()
        answers = f"Type `yes` or `{other}`" if other else "Type `yes` to confirm"
        session.terminal.status(f"\n{question} {answers}: ")
        answer = sys.stdin.readline()
    except Interrupted:
        session.terminal.talk("")
        raise UseCaseError(Outcome.INTERRUPTED, [declined()]) from None
    if not answer.endswith("\n"):
        session.terminal.talk("")
    if answer.strip() not in {"yes", other} or not answer.strip():
        raise UseCaseError(Outcome.REFUSED, [declined()])
    return answer.strip()


def report_end(
    session: Session,
    report: RunReport,
    *,
    quiet: bool = False,
    shown: Sequence[Diagnostic] = (),
    before: Sequence[RunReport] = (),
) -> ExitCode:
    """Say how a run ended and which command is next, and give the command's exit code.

    Args:
        quiet: write no sentence about it.
        shown: findings that were shown before it began.
        before: runs of this command whose end was shown; the answer in JSON has them as well.
    """
    tell(session.terminal, [finding for finding in report.findings if finding not in shown])
    whole = combined_report([*before, report])
    if session.as_json and not (session.answer_follows and whole.ending in {RunEnding.DONE, RunEnding.NOTHING}):
        session.terminal.data(json_of(whole, indent=None))
    elif not quiet and (report.hosts or report.ending in {RunEnding.NOTHING, RunEnding.INTERRUPTED}):
        is_last = whole.ending is RunEnding.DONE and not session.answer_follows
        following = next_command(report, answers=session.terminal.answers) if is_last else None
        session.terminal.talk(run_text(report, following))
    return code_of(session, whole.ending)


def code_of(session: Session, ending: RunEnding) -> ExitCode:
    """Return the exit code of a run that ended so."""
    match ending:
        case RunEnding.DONE | RunEnding.NOTHING:
            return ExitCode.DONE
        case RunEnding.REFUSED:
            return ExitCode.REFUSED
        case RunEnding.FAILED:
            return ExitCode.FAILED
        case RunEnding.INTERRUPTED:
            return session.interrupts.exit_code or ExitCode.INTERRUPTED
