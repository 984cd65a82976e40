"""`rarms show`: a plan file, as `rarms plan` showed it, and its scripts as they run."""

from collections.abc import Sequence
from dataclasses import dataclass

import click

from rarms_iac.app.errors import RequestError
from rarms_iac.app.files import read_plan_file
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.app.scripts import (
    PlanScript,
    ScriptSelection,
    check_script,
    compare_with_file,
    inspect_scripts,
    only_script,
    plan_scripts,
    scripts_to_write,
    select_scripts,
    write_scripts,
)
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.options import host_or_snapshot_options, json_option, manifest_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.model.plan import Plan
from rarms_iac.views.finding_forms import findings_json
from rarms_iac.views.findings import findings_text
from rarms_iac.views.scripts import difference_json, difference_text, left_out, script_text, scripts_json


@rarms_command("show")
@click.argument("plan_file", metavar="[PLAN]", required=False)
@click.option("--verbose", "-v", is_flag=True, help="Show every attribute, reason and step, too.")
@click.option("--script", is_flag=True, help="Show the scripts that do it: PowerShell, or a shell's for Linux.")
@click.option("--guest", metavar="PARTITION", default="", help="With --script: the one for this partition's guest.")
@click.option("--undo", is_flag=True, help="With --script: the one that takes it back.")
@click.option("--whole", is_flag=True, help="With --script: also the runtime and the parts, which are fixed.")
@click.option("--raw", is_flag=True, help="With --script: the exact bytes, without numbers.")
@click.option("--out", metavar="FOLDER", help="With --script: write the exact bytes, undo scripts beside them.")
@click.option("--against", metavar="FILE", help="With --script: how it differs from this script or plan, by steps.")
@click.option("--check", metavar="FILE", help="Inspect a script that was edited; exit code 2 where it may not run.")
@click.option("--transport", is_flag=True, help="Show what travels over ssh ahead of a script.")
@manifest_options
@host_or_snapshot_options
@json_option
def show_command(
    session: Session,
    *,
    plan_file: str | None,
    verbose: bool,
    script: bool,
    guest: str,
    undo: bool,
    whole: bool,
    raw: bool,
    out: str | None,
    against: str | None,
    check: str | None,
    transport: bool,
    source: ManifestSource,
    host_selection: HostSelection,
    as_json: bool,
) -> ExitCode:
    """Show a plan that `rarms plan --out` wrote, or with --script what runs on its hosts.

    A PLAN needs neither manifest nor host; a file that was edited is refused, as `rarms apply` refuses it. With
    --script and without a PLAN, the plan is made first, as `rarms plan` makes it. --against shows a difference and
    judges nothing: the exit code is 0 whether there is one or not.
    """
    if check is not None:
        return _check(session, check, as_json=as_json)
    form = ScriptForm(whole=whole, raw=raw, out=out, against=against, as_json=as_json)
    if transport:
        return _show_transport(session, form)
    if not script:
        if guest or undo or whole or raw or out or against or host_selection.hosts or host_selection.snapshots:
            raise RequestError("That is asked of scripts: add --script.")
        if plan_file is None:
            raise RequestError("Missing argument '[PLAN]'.")
        from rarms_iac.cli.applying import show_plan

        plan = read_plan_file(plan_file)
        show_plan(session, plan, as_json=as_json, verbose=verbose)
        return ExitCode.DONE
    selection = ScriptSelection(hosts=host_selection.hosts, guest=guest, undo=undo)
    return _show_scripts(session, _plan(plan_file, source, host_selection), selection, form)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptForm:
    """How scripts are shown or written."""

    whole: bool
    raw: bool
    out: str | None
    against: str | None
    as_json: bool


def _plan(plan_file: str | None, source: ManifestSource, host_selection: HostSelection) -> Plan:
    if plan_file is not None:
        if host_selection.snapshots:
            raise RequestError("A PLAN takes no --snapshot: it was made already.")
        return read_plan_file(plan_file)
    # Imported here, since a plan file needs none of it: that would take a third of the time of `rarms show --script`.
    from rarms_iac.app.hosts import select_hosts
    from rarms_iac.app.manifests import load_manifest
    from rarms_iac.app.planning import PlanRequest
    from rarms_iac.app.planning import plan as make_plan

    manifest = load_manifest(source)
    hosts = select_hosts(manifest, host_selection)
    return make_plan(hosts, PlanRequest())


def _show_scripts(session: Session, plan: Plan, selection: ScriptSelection, form: ScriptForm) -> ExitCode:
    """Show, write or compare the scripts of a plan that are selected."""
    scripts = plan_scripts(plan)
    selected = select_scripts(scripts, selection, plan)
    if form.out is not None:
        written = scripts_to_write(scripts, selected, selection)
        _write(session, written, form.out)
        for sentence in left_out(plan, scripts, written):
            session.terminal.talk(sentence)
        return ExitCode.DONE
    inspect_scripts(selected)
    if form.against is not None:
        script = only_script(selected, "--against")
        difference = compare_with_file(form.against, script)
        if form.as_json:
            session.terminal.data(difference_json(difference, form.against, script.name))
        else:
            session.terminal.show(difference_text(difference, form.against, script.name))
        return ExitCode.DONE
    if form.as_json:
        session.terminal.data(scripts_json(plan.id, selected))
    elif form.raw:
        session.terminal.exactly(only_script(selected, "--raw").text)
    else:
        for script in selected:
            _show_script(session, script.name, script.text, whole=form.whole)
    for sentence in left_out(plan, scripts, selected):
        session.terminal.talk(sentence)
    return ExitCode.DONE


def _write(session: Session, scripts: Sequence[PlanScript], folder: str) -> None:
    inspect_scripts(scripts)
    for path in write_scripts(scripts, folder):
        session.terminal.talk(f"Wrote {path}.")


def _check(session: Session, path: str, *, as_json: bool) -> ExitCode:
    """What is wrong with a script that somebody edited; nothing else is looked at."""
    text, findings = check_script(path)
    if as_json:
        session.terminal.data(findings_json(findings))
    elif findings:
        session.terminal.show(findings_text(findings, {path: text}))
    else:
        session.terminal.data(f"{path} may run: it is made as rarms makes its scripts, whatever values it holds.\n")
    return ExitCode.FOUND if has_errors(findings) else ExitCode.DONE


def _show_transport(session: Session, form: ScriptForm) -> ExitCode:
    """The fixed command that receives scripts at the other end of ssh."""
    from rarms_iac.app.wiring import bootstrap_script

    script = bootstrap_script()
    heading = "bootstrap.ps1, given to ssh as one command"
    if form.raw:
        session.terminal.data(script)
    else:
        _show_script(session, heading, script, whole=True)
    return ExitCode.DONE


def _show_script(session: Session, heading: str, text: str, *, whole: bool) -> None:
    numbered = script_text(text, colour=session.terminal.colour, whole=whole)
    session.terminal.data(f"{heading}\n{numbered}\n")
