"""Applying a plan to live hosts, and finishing what an earlier run left (DESIGN section 4)."""

from collections.abc import Mapping, Sequence

from rarms_iac.apply import refusals
from rarms_iac.apply.reports import Ending, RunReport, RunReporter
from rarms_iac.apply.undo import raised
from rarms_iac.apply.void import no_rights
from rarms_iac.apply.walk import ShouldStop, together, walk
from rarms_iac.diff.moved import part_digests, what_moved
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.journal import Closing, Journal, RunKind, RunStarted
from rarms_iac.model.plan import HostPlan, Plan
from rarms_iac.model.state import Rights
from rarms_iac.providers.interface import HostError, StepwiseHost


def finish_unfinished(
    hosts: Sequence[StepwiseHost], reporter: RunReporter, should_stop: ShouldStop
) -> RunReport | None:
    """Finish what was begun on these hosts, each from its own journal; None where nothing was. They are held."""
    reports: list[RunReport] = []
    for host in hosts:
        try:
            journal = host.unfinished()
            if journal is None:
                continue
            facts = host.observe().facts
            if facts.rights is not Rights.PROVEN:
                return RunReport(ending=Ending.FAILED, diagnostics=(no_rights(facts),))
            reports.append(walk(host, journal, reporter, should_stop))
        except HostError as error:
            reports.append(RunReport(ending=Ending.FAILED, diagnostics=(refusals.host_failed(error),)))
        if reports[-1].ending is not Ending.DONE:
            break
    return together(reports) if reports else None


def apply_plan(
    plan: Plan, hosts: Mapping[str, StepwiseHost], owner: str, reporter: RunReporter, should_stop: ShouldStop
) -> RunReport:
    """Do exactly what the plan says, host by host, or refuse before the first step. The hosts are held.

    A plan of several hosts that was interrupted goes on where it stopped: hosts that it finished are passed over.
    """
    try:
        journals = {part.host.name: hosts[part.host.name].journal() for part in plan.hosts}
        problems = [
            problem
            for part in plan.hosts
            for problem in why_not(plan, part, hosts[part.host.name], journals[part.host.name])
        ]
    except HostError as error:
        return RunReport(ending=Ending.FAILED, diagnostics=(refusals.host_failed(error),))
    if not problems and plan.hosts and all(finished_by(plan, journals[part.host.name]) for part in plan.hosts):
        problems = [refusals.used(part.host.name, plan.id) for part in plan.hosts]
    if problems:
        return RunReport(ending=Ending.REFUSED, diagnostics=tuple(problems))

    reports: list[RunReport] = []
    for part in plan.hosts:
        host, journal = hosts[part.host.name], journals[part.host.name]
        if finished_by(plan, journal) or not part.steps:
            continue
        try:
            if journal is None or not journal.unfinished:
                journal = _begin(host, plan, part, owner)
            reports.append(walk(host, journal, reporter, should_stop))
        except HostError as error:
            reports.append(RunReport(ending=Ending.FAILED, diagnostics=(refusals.host_failed(error),)))
        if reports[-1].ending is not Ending.DONE:
            break
    return together(reports)


def why_not(plan: Plan, part: HostPlan, host: StepwiseHost, journal: Journal | None) -> list[Diagnostic]:
    """Why the plan must not run on this host now; nothing where it may begin, go on, or is done already."""
    if journal is not None and journal.unfinished:
        same = journal.started.plan == plan.id and journal.started.run is RunKind.APPLY
        return [] if same else [refusals.unfinished(host.name, journal)]
    if finished_by(plan, journal):
        return []
    state = host.observe()
    if state.serials.get(plan.application, 0) != part.serial:
        return [refusals.used(host.name, plan.id)]
    parts = what_moved(part.digests, part_digests(state, plan.application))
    return [refusals.moved(host.name, parts)] if parts else []


def finished_by(plan: Plan, journal: Journal | None) -> bool:
    """Whether the host's last run was this plan, done to its end."""
    return (
        journal is not None
        and journal.closed is not None
        and journal.closed.closing is Closing.DONE
        and journal.started.plan == plan.id
        and journal.started.run is RunKind.APPLY
    )


def _begin(host: StepwiseHost, plan: Plan, part: HostPlan, owner: str) -> Journal:
    started = RunStarted(
        run=RunKind.APPLY,
        plan=plan.id,
        application=plan.application,
        started_by=owner,
        host_plan=part,
        steps=part.steps,
        serials=raised(host.observe().serials, plan.application),
    )
    host.start_run(started)
    return Journal(started=started)
