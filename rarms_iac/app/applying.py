"""Doing what a plan says on live hosts, finishing what an earlier run left, and closing it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from rarms_iac.app.control import UNATTENDED, Control
from rarms_iac.app.files import folder_of
from rarms_iac.app.hosts import NO_CHANNELS, Hosts, hold_hosts, host_errors, run_origin, select_hosts
from rarms_iac.app.manifests import declared_application, demands_signed_plans, load_manifest
from rarms_iac.app.plan_files import plan_key
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.app.wiring import open_host, unfinished_simulated_hosts
from rarms_iac.applying import refusals
from rarms_iac.applying.execute import apply_plan, finish_unfinished
from rarms_iac.applying.refusals import MOVED, OTHERS_RUN
from rarms_iac.applying.run_report import RunReport
from rarms_iac.applying.run_steps import RunControl
from rarms_iac.applying.undo import abandon
from rarms_iac.manifest.load import manifest_digest
from rarms_iac.model.commands import PLAN, PLAN_OUT, command, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.journal import Journal, RunKind, ScriptRun
from rarms_iac.model.plan import Plan
from rarms_iac.powershell.templates import without_signature
from rarms_iac.providers.channel import CommandChannel
from rarms_iac.providers.interface import NO_WAITING, LiveHost, WaitLimits
from rarms_iac.storage.plan_file import is_signed, is_signed_script
from rarms_iac.storage.reading import STANDARD_INPUT
from rarms_iac.texts.findings import Finding
from rarms_iac.texts.messages import in_a_row
from rarms_iac.texts.plans import reversal_title

MANIFEST_CHANGED = Finding.note("RARMS371", "The manifest has changed since the plan was made")


def apply(
    plan: Plan,
    *,
    folder: str | Path | None = None,
    waits: WaitLimits = NO_WAITING,
    control: Control = UNATTENDED,
    channels: Mapping[str, CommandChannel] = NO_CHANNELS,
) -> RunReport:
    """Do exactly what a plan says, host by host, or refuse before the first step.

    A plan of several hosts that was interrupted goes on where it stopped. No question is asked.

    Args:
        plan: as `planning.plan` made it, or as `plan_files.read_plan_file` read it.
        folder: what simulated hosts lie below; None: the folder of the manifest that the plan names.
        waits: how long to wait for a held host, and for the next word of a host's script.
        control: hears of each step, and is asked after each whether to stop; the run can be finished later.

    Returns:
        How it ended, with the changes of each host. A refusal and a host's failure are reported here, not raised.

    Raises:
        UseCaseError: a host is held, or the simulated host of the plan is not here (refused); or this version cannot
            reach a host (failed).
    """
    if folder is None:
        _refuse_elsewhere(plan)
    refuse_unsigned(plan)
    refuse_provisional(plan)
    below = folder_of(plan.manifest) if folder is None else Path(folder)
    hosts = {
        part.host.name: open_host(part.host, below, part.state_path, channels.get(part.host.name))
        for part in plan.hosts
    }
    with hold_hosts(tuple(hosts.values()), waits.lock_ms), control.stop.gently():
        return apply_plan(plan, hosts, run_origin(), run_control(control, waits))


def run_control(control: Control, waits: WaitLimits) -> RunControl:
    """Return the caller's part in a run."""
    return RunControl(reporter=control.reporter.steps, should_stop=control.stop.should_stop, waits=waits)


def refuse_unsigned(plan: Plan) -> None:
    """Refuse a plan without a signature that fits the key, or without a key where its manifest demands one.

    Raises:
        UseCaseError: it is not signed, or no key is set (refused).
        RequestError: the key is not as it must be.
    """
    key = plan_key()
    if key is None:
        if plan.needs_key:
            raise UseCaseError(Outcome.REFUSED, [refusals.without_key(plan.id)])
        return
    wrong = [part.host.name for part in plan.hosts if not is_signed(plan.id, plan.application, part, key)]
    if wrong:
        findings = [refusals.unsigned(name, plan.id, is_begun=False) for name in wrong]
        raise UseCaseError(Outcome.REFUSED, findings)


def refuse_provisional(plan: Plan) -> None:
    """Refuse a plan that sets provisional reservations on a host that is not simulated, unless it says that it may.

    Raises:
        UseCaseError: It does not say so (refused).
    """
    parts = [part for part in plan.hosts if part.needs_consent]
    if parts and not plan.accepts_provisional:
        findings = [refusals.not_accepted(plan.id, part.name, part.provisional) for part in parts]
        raise UseCaseError(Outcome.REFUSED, findings)


def refuse_unsigned_runs(hosts: Sequence[LiveHost], *, needs_key: bool) -> None:
    """Refuse unfinished runs whose journal does not hold a plan that was signed with the key, where one is set.

    Raises:
        UseCaseError: a run is not signed, or no key is set (refused).
        RequestError: the key is not as it must be.
    """
    key = plan_key()
    with host_errors():
        runs = [(host.name, run) for host in hosts if (run := host.unfinished()) is not None]
    if key is None:
        demanding = {
            run.started.plan for _, run in runs if needs_key or (isinstance(run, Journal) and run.started.needs_key)
        }
        if demanding:
            raise UseCaseError(Outcome.REFUSED, [refusals.without_key(plan) for plan in sorted(demanding)])
        return
    findings = [
        refusals.unsigned(name, run.started.plan, is_begun=True) for name, run in runs if not _is_signed_run(run, key)
    ]
    if findings:
        raise UseCaseError(Outcome.REFUSED, findings)


def _is_signed_run(run: Journal | ScriptRun, key: bytes) -> bool:
    """Return whether a journal's steps or its script belong to a signed plan, or undo steps of one."""
    if isinstance(run, ScriptRun):
        return is_signed_script(without_signature(run.started.script), key)
    started = run.started
    if not is_signed(started.plan, started.application, started.host_plan, key):
        return False
    known, changes = started.host_plan.steps, started.host_plan.changes_by_address
    if started.run is RunKind.APPLY:
        return started.steps == known
    undone = [step.reversed(reversal_title(step, changes)) for step in known if step.undo.operation is not None]
    return all(step in undone for step in started.steps)


def _refuse_elsewhere(plan: Plan) -> None:
    """Refuse a folder without the manifest: a new and empty simulated host would be changed there."""
    simulated = [part.host.name for part in plan.hosts if part.host.provider is ProviderKind.SIMULATED]
    if simulated and plan.manifest != STANDARD_INPUT and not Path(plan.manifest).exists():
        template = (
            "The manifest of the plan, {manifest}, does not exist here. The state of {hosts:each} is "
            "next to that manifest."
        )
        advice = prose(
            "Apply the plan in the folder where it was made, or give the manifest: ",
            command("apply", "PLAN", f="MANIFEST"),
            ".",
        )
        raise UseCaseError(
            Outcome.REFUSED,
            [MOVED.at(None, template, advice, manifest=plan.manifest, hosts=tuple(sorted(simulated)))],
        )


def finish_runs(
    hosts: Sequence[LiveHost],
    *,
    waits: WaitLimits = NO_WAITING,
    control: Control = UNATTENDED,
    needs_key: bool = False,
) -> RunReport | None:
    """Finish what an earlier run left on these hosts, each from its own journal.

    Args:
        hosts: live hosts, in any order; they are held meanwhile.
        waits: how long to wait for a held host, and for the next word of a host's script.
        control: hears of each step, and is asked after each whether to stop; the run can be finished later.
        needs_key: the policy demands signed plans, so nothing is finished where no key is set.

    Returns:
        How that ended; None if no host has an unfinished run.

    Raises:
        UseCaseError: a host is held, or a key is set and a run's plan is not signed with it (refused).
        RequestError: the key is not as it must be.
    """
    with hold_hosts(tuple(hosts), waits.lock_ms), control.stop.gently():
        refuse_unsigned_runs(hosts, needs_key=needs_key)
        return finish_unfinished(hosts, run_control(control, waits))


def abandon_runs(hosts: Sequence[LiveHost], *, waits: WaitLimits = NO_WAITING) -> Mapping[str, RunReport]:
    """Close the unfinished runs of these hosts, by host; the hosts stay as they are.

    Args:
        hosts: live hosts, in any order; they are held meanwhile.
        waits: how long to wait for a held host, and for the next word of a host's script.

    Returns:
        What became of each host, by name; nothing to do where it has no unfinished run.

    Raises:
        UseCaseError: a host is held (refused).
    """
    with hold_hosts(tuple(hosts), waits.lock_ms):
        return {host.name: abandon(host, waits) for host in hosts}


def hosts_to_apply(source: ManifestSource, selection: HostSelection) -> Hosts | tuple[LiveHost, ...]:
    """Find where something is to be done: what was begun is finished also where the manifest has errors by now.

    Args:
        source: the manifest, whose folder is searched where it has errors.
        selection: which of its hosts are meant.

    Returns:
        The manifest's hosts; or, where it has errors, the simulated hosts next to it whose last run did not end, in the
            order of their files.

    Raises:
        RequestError: a name is not in the manifest.
        UseCaseError: the manifest has errors (negative), and nothing is unfinished; or a snapshot cannot be read
            (failed).
    """
    try:
        manifest = load_manifest(source)
    except UseCaseError:
        if unfinished := unfinished_simulated_hosts(folder_of(source.manifest)):
            return unfinished
        raise
    return select_hosts(manifest, selection)


def manifest_of(plan: Plan, given: ManifestSource, *, is_named: bool) -> ManifestSource:
    """Name the manifest and the overlays that a plan was made of.

    Args:
        given: the caller's; its overlays count if there are any, and the day is taken from it.

    Returns:
        The source; what the caller did not name is as the plan has it, but for a manifest from standard input.
    """
    manifest = given.manifest if is_named or plan.manifest == STANDARD_INPUT else plan.manifest
    return replace(given, manifest=manifest, overlays=given.overlays or plan.overlays)


def refuse_contradiction(plan: Plan, source: ManifestSource) -> None:
    """Refuse a plan where the manifest is another application's by now, or demands a key that is not set.

    The plan of another application would make what no manifest names, and a plan's own word on the key can be forged.

    Args:
        plan: the plan, with the name of its application.

    Raises:
        UseCaseError: the manifest names another application, or wants signed plans where no key is set (refused).
        RequestError: the key is not as it must be.
    """
    if source.manifest == STANDARD_INPUT:
        return
    # A forged plan could name an overlay that asks for no key, so the manifest is also read without its overlays.
    if plan_key() is None and (demands_signed_plans(source) or demands_signed_plans(replace(source, overlays=()))):
        raise UseCaseError(Outcome.REFUSED, [refusals.without_key(plan.id)])
    name = declared_application(source)
    if name is None or name == plan.application:
        return
    refusal = OTHERS_RUN.at(
        None,
        (
            "Plan {plan} is for the application {application:quoted}, but {manifest} describes "
            "{manifest_application:quoted}."
        ),
        prose("Nothing was changed. Make a new plan: ", PLAN_OUT, "."),
        plan=plan.id,
        application=plan.application,
        manifest=source.manifest,
        manifest_application=name,
    )
    raise UseCaseError(Outcome.REFUSED, [refusal])


def changed_manifest(plan: Plan, source: ManifestSource) -> tuple[Diagnostic, ...]:
    """Find that a plan's manifest reads differently now; the plan is applied as it was reviewed all the same.

    Args:
        plan: The plan, with the digest of the texts that it was made of.
        source: As `manifest_of` returns it: the manifest, and the overlays that are laid over it.

    Returns:
        A note; nothing where the texts are the same, or cannot be read here.
    """
    if source.manifest == STANDARD_INPUT:
        return ()
    if manifest_digest(source.manifest, source.overlays) in {None, plan.manifest_digest}:
        return ()
    files = in_a_row((source.manifest, *source.overlays), "or")
    note = MANIFEST_CHANGED.at(
        None,
        "{_files} has changed since plan {plan} was made. rarms applies the reviewed plan.",
        prose("To see the changes for the current manifest, run ", PLAN, "."),
        manifest=source.manifest,
        overlays=source.overlays,
        plan=plan.id,
        _files=files,
    )
    return (note,)
