"""`rarms release`: let go of a partition."""

import click

from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.planning import PlanRequest, hosts_with_partition
from rarms_iac.app.requests import HostSelection, ManifestSource, RunOptions
from rarms_iac.cli.applying import plan_ask_apply
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import host_options, json_option, manifest_options, plan_run_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.plan import Purpose


@rarms_command("release")
@click.argument("partition")
@manifest_options
@host_options
@plan_run_options
@json_option
def command(
    session: Session,
    *,
    partition: str,
    source: ManifestSource,
    host_selection: HostSelection,
    how: RunOptions,
    as_json: bool,
) -> ExitCode:
    """Take rarms' mark off PARTITION: the machine stays as it is, and rarms no longer touches it."""
    manifest = load_manifest(source)
    hosts = hosts_with_partition(select_hosts(manifest, host_selection), partition)
    request = PlanRequest(purpose=Purpose.RELEASE, partition=partition)
    return plan_ask_apply(session, hosts, request, how, as_json=as_json)
