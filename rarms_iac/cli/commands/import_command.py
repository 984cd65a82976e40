"""`rarms import`: take over a partition that rarms did not make."""

import click

from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.planning import PlanRequest, hosts_with_machine
from rarms_iac.app.requests import HostSelection, ManifestSource, RunOptions
from rarms_iac.cli.applying import plan_ask_apply
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import host_options, json_option, manifest_options, plan_run_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.plan import Purpose


@rarms_command("import")
@click.argument("partition")
@click.option("--id", "machine", metavar="ID", required=True, help="The id of the machine, as `rarms plan` names it.")
@manifest_options
@host_options
@plan_run_options
@json_option
def command(
    session: Session,
    *,
    partition: str,
    machine: str,
    source: ManifestSource,
    host_selection: HostSelection,
    how: RunOptions,
    as_json: bool,
) -> ExitCode:
    """Make the machine with this id the manifest's PARTITION: it gets a mark, and nothing else changes.

    The next plan then shows what the manifest wants to be different about it.
    """
    manifest = load_manifest(source)
    hosts = hosts_with_machine(select_hosts(manifest, host_selection), machine)
    request = PlanRequest(purpose=Purpose.IMPORT, partition=partition, machine=machine)
    return plan_ask_apply(session, hosts, request, how, as_json=as_json)
