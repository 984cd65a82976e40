"""`rarms plan`: what would change, and why."""

import click

from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.planning import PlanRequest
from rarms_iac.app.planning import plan as make_plan
from rarms_iac.app.requests import HostSelection, ManifestSource, PlanLimits
from rarms_iac.cli.applying import show_plan, write_plan_file
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import change_options, host_or_snapshot_options, json_option, manifest_options
from rarms_iac.cli.session import Session, rarms_command


@rarms_command("plan")
@manifest_options
@host_or_snapshot_options
@change_options
@click.option("--out", metavar="FILE", help="Write the plan, sealed, for `rarms apply FILE`.")
@click.option("--verbose", "-v", is_flag=True, help="Show every attribute, reason and step, too.")
@json_option
def command(
    session: Session,
    *,
    source: ManifestSource,
    host_selection: HostSelection,
    limits: PlanLimits,
    out: str | None,
    verbose: bool,
    as_json: bool,
) -> ExitCode:
    """Show what would change on the hosts, and change nothing.

    Exit code 2 where there are changes, 0 where the hosts are as the manifest wants them.
    """
    manifest = load_manifest(source)
    hosts = select_hosts(manifest, host_selection)
    plan = make_plan(hosts, PlanRequest(limits=limits))
    show_plan(session, plan, manifest.sources, as_json=as_json, verbose=verbose)
    if out is not None:
        write_plan_file(session, out, plan)
    return ExitCode.FOUND if plan.has_changes else ExitCode.DONE
