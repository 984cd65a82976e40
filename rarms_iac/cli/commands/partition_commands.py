"""Commands about partitions that exist: `rarms stop`, `start`, `destroy`, `import` and `release`."""

import click

from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.planning import PlanRequest, hosts_with_machine, hosts_with_partition
from rarms_iac.app.requests import HostSelection, ManifestSource, PlanLimits, RunOptions
from rarms_iac.cli.applying import plan_ask_apply, stop_or_start
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.options import host_options, json_option, manifest_options, plan_run_options, target_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.plan import Purpose


@rarms_command("stop")
@click.argument("partitions", metavar="[PARTITION]...", nargs=-1)
@manifest_options
@host_options
@plan_run_options
@json_option
def stop_command(
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
    return stop_or_start(session, source, host_selection, Purpose.STOP, partitions, how, as_json=as_json)


@rarms_command("start")
@click.argument("partitions", metavar="[PARTITION]...", nargs=-1)
@manifest_options
@host_options
@plan_run_options
@json_option
def start_command(
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
    return stop_or_start(session, source, host_selection, Purpose.START, partitions, how, as_json=as_json)


@rarms_command("destroy")
@manifest_options
@host_options
@target_option
@click.option(
    "--remove-disks", is_flag=True, help="Also delete the virtual disks that rarms made; their content is lost."
)
@plan_run_options
@json_option
def destroy_command(
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


@rarms_command("import")
@click.argument("partition")
@click.option("--id", "machine", metavar="ID", required=True, help="The id of the machine, as `rarms plan` names it.")
@manifest_options
@host_options
@plan_run_options
@json_option
def import_command(
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


@rarms_command("release")
@click.argument("partition")
@manifest_options
@host_options
@plan_run_options
@json_option
def release_command(
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
