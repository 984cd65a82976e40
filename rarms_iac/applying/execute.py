"""Applying a plan to live hosts, and finishing what an earlier run left."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import assert_never

from rarms_iac.applying import refusals
from rarms_iac.applying.run_report import RunEnding, RunReport
from rarms_iac.applying.run_script import apply_job, finish_job, run_job
from rarms_iac.applying.run_steps import (
    UNATTENDED_RUN,
    ApplyJob,
    RunControl,
    RunJob,
    combined_report,
    failed_run,
    run_steps,
    run_there,
    with_plan,
)
from rarms_iac.applying.undo import raised_serials, without_rights
from rarms_iac.diff.drift import moved_parts, part_digests
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.journal import Closing, Journal, RunKind, RunOrigin, RunStarted, ScriptRun, history_of
from rarms_iac.model.plan import HostPlan, Plan
from rarms_iac.powershell.render import script_name
from rarms_iac.providers.interface import HostError, LiveHost, RobotHost, ScriptedHost, StepwiseHost
from rarms_iac.storage.plan_file import write_plan

LastRun = Journal | ScriptRun | None


def finish_unfinished(hosts: Sequence[LiveHost], control: RunControl = UNATTENDED_RUN) -> RunReport | None:
    """Finish what was begun on these hosts, each from its own journal; None if nothing was. All but robots are held."""
    reports: list[RunReport] = []
    for host in hosts:
        try:
            run = host.unfinished()
            if run is None:
                continue
            reports.append(without_rights(host) or _finish(host, run, control))
            reports[-1] = replace(reports[-1], hosts=tuple(replace(part, resumed=True) for part in reports[-1].hosts))
        except HostError as error:
            reports.append(failed_run(error))
        if reports[-1].ending is not RunEnding.DONE:
            break
    return combined_report(reports) if reports else None


def _finish(host: LiveHost, run: Journal | ScriptRun, control: RunControl) -> RunReport:
    match host:
        case RobotHost():
            assert isinstance(run, Journal), "a host keeps the runs of its kind"
            job = RunJob(plan=run.started.plan, waits=control.waits)
            report = run_there(host, "finish", job, control)
            return with_plan(report, run.started.host_plan) if run.started.run is RunKind.APPLY else report
        case StepwiseHost():
            assert isinstance(run, Journal), "a host keeps the runs of its kind"
            return run_steps(host, run, control)
        case ScriptedHost():
            assert isinstance(run, ScriptRun), "a host keeps the runs of its kind"
            return run_job(host, finish_job(host.name, run), control)
        case _:
            assert_never(host)


def apply_plan(
    plan: Plan, hosts: Mapping[str, LiveHost], origin: RunOrigin, control: RunControl = UNATTENDED_RUN
) -> RunReport:
    """Do exactly what the plan says, host by host, or refuse before the first step. The hosts are held.

    A plan of several hosts that was interrupted goes on where it stopped: hosts that it finished are passed over.
    A robot refuses by itself; it is asked beforehand where the plan has other hosts, too.
    """
    if len(plan.hosts) == 1 and isinstance(robot := hosts[plan.hosts[0].host.name], RobotHost):
        try:
            return _apply_there(robot, plan, plan.hosts[0], control)
        except HostError as error:
            return failed_run(error)
    try:
        journals = {host_plan.host.name: hosts[host_plan.host.name].journal() for host_plan in plan.hosts}
        problems = _refusals(plan, hosts, journals)
    except HostError as error:
        return failed_run(error)
    if problems:
        return RunReport(ending=RunEnding.REFUSED, findings=tuple(problems))

    reports: list[RunReport] = []
    for host_plan in plan.hosts:
        host, journal = hosts[host_plan.host.name], journals[host_plan.host.name]
        if finished_by(plan, journal) or not _has_work(host, host_plan):
            continue
        try:
            match host:
                case RobotHost():
                    report = _apply_there(host, plan, host_plan, control)
                case StepwiseHost():
                    run = _begin_or_resume(host, plan, host_plan, origin, journal)
                    report = run_steps(host, run, control)
                case ScriptedHost():
                    report = run_job(host, apply_job(plan, host_plan, host_plan.scripts), control)
                    report = replace(report, hosts=tuple(replace(run, host_plan=host_plan) for run in report.hosts))
                case _:
                    assert_never(host)
        except HostError as error:
            report = failed_run(error)
        reports.append(report)
        if report.ending is not RunEnding.DONE:
            break
    return combined_report(reports)


def _apply_there(host: RobotHost, plan: Plan, part: HostPlan, control: RunControl) -> RunReport:
    job = ApplyJob(plan=write_plan(plan).decode("utf-8"), waits=control.waits)
    return with_plan(run_there(host, "apply", job, control), part)


def _refusals(plan: Plan, hosts: Mapping[str, LiveHost], journals: Mapping[str, LastRun]) -> list[Diagnostic]:
    """Return the reasons against running the plan on its hosts; one is that it is done on all of them."""
    problems = [
        problem
        for host_plan in plan.hosts
        for problem in refusals_of(plan, host_plan, hosts[host_plan.host.name], journals[host_plan.host.name])
    ]
    if not problems and all(finished_by(plan, journal) for journal in journals.values()):
        return [refusals.used(host, plan.id) for host in journals]
    return problems


def refusals_of(plan: Plan, host_plan: HostPlan, host: LiveHost, journal: LastRun) -> list[Diagnostic]:
    """Return the reasons against this plan on this host now; empty if it may begin, continue, or is done."""
    if journal is not None and journal.unfinished:
        same = journal.started.plan == plan.id and journal.started.run is RunKind.APPLY
        return [] if same else [refusals.unfinished(host.name, journal)]
    if finished_by(plan, journal):
        return []
    if host_plan.steps and isinstance(host, ScriptedHost) and script_name(host_plan) not in host_plan.scripts:
        return [refusals.no_script(host.name, plan.id)]
    state = host.observe()
    serial = state.serials.get(plan.application, 0)
    if serial > host_plan.serial:
        return [refusals.used(host.name, plan.id)]
    if serial < host_plan.serial:
        return [refusals.different_host(host.name, serial, host_plan.serial)]
    moved = moved_parts(host_plan.digests, part_digests(state, plan.application))
    return [refusals.moved(host.name, moved)] if moved else []


def finished_by(plan: Plan, journal: LastRun) -> bool:
    """Return whether the host's last run was this plan and ended well."""
    return (
        journal is not None
        and journal.closed is not None
        and journal.closed.closing is Closing.DONE
        and journal.started.plan == plan.id
        and journal.started.run is RunKind.APPLY
    )


def _has_work(host: LiveHost, host_plan: HostPlan) -> bool:
    """Return whether the host itself has steps; those inside a guest of a Hyper-V host are done there, by hand."""
    if isinstance(host, ScriptedHost):
        return script_name(host_plan) in host_plan.scripts
    return bool(host_plan.steps)


def _begin_or_resume(
    host: StepwiseHost, plan: Plan, host_plan: HostPlan, origin: RunOrigin, last_run: LastRun
) -> Journal:
    """Return the host's unfinished run; without one, begin a run of the plan in the host's journal, and return that."""
    journal = host.unfinished()
    if journal is not None:
        return journal
    started = RunStarted(
        run=RunKind.APPLY,
        plan=plan.id,
        application=plan.application,
        robot=plan.robot,
        purpose=plan.purpose,
        needs_key=plan.needs_key,
        started_by=origin.by,
        started_at=origin.at,
        history=history_of(last_run),
        host_plan=host_plan,
        steps=host_plan.steps,
        serials=raised_serials(host.observe().serials, plan.application),
    )
    host.start_run(started)
    return Journal(started=started)
