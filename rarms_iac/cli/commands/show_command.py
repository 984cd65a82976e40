"""`rarms show`: a plan file, as `rarms plan` showed it, and its scripts as they run."""

import click

from rarms_iac.app.files import read_plan_file
from rarms_iac.app.hosts import refuse_unfinished, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.cli.applying import show_plan
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import host_or_snapshot_options, json_option, manifest_options
from rarms_iac.cli.planning import Wish, make_plan
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.cli.showing import ScriptOptions, show_check, show_scripts, show_transport
from rarms_iac.model.plan import Plan


@rarms_command("show")
@click.argument("plan_file", metavar="[PLAN]", required=False)
@click.option("--verbose", "-v", is_flag=True, help="Show every attribute, reason and step, too.")
@click.option("--script", is_flag=True, help="Show the scripts: a Hyper-V host's own, or what one would get.")
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
def command(
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
    where: HostSelection,
    as_json: bool,
) -> ExitCode:
    """Show a plan that `rarms plan --out` wrote, or with --script what runs on its hosts.

    A PLAN needs neither manifest nor host; a file that was edited is refused, as `rarms apply` refuses it. With
    --script and without a PLAN, the plan is made first, as `rarms plan` makes it. --against shows a difference and
    judges nothing: the exit code is 0 whether there is one or not.
    """
    options = ScriptOptions(
        hosts=where.hosts, guest=guest, undo=undo, whole=whole, raw=raw, out=out, against=against, as_json=as_json
    )
    if check is not None:
        return show_check(session, check, as_json=as_json)
    if transport:
        return show_transport(session, options)
    if not script:
        _refuse_without_script(options, where)
        if plan_file is None:
            raise click.UsageError("Missing argument '[PLAN]'.", click.get_current_context())
        plan = read_plan_file(plan_file)
        show_plan(session, plan, as_json=as_json, verbose=verbose)
        return ExitCode.DONE
    return show_scripts(session, _plan(plan_file, source, where), options)


def _plan(plan_file: str | None, source: ManifestSource, where: HostSelection) -> Plan:
    if plan_file is not None:
        if where.snapshots:
            raise click.UsageError("A PLAN takes no --snapshot: it was made already.", click.get_current_context())
        return read_plan_file(plan_file)
    manifest = load_manifest(source)
    hosts = select_hosts(manifest, where)
    refuse_unfinished(hosts)
    return make_plan(hosts, Wish())


def _refuse_without_script(options: ScriptOptions, where: HostSelection) -> None:
    given = (options.guest, options.undo, options.whole, options.raw, options.out, options.against)
    if any(given) or where.hosts or where.snapshots:
        raise click.UsageError("That is asked of scripts: add --script.", click.get_current_context())
