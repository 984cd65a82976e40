"""`rarms apply` does what a plan says, and `rarms undo` reverses it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import click
from click.core import ParameterSource

from rarms_iac.app.applying import abandon_runs, changed_manifest, hosts_to_apply, manifest_of, refuse_contradiction
from rarms_iac.app.control import Control
from rarms_iac.app.files import folder_of
from rarms_iac.app.hosts import Hosts, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.plan_files import read_plan_file
from rarms_iac.app.planning import plan_request
from rarms_iac.app.requests import (
    DEFAULT_MANIFEST,
    DatedManifestSource,
    HostSelection,
    ManifestSource,
    PlanLimits,
    RunOptions,
    argument,
    flag,
    load_host_option,
)
from rarms_iac.app.undoing import LastApply, can_keep, last_applies, preview, refuse_keeping, undo_applies
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.applying.run_report import RunEnding, RunReport
from rarms_iac.applying.run_steps import combined_report
from rarms_iac.cli.applying import apply_and_show, ask, finish_first, plan_ask_apply, report_end
from rarms_iac.cli.command import name_manifest, rarms_command
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.messages import TerminalReporter, tell
from rarms_iac.cli.session import Session
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.plan import Plan
from rarms_iac.providers.interface import LiveHost
from rarms_iac.views.run import undo_text


@dataclass(frozen=True, slots=True, kw_only=True)
class ApplyOptions:
    """Options of `rarms apply` alone."""

    plan_file: str | None = argument("[PLAN]", default=None)
    proving: bool = flag("--prove", help="Run `rarms prove` afterwards.")
    load_host: bool = load_host_option()
    abandoning: bool = flag("--abandon", help="Close an unfinished run and leave the host as it is.")


@rarms_command("apply")
def apply_command(
    session: Session,
    options: ApplyOptions,
    source: DatedManifestSource,
    host_selection: HostSelection,
    limits: PlanLimits,
    how: RunOptions,
) -> ExitCode:
    """Apply PLAN exactly. Without PLAN: make a plan, show it, ask, and apply it.

    rarms first finishes an interrupted run. It refuses a PLAN that was edited or already used, and a PLAN of a host
    that has changed since. Ctrl-C stops after the running step. With --prove, exit code 4 means that the layout misses
    a threshold. `rarms undo` reverses the apply.
    """
    session.answer_follows = options.proving
    if options.proving:
        from rarms_iac.cli.prompts import refuse_load_unasked

        refuse_load_unasked(session, loads=True, load_host=options.load_host)
    elif options.load_host:
        raise RequestError("--load-host is for --prove.")
    if options.plan_file is not None:
        if options.abandoning or host_selection.hosts or limits.targets or limits.max_disruption:
            raise RequestError("A PLAN cannot be combined with --host, --target, --max-disruption or --abandon.")
        return _apply_file(session, read_plan_file(options.plan_file), source, how, proving=options.proving)
    if options.proving and options.abandoning:
        raise RequestError("--abandon cannot be combined with --prove.")
    hosts = hosts_to_apply(source, host_selection)
    live = tuple(hosts.open(name) for name in hosts.chosen) if isinstance(hosts, Hosts) else hosts
    if options.abandoning:
        return _abandon(session, live, how)
    if isinstance(hosts, Hosts):
        code = plan_ask_apply(session, hosts, plan_request(hosts, limits), how)
    else:
        code = report_end(session, finish_first(session, live, how) or RunReport(ending=RunEnding.NOTHING))
    return _then_prove(session, source, host_selection, how, code) if options.proving else code


def _apply_file(session: Session, plan: Plan, source: ManifestSource, how: RunOptions, *, proving: bool) -> ExitCode:
    """Apply a plan as it was reviewed, and prove it if that is asked for."""
    manifest_source = manifest_of(plan, source, is_named=_is_named())
    if not source.overlays:
        name_manifest(session, manifest_source, in_advice=_is_named() or plan.manifest != DEFAULT_MANIFEST)
    refuse_contradiction(plan, manifest_source)
    notes = changed_manifest(plan, manifest_source)
    tell(session.terminal, notes)
    folder = folder_of(source.manifest) if _is_named() else None
    report = apply_and_show(session, plan, folder, how)
    told = replace(report, findings=(*notes, *report.findings))
    code = report_end(session, told, shown=notes)
    if not proving:
        return code
    planned = HostSelection(hosts=tuple(part.host.name for part in plan.hosts))
    return _then_prove(session, manifest_source, planned, how, code)


def _then_prove(
    session: Session, source: ManifestSource, host_selection: HostSelection, how: RunOptions, code: ExitCode
) -> ExitCode:
    """Prove what was applied; refused where the manifest asks for more by now. The answer in JSON is the proof."""
    if code is not ExitCode.DONE:
        return code
    from rarms_iac.cli.commands.component_commands import prove_and_show
    from rarms_iac.measuring.prove import ProveRequest

    hosts = select_hosts(load_manifest(source), host_selection)
    return prove_and_show(session, hosts, ProveRequest(lock_timeout_ms=how.lock_timeout_ms))


def _abandon(session: Session, live: tuple[LiveHost, ...], how: RunOptions) -> ExitCode:
    reports = abandon_runs(live, waits=how.waits)
    for name, report in reports.items():
        if report.ending is RunEnding.DONE:
            session.terminal.tell(f"{name}: closed the unfinished run. The host was not changed.")
    return report_end(session, combined_report(reports.values()))


def _is_named() -> bool:
    return click.get_current_context().get_parameter_source("manifest") is not ParameterSource.DEFAULT


@dataclass(frozen=True, slots=True, kw_only=True)
class UndoOptions:
    """Options of `rarms undo` alone."""

    keep: bool = flag("--keep", help="Do not restore the values of other tools that the apply replaced.")


@rarms_command("undo")
def undo_command(
    session: Session, source: ManifestSource, host_selection: HostSelection, options: UndoOptions, how: RunOptions
) -> ExitCode:
    """Undo the last apply, finished or not, beginning with its last step.

    rarms shows the steps, the changes that cannot be undone, and the values of other tools that the undo restores.
    Then it asks for confirmation. An undo removes the machines that the apply created, even with `protect: true`. If
    the last applies of the hosts differ, select a host with --host.
    """
    applies = last_applies(select_hosts(load_manifest(source), host_selection))
    keep = options.keep
    shown: tuple[Diagnostic, ...] = ()
    if any(last.can_be_undone for last in applies):
        if keep:
            refuse_keeping(applies)
        if not (how.auto_approve or session.terminal.answers):
            raise RequestError("rarms cannot ask: standard input is not a terminal. Use --auto-approve.")
        shown = _show_undo(session, applies, keep=keep)
        if not how.auto_approve:
            keep = _ask_undo(session, applies, keep=keep)
    with TerminalReporter(session, steps_as_json=session.as_json) as reporter:
        control = Control(reporter=reporter, stop=session.interrupts)
        report = undo_applies(applies, waits=how.waits, control=control, keep=keep)
    return report_end(session, report, shown=shown)


def _show_undo(session: Session, applies: Sequence[LastApply], *, keep: bool) -> tuple[Diagnostic, ...]:
    previews = tuple(preview(applies, keep=keep))
    for undo in previews:
        session.terminal.talk(undo_text(undo))
    findings = tuple(finding for undo in previews for finding in undo.findings)
    tell(session.terminal, findings)
    return findings


def _ask_undo(session: Session, applies: Sequence[LastApply], *, keep: bool) -> bool:
    """Ask for the undo, and return whether the manifest's values are kept."""
    if keep or not can_keep(applies):
        ask(session, "Undo this?")
        return keep
    return ask(session, "Undo this? `keep` undoes it but keeps the values of the manifest.", "keep") == "keep"
