"""`rarms stop`: stop partitions until they are started again."""

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


@rarms_command("stop")
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
    """Stop PARTITIONs of this application until `rarms start`; without PARTITION: all of them.

    Plan, show, ask, and do it. Each one's mark says that it was stopped: it is no drift, and no plan starts it. What is
    set of it stays, and so does what the host promises it.
    """
    hosts = select_hosts(load_manifest(source), host_selection)
    refuse_unknown_partitions(hosts, partitions)
    request = PlanRequest(purpose=Purpose.STOP, stop_scope=StopScope(partitions=partitions))
    return plan_ask_apply(session, hosts, request, how, as_json=as_json)
