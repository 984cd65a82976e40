"""`rarms start`: start partitions that were stopped."""

import click

from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.planning import PlanRequest, refuse_unknown_partitions
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.applying.stopping import StopScope
from rarms_iac.cli.applying import plan_ask_apply
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import RunOptions, host_options, json_option, manifest_options, plan_run_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.plan import Purpose


@rarms_command("start")
@click.argument("partitions", metavar="[PARTITION]...", nargs=-1)
@manifest_options
@host_options
@plan_run_options
@json_option
def command(
    session: Session,
    *,
    partitions: tuple[str, ...],
    source: ManifestSource,
    host_selection: HostSelection,
    how: RunOptions,
    as_json: bool,
) -> ExitCode:
    """Start PARTITIONs again that `rarms stop` stopped, or a measurement that was killed; without PARTITION: all.

    Plan, show, ask, and do it. A PARTITION that is named starts also where somebody else stopped it.
    """
    hosts = select_hosts(load_manifest(source), host_selection)
    refuse_unknown_partitions(hosts, partitions)
    request = PlanRequest(purpose=Purpose.START, stop_scope=StopScope(partitions=partitions))
    return plan_ask_apply(session, hosts, request, how, as_json=as_json)
