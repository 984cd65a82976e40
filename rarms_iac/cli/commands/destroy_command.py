"""`rarms destroy`: remove what rarms made."""

import click

from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.planning import PlanRequest
from rarms_iac.app.requests import HostSelection, ManifestSource, PlanLimits, RunOptions
from rarms_iac.cli.applying import plan_ask_apply
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import host_options, json_option, manifest_options, plan_run_options, target_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.plan import Purpose


@rarms_command("destroy")
@manifest_options
@host_options
@target_option
@click.option(
    "--remove-disks", is_flag=True, help="Also delete the virtual disks that rarms made; their content is lost."
)
@plan_run_options
@json_option
def command(
    session: Session,
    *,
    source: ManifestSource,
    host_selection: HostSelection,
    target: tuple[str, ...],
    remove_disks: bool,
    how: RunOptions,
    as_json: bool,
) -> ExitCode:
    """Remove everything that carries this application's mark: plan, show, ask, and do it.

    Task classes go back to what was there before, and nothing else is touched. A partition that says `protect: true`
    makes this an error. --target removes one thing, also an unused partition.

    Disks are kept. With --remove-disks those go that rarms made: they grow out of an image, lie where rarms puts
    them, and no other machine, disk or checkpoint needs them. What was on them is lost.
    """
    manifest = load_manifest(source)
    hosts = select_hosts(manifest, host_selection)
    request = PlanRequest(purpose=Purpose.DESTROY, limits=PlanLimits(targets=target), remove_disks=remove_disks)
    return plan_ask_apply(session, hosts, request, how, as_json=as_json)
