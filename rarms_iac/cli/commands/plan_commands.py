"""`rarms plan`: what would change, and why; `rarms show`: a plan file, and its scripts as they run."""

from dataclasses import dataclass, replace
from functools import partial

from rarms_iac.app.applying import refuse_provisional
from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.plan_files import read_plan_file
from rarms_iac.app.planning import plan as make_plan
from rarms_iac.app.planning import plan_request
from rarms_iac.app.requests import (
    DatedManifestSource,
    ManifestSource,
    PlanLimits,
    SnapshotSelection,
    argument,
    flag,
    option,
    verbose_option,
)
from rarms_iac.app.scripts import (
    RECEIVE_NAME,
    PlanScripts,
    ScriptSelection,
    check_script,
    compare_with_file,
    only_script,
    plan_scripts,
    scripts_to_write,
    select_scripts,
    write_installable_module,
    write_scripts,
)
from rarms_iac.app.use_case_errors import RequestError, UseCaseError
from rarms_iac.cli.applying import write_and_advise
from rarms_iac.cli.command import rarms_command
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.messages import OutputOptions, is_shown, write_outputs
from rarms_iac.cli.session import Session
from rarms_iac.manifest.load import manifest_path
from rarms_iac.manifest.text.tree import first_line
from rarms_iac.model.commands import APPLY, MEASURE, CommandOption, RecommendedCommand, prose
from rarms_iac.model.diagnostics import Findings, Places, has_errors
from rarms_iac.model.plan import Plan
from rarms_iac.powershell.templates import ScriptForm
from rarms_iac.views.console import paragraph
from rarms_iac.views.findings_text import findings_text
from rarms_iac.views.json_output import json_of
from rarms_iac.views.markdown import is_for_findings, no_plan_as, plan_as
from rarms_iac.views.plan import plan_text
from rarms_iac.views.scripts import difference_text, left_out, script_text


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanOptions(OutputOptions):
    """Options of `rarms plan` alone."""

    out: str | None = option("--out", metavar="FILE", help="Write the plan file, for `rarms apply FILE`.")
    accept_provisional: bool = flag(
        "--accept-provisional", help="Record in the plan file that provisional reservations may be applied."
    )
    verbose: bool = verbose_option()
    detailed_exitcode: bool = flag(
        "--detailed-exitcode", help="Exit with code 2 if there are changes, including those that are held back."
    )


@rarms_command("plan")
def plan_command(
    session: Session,
    source: DatedManifestSource,
    host_selection: SnapshotSelection,
    limits: PlanLimits,
    options: PlanOptions,
) -> ExitCode:
    """Show the changes that an apply would make on the hosts. Changes nothing.

    --output markdown writes the text of a pull-request comment. The formats sarif, junit and github contain the
    findings, even without a plan.
    """
    outputs = options.targets(session)
    places: Places = first_line(manifest_path(source.manifest))
    try:
        manifest = load_manifest(source)
        places = manifest.places
        hosts = select_hosts(manifest, host_selection)
        request = replace(plan_request(hosts, limits), accept_provisional=options.accept_provisional)
        plan = make_plan(hosts, request)
    except UseCaseError as error:
        findings = [output for output in outputs if is_for_findings(output.format)]
        form_of = partial(no_plan_as, manifest=source.manifest, error=error, places=places)
        write_outputs(session.terminal, findings, form_of)
        raise
    write_outputs(
        session.terminal,
        outputs,
        lambda form: plan_as(form, plan, hosts.manifest, verbose=options.verbose),
    )
    if options.out is not None:
        write_and_advise(session, options.out, plan)
    elif is_shown(outputs) and any(part.steps for part in plan.hosts) and not host_selection.snapshots:
        session.terminal.tell(prose("Next: ", _next_command(plan, host_selection, limits)))
    return ExitCode.FOUND if options.detailed_exitcode and plan.has_changes else ExitCode.DONE


def _next_command(plan: Plan, selection: SnapshotSelection, limits: PlanLimits) -> RecommendedCommand:
    """Return the command that makes these changes, or first measures; `rarms apply` plans with the same options."""
    if any(part.needs_consent for part in plan.hosts):
        return MEASURE
    chosen = [CommandOption("--host", name) for name in selection.hosts]
    chosen += [CommandOption("--target", address) for address in limits.targets]
    return replace(APPLY, options=tuple(chosen)).also(max_disruption=limits.max_disruption or False)


@dataclass(frozen=True, slots=True, kw_only=True)
class ShowOptions:
    """Options of `rarms show` alone."""

    plan_file: str | None = argument("[PLAN]", default=None)
    verbose: bool = verbose_option()
    script: bool = flag("--script", help="Show the PowerShell for Hyper-V hosts.")
    guest: str = option(
        "--guest", metavar="PARTITION", help="With --script: the script for this partition's guest.", default=""
    )
    undo: bool = flag("--undo", help="With --script: the undo script.")
    out: str | None = option(
        "--out",
        metavar="FOLDER",
        help=("With --script: write the scripts and undo scripts here. With --transport: write the module to install."),
    )
    single_file: bool = flag(
        "--single-file", help="With --script: put the module into each script, instead of a folder next to it."
    )
    against: str | None = option(
        "--against",
        metavar="FILE",
        help="With --script: show the differences to this plan, by steps, or to this script, by lines.",
    )
    check: str | None = option(
        "--check", metavar="FILE", help="Check that PowerShell can read an edited script; exit with code 2 if not."
    )
    transport: bool = flag("--transport", help="Show the code that receives scripts on a host.")


@rarms_command("show")
def show_command(
    session: Session, options: ShowOptions, source: ManifestSource, host_selection: SnapshotSelection
) -> ExitCode:
    """Show a plan file of `rarms plan --out`, or with --script the scripts that run on its hosts.

    A PLAN needs neither a manifest nor a host. rarms refuses a file whose content does not match its id.
    With --script and without PLAN, rarms makes the plan first. In a pipe or file, the output has the exact bytes of
    one script. --against only shows the differences: the exit code is 0 with and without them.
    """
    if options.check is not None:
        return _check(session, options.check)
    if options.transport:
        return _show_transport(session, options.out)
    if not options.script:
        of_scripts = (options.guest, options.undo, options.out, options.against, options.single_file)
        if any((*of_scripts, host_selection.hosts, host_selection.snapshots)):
            raise RequestError("This option needs --script.")
        if options.plan_file is None:
            raise RequestError("Missing argument '[PLAN]'.")
        plan = read_plan_file(options.plan_file)
        session.answer(lambda: json_of(plan), lambda: plan_text(plan, verbose=options.verbose))
        return ExitCode.DONE
    return _show_scripts(session, _plan(options.plan_file, source, host_selection), host_selection.hosts, options)


def _plan(plan_file: str | None, source: ManifestSource, host_selection: SnapshotSelection) -> Plan:
    if plan_file is not None:
        if host_selection.snapshots:
            raise RequestError("A PLAN cannot be combined with --snapshot.")
        return read_plan_file(plan_file)
    return make_plan(select_hosts(load_manifest(source), host_selection))


def _show_scripts(session: Session, plan: Plan, hosts: tuple[str, ...], options: ShowOptions) -> ExitCode:
    """Show, write or compare the scripts of a plan that are selected."""
    selection = ScriptSelection(hosts=hosts, guest=options.guest, undo=options.undo)
    scripts = plan_scripts(plan, ScriptForm.SINGLE if options.single_file else ScriptForm.MODULE)
    selected = select_scripts(scripts, selection, plan)
    if options.out is not None:
        written = scripts_to_write(plan, scripts, selected, selection)
        for path in write_scripts(written, options.out):
            session.terminal.tell(f"Wrote {path}.")
        for sentence in left_out(plan, scripts, written):
            session.terminal.tell(sentence)
        return ExitCode.DONE
    against = options.against
    if against is not None:
        script = only_script(selected, "--against")
        difference = compare_with_file(against, plan, script)
        session.answer(lambda: json_of(difference), lambda: difference_text(difference))
        return ExitCode.DONE
    if session.as_json:
        session.terminal.data(json_of(PlanScripts(plan=plan.id, scripts=tuple(selected))))
    elif session.terminal.piped and len(selected) == 1:
        refuse_provisional(plan)
        session.terminal.exactly(selected[0].text)
    else:
        for script in selected:
            _show_script(session, script.name, script.text)
    for sentence in left_out(plan, scripts, selected):
        session.terminal.tell(sentence)
    return ExitCode.DONE


def _check(session: Session, path: str) -> ExitCode:
    """Show why PowerShell cannot read a script that was edited."""
    text, findings = check_script(path)
    if session.as_json:
        session.terminal.data(json_of(Findings(findings=tuple(findings))))
    elif findings:
        session.terminal.show(findings_text(findings, {path: text}))
    else:
        session.terminal.show(paragraph(f"PowerShell can read {path}."))
    return ExitCode.FOUND if has_errors(findings) else ExitCode.DONE


def _show_transport(session: Session, out: str | None) -> ExitCode:
    """Return the fixed command that ssh starts, and the receiver that it takes from standard input and runs."""
    from rarms_iac.app.wiring import transport_scripts

    if out is not None:
        receiver = transport_scripts()[RECEIVE_NAME].replace("\n", "\r\n")
        for path in write_installable_module(out, receiver):
            session.terminal.tell(f"Wrote {path}.")
        return ExitCode.DONE
    headings = {
        "loader.ps1": "loader.ps1, the command that ssh runs",
        "bootstrap.ps1": "bootstrap.ps1, which the loader takes from standard input and runs",
        RECEIVE_NAME: "receive.ps1, which runs instead if the module is installed",
    }
    for name, script in transport_scripts().items():
        if session.terminal.piped:
            session.terminal.data(script)
        else:
            _show_script(session, headings[name], script, whole=True)
    return ExitCode.DONE


def _show_script(session: Session, heading: str, text: str, *, whole: bool = False) -> None:
    numbered = script_text(text, colour=session.terminal.colour, whole=whole)
    session.terminal.data(f"{heading}\n{numbered}\n", is_coloured=session.terminal.colour)
