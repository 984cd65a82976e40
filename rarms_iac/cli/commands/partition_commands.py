"""Commands about partitions that exist: `rarms stop`, `start`, `destroy`, `import` and `release`."""

from dataclasses import dataclass, replace

from rarms_iac.app.hosts import Hosts, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.planning import hosts_with_machine, hosts_with_partition, plan_request, refuse_unknown_partitions
from rarms_iac.app.requests import (
    HostSelection,
    ManifestSource,
    PlanLimits,
    PlanRunOptions,
    PlanTargets,
    argument,
    flag,
    option,
    refuse_unknown,
)
from rarms_iac.app.this_machine import start_partitions_after_boot
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.applying.plan_request import PlanRequest
from rarms_iac.cli.applying import plan_ask_apply
from rarms_iac.cli.command import rarms_command
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.session import Session
from rarms_iac.model.plan import Purpose
from rarms_iac.planner.groups import groups_of
from rarms_iac.views.json_output import json_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Partitions:
    """The chosen partitions; none: all."""

    partitions: tuple[str, ...] = argument("[PARTITION]...", default=())


@rarms_command("stop")
def stop_command(
    session: Session, which: Partitions, source: ManifestSource, host_selection: HostSelection, how: PlanRunOptions
) -> ExitCode:
    """Stop PARTITIONs of this application until `rarms start`. Without PARTITION: all of them.

    rarms makes a plan, shows it, asks, and runs it. The mark of each partition records the stop.
    The stop is not drift, and no plan starts the partition. Settings and reservation stay.
    """
    hosts = select_hosts(load_manifest(source), host_selection)
    return plan_ask_apply(session, hosts, _request(hosts, Purpose.STOP, which), how)


@dataclass(frozen=True, slots=True, kw_only=True)
class StartOptions(Partitions):
    """Options of `rarms start` alone."""

    boot: bool = flag(
        "--boot", help="Start the partitions that ran on this Linux host before it restarted, without a manifest."
    )


@rarms_command("start")
def start_command(
    session: Session, which: StartOptions, source: ManifestSource, host_selection: HostSelection, how: PlanRunOptions
) -> ExitCode:
    """Start PARTITIONs that `rarms stop` or a killed measurement stopped. Without PARTITION: all of them.

    rarms makes a plan, shows it, asks, and runs it. A named PARTITION starts even if another tool stopped it.

    On Linux without systemd, run `rarms start --boot` at each boot, for example from /etc/rc.local.
    """
    if which.boot:
        return _start_after_boot(session, which, how)
    hosts = select_hosts(load_manifest(source), host_selection)
    return plan_ask_apply(session, hosts, _request(hosts, Purpose.START, which), how)


def _start_after_boot(session: Session, which: Partitions, how: PlanRunOptions) -> ExitCode:
    if which.partitions:
        raise RequestError("--boot cannot be combined with a PARTITION.")
    result = start_partitions_after_boot(how.lock_timeout_ms)
    if session.as_json:
        session.terminal.data(json_of(result))
    else:
        for name, partitions in result.started.items():
            session.terminal.tell(f"Started below {name}: {', '.join(partitions) or 'none, because none was off'}.")
    return ExitCode.DONE


def _request(hosts: Hosts, purpose: Purpose, which: Partitions) -> PlanRequest:
    refuse_unknown_partitions(hosts, which.partitions)
    return replace(plan_request(hosts), purpose=purpose, partitions=which.partitions)


@dataclass(frozen=True, slots=True, kw_only=True)
class DestroyOptions(PlanTargets):
    """Options of `rarms destroy` alone."""

    remove_disks: bool = flag(
        "--remove-disks", help="Also delete the virtual disks that rarms created; their content is lost."
    )


@rarms_command("destroy")
def destroy_command(
    session: Session,
    source: ManifestSource,
    host_selection: HostSelection,
    options: DestroyOptions,
    how: PlanRunOptions,
) -> ExitCode:
    """Remove all partitions and task classes that have the mark of this application.

    rarms shows the plan and asks first. Task classes get their earlier values back. Nothing else changes. rarms
    refuses to remove a partition with `protect: true`. --target removes one resource, also an unused partition.

    Disks are kept. --remove-disks deletes the disks that rarms made from an image, if they are in the folder of rarms
    and no other machine, disk or checkpoint needs them. Their content is lost.
    """
    hosts = select_hosts(load_manifest(source), host_selection)
    limits = PlanLimits(targets=options.targets)
    request = replace(plan_request(hosts, limits), purpose=Purpose.DESTROY, remove_disks=options.remove_disks)
    return plan_ask_apply(session, hosts, request, how)


@dataclass(frozen=True, slots=True, kw_only=True)
class PartitionName:
    """The chosen partition."""

    partition: str = argument()


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions(PartitionName):
    """Options of `rarms import` alone."""

    machine: str = option("--id", metavar="ID", help="The id of the machine; `rarms plan` shows it.", required=True)


@rarms_command("import")
def import_command(
    session: Session, options: ImportOptions, source: ManifestSource, host_selection: HostSelection, how: PlanRunOptions
) -> ExitCode:
    """Manage the machine with this id as PARTITION of the manifest: it gets a mark, and nothing else changes.

    The next plan shows how it differs from the manifest.
    """
    manifest = load_manifest(source)
    refuse_unknown((options.partition,), {group.name: group for group in groups_of(manifest.system)}, "partition")
    hosts = hosts_with_machine(select_hosts(manifest, host_selection), options.machine)
    request = replace(
        plan_request(hosts), purpose=Purpose.IMPORT, partitions=(options.partition,), machine=options.machine
    )
    return plan_ask_apply(session, hosts, request, how)


@rarms_command("release")
def release_command(
    session: Session, name: PartitionName, source: ManifestSource, host_selection: HostSelection, how: PlanRunOptions
) -> ExitCode:
    """Remove the mark of rarms from PARTITION: the machine does not change, and rarms no longer manages it."""
    hosts = hosts_with_partition(select_hosts(load_manifest(source), host_selection), name.partition)
    request = replace(plan_request(hosts), purpose=Purpose.RELEASE, partitions=(name.partition,))
    return plan_ask_apply(session, hosts, request, how)
