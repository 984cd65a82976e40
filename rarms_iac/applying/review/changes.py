"""Reviews of single changes and steps: what is refused, stopped, shrunk or lost."""

from collections.abc import Iterable, Iterator

from rarms_iac.applying.desired_hosts import disk_verdicts, partition_after_change
from rarms_iac.applying.doctor.machines import UNFIT_MACHINE
from rarms_iac.applying.plan_request import PlanRequest
from rarms_iac.diff.drift import drift_of_marks
from rarms_iac.model.changes import Change, Delete, Update
from rarms_iac.model.commands import DRIFT, HISTORY, command, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.operations import CreatePartition, RemoveDisk, RemovePartition, StopPartition
from rarms_iac.model.plan import HostPlan, Purpose, Step, UndoLevel
from rarms_iac.model.state import Partition, StartAction, Tie
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner.desired import Desired
from rarms_iac.planner.groups import groups_of
from rarms_iac.planner.mechanism import has_switch, takes_image
from rarms_iac.planner.sizes import limit_in_manifest
from rarms_iac.texts.findings import GENERATION, MAY_NOT_CHANGE, UNKNOWN_NAME, Finding
from rarms_iac.texts.messages import suggestion

RESTART = Finding.warning("RARMS041", "A change restarts or stops a partition")
MEMORY_SHRINKS = Finding.warning("RARMS220", "A change takes memory from a partition")
LIMIT_RAISED = Finding.warning("RARMS221", "A limit is below the reserve")
DISKS_STAY = Finding.note("RARMS224", "The disks of a removed machine are kept")
NOT_UNDONE = Finding.warning("RARMS225", "A step cannot be undone")
NOT_ASKED = Finding.warning("RARMS255", "A machine is turned off without a guest shutdown")
DISK_REMOVED = Finding.warning("RARMS253", "A virtual disk is deleted")
DISK_STAYS = Finding.warning("RARMS254", "A virtual disk is kept although its removal was requested")
STARTS_WITH_HOST = Finding.note("RARMS407", "A partition that starts with its host gets no starting reservation")
CHANGED_OUTSIDE = Finding.note("RARMS311", "The host was changed since rarms wrote it")


def review_changes_from_outside(request: PlanRequest, desired: Desired, plan: HostPlan) -> Iterator[Diagnostic]:
    """Tell which differences the plan takes away that did not come from the manifest."""
    if request.purpose is not Purpose.APPLY or not plan.changes:
        return
    addresses = plan.changes_by_address
    by_name = {str(address): address for address in addresses}
    for drift in drift_of_marks(desired.seen.state, request.application, request.after_last_run(desired.host)):
        address = by_name.get(str(drift.address))
        if address is not None:
            yield CHANGED_OUTSIDE.at(
                addresses[address].reason.place,
                "{resource} on {host}: {difference}. This plan restores the value of the manifest.",
                prose("Find the cause: ", DRIFT, " shows the differences. ", HISTORY, " shows the changes of rarms."),
                address=str(drift.address),
                host=desired.host,
                resource=str(drift.address),
                difference=drift.message,
            )


def review_starts(plan: HostPlan) -> Iterator[Diagnostic]:
    """Tell which partitions have more for a start by rarms and no more when they start with their host."""
    names = {step.address.partition: step.place for step in plan.steps if step.wait_ms}
    for change in plan.changes:
        after, name = partition_after_change(change), change.address.partition
        if after is None or name not in names or after.settings.start_action is not StartAction.START:
            continue
        yield STARTS_WITH_HOST.at(
            names[name],
            (
                "{partition} gets `starting.reserve` only if rarms starts the partition. If the partition starts "
                "with {host}, it has its normal reservation."
            ),
            "Restart the host, and test whether the components meet their thresholds.",
            address=f"partition/{name}",
            partition=name,
            host=plan.name,
        )


def review_images_and_switches(desired: Desired, plan: HostPlan) -> Iterator[Diagnostic]:
    """Refuse beforehand what Hyper-V would refuse in the middle of making a machine."""
    for step in plan.steps:
        if isinstance(step.operation, CreatePartition):
            yield from _review_image(step, step.operation)
            yield from _review_switch(desired, step, step.operation)


def _review_image(step: Step, creation: CreatePartition) -> Iterator[Diagnostic]:
    if not takes_image(creation.generation, creation.image):
        yield GENERATION.at(
            step.place,
            (
                '"{partition}" has generation 2 and needs a .vhdx disk. A child disk of {image} has the format '
                "of this image."
            ),
            "Convert the image to .vhdx (`Convert-VHD`), or write `generation: 1` for this partition.",
            address=str(step.address),
            partition=creation.partition,
            generation=creation.generation,
            image=creation.image,
        )


def _review_switch(desired: Desired, step: Step, creation: CreatePartition) -> Iterator[Diagnostic]:
    switches = desired.seen.state.switches
    if has_switch(switches, creation.switch) or switches is None:
        return
    known = f"Existing switches: {', '.join(sorted(switches))}." if switches else "The host has no virtual switch."
    yield UNKNOWN_NAME.at(
        step.place,
        '{host} does not have the virtual switch {switch:quoted} of "{partition}".{_suggestion} {_known}',
        "Write an existing switch in `hyperv.switch`, or first create the switch on the host with `New-VMSwitch`.",
        address=str(step.address),
        partition=creation.partition,
        switch=creation.switch,
        host=desired.host,
        switches=tuple(sorted(switches)),
        _suggestion=suggestion(creation.switch, switches),
        _known=known,
    )


def review_tied_machines(system: System, changes: Iterable[Change]) -> Iterator[Diagnostic]:
    """Refuse to change a replica, and a machine of a CPU group or cluster where its partition does not say so."""
    for change in changes:
        before = change.before
        if not isinstance(before, Partition):
            continue
        partition = system.partitions.get(change.address.partition)
        is_clustered = partition is not None and bool(partition.hyperv.clustered) and not isinstance(change, Delete)
        for tie in before.ties:
            if tie is Tie.CLUSTER and is_clustered:
                continue
            message, advice = _TIES[tie]
            yield MAY_NOT_CHANGE.at(
                change.reason.place,
                "Machine {name:quoted} ({machine}) {message}, so this plan cannot change it.",
                advice,
                address=str(change.address),
                machine=before.id,
                name=before.settings.name,
                tie=tie.value,
                message=message,
            )


_TIES = {
    Tie.REPLICA: ("is a replica of a machine on another host", "Plan for the host of the primary machine."),
    Tie.CLUSTER: (
        "belongs to a failover cluster, which keeps a copy of its settings and may move it",
        (
            "Remove the machine from the cluster. To change it anyway, write `hyperv: {clustered: true}` for its "
            "partition."
        ),
    ),
    Tie.CPU_GROUP: (
        "is in a CPU group: its reserve is a share of the group, not of the host",
        "Remove the machine from the group with `CpuGroups.exe SetVmGroup`, and plan again.",
    ),
}


def review_restarts(request: PlanRequest, plan: HostPlan) -> Iterator[Diagnostic]:
    """Report each running partition that is stopped, for its own change or to make room for others.

    Who destroys, imports or releases has asked for what happens.
    """
    if request.purpose is not Purpose.APPLY:
        return
    live = set()
    for change in plan.changes:
        match change:
            case Update(disruption=Disruption.LIVE):
                live.add(change.address)
            case Update(before=Partition() as before, after=Partition()):
                yield RESTART.at(
                    change.reason.place,
                    '"{partition}" is running and has to stop: {reason}.',
                    "Apply the plan in a maintenance window, or hold the change back with `--max-disruption live`.",
                    address=str(change.address),
                    partition=before.settings.name,
                    reason=change.reason.message,
                )
            case _:
                pass
    for step in plan.steps:
        if isinstance(step.operation, StopPartition) and step.address in live:
            yield RESTART.at(
                step.place,
                '"{partition}" is running and has to stop for a while: {reason}.',
                (
                    "Apply the plan in a maintenance window. Or lower a reserve, or make fewer changes at once "
                    "with `--target`."
                ),
                address=str(step.address),
                partition=step.address.partition,
                reason=step.comment,
            )


def review_guests_that_are_not_asked(desired: Desired, plan: HostPlan) -> Iterator[Diagnostic]:
    """Yield a guest without the service through which it is asked to shut down is turned off, like a pulled plug."""
    mute = {
        machine.id for machine in desired.seen.state.partitions if machine.settings.running and not machine.can_be_asked
    }
    for step in plan.steps:
        if isinstance(step.operation, StopPartition) and step.address.machine in mute:
            yield NOT_ASKED.at(
                step.place,
                (
                    'The shutdown service of the guest of "{partition}" does not respond, so Hyper-V turns its '
                    "machine off without a shutdown."
                ),
                (
                    "Install or start the integration service for shutdown in the guest. Enable it for the "
                    "machine with `Enable-VMIntegrationService`, and plan again. Or shut the guest down yourself."
                ),
                address=str(step.address),
                partition=step.address.partition,
            )


def review_memory(plan: HostPlan) -> Iterator[Diagnostic]:
    """Report memory that is taken from a partition: it may be in use there."""
    for change in plan.changes:
        match change:
            case Update(before=Partition(settings=old), after=Partition(settings=new)) if new.memory < old.memory:
                yield MEMORY_SHRINKS.at(
                    change.reason.place,
                    (
                        '"{partition}" has {has_memory:bytes} and gets {gets_memory:bytes}. If the guest needs more, '
                        "it swaps, or its components fail to start."
                    ),
                    "Check the highest memory use of its guest, and measure its components again with the new size.",
                    address=str(change.address),
                    partition=old.name,
                    has_memory=old.memory,
                    gets_memory=new.memory,
                )


def review_raised_limits(request: PlanRequest, desired: Desired) -> Iterator[Diagnostic]:
    """Yield a limit below what its reserve needs, rounded up, is raised, with a note to the reader."""
    # A limit that was raised equals the reserve; only then the whole system is worth grouping again.
    raised = [partition for partition in desired.partitions if partition.settings.limit == partition.settings.reserve]
    groups = {group.name: group for group in groups_of(request.system)} if raised else {}
    for partition in raised:
        reserve, processors = partition.settings.reserve, partition.settings.processors
        limit = limit_in_manifest(groups[partition.name], request.system.hosts[desired.host], processors)
        if limit is not None and limit < reserve:
            yield LIMIT_RAISED.at(
                request.places.key(request.system.section_of(partition.name), partition.name),
                '"{partition}" has a limit of {limit_percent} % of each of its VPs, but its reserve is '
                "{reserve_percent} %. The plan raises the limit to the reserve. The partition never gets more than its "
                "reserve.",
                "Raise or remove the limit. Measurements without a limit are not valid with a limit.",
                address=f"partition/{partition.name}",
                partition=partition.name,
                limit_percent=limit,
                reserve_percent=reserve,
            )


def review_removed_disks(request: PlanRequest, desired: Desired, plan: HostPlan) -> Iterator[Diagnostic]:
    """Report the disks whose removal was asked for: deleted ones, and those that stay all the same."""
    for step in plan.steps:
        if isinstance(step.operation, RemoveDisk):
            yield DISK_REMOVED.at(
                step.place,
                (
                    "{disk} of {partition} on {host} is deleted with its machine. All data written since its "
                    "creation from {parent} is lost."
                ),
                (
                    "First copy the data that you need. `rarms undo` cannot restore the disk. To keep the disk, "
                    "omit --remove-disks."
                ),
                address=f"partition/{step.address.partition}",
                disk=step.operation.path,
                parent=step.operation.parent,
                partition=step.address.partition,
                host=desired.host,
            )
    for change in plan.changes if request.remove_disks else ():
        if not isinstance(change, Delete) or not isinstance(change.before, Partition):
            continue
        for disk, reason in disk_verdicts(request.system, desired.seen.state, change.before):
            if reason:
                yield DISK_STAYS.at(
                    change.reason.place,
                    "{disk} of {partition} on {host} is kept: {reason}.",
                    "Check the content of the disk. Delete the disk by hand if you do not need it.",
                    address=str(change.address),
                    disk=disk.path,
                    partition=change.address.partition,
                    host=desired.host,
                    reason=reason,
                )


def review_remaining_disks(request: PlanRequest, desired: Desired, plan: HostPlan) -> Iterator[Diagnostic]:
    """Yield removing a machine keeps its disks where their removal was not asked for, and the space stays taken."""
    if request.remove_disks:
        return
    for step in plan.steps:
        disks = [
            disk.path for disk in desired.seen.state.disks if disk.machine and disk.machine == step.address.machine
        ]
        if isinstance(step.operation, RemovePartition) and disks:
            yield DISKS_STAY.at(
                step.place,
                '"{partition}" is removed from {host}. Its virtual disks are kept: {_join}.',
                prose(
                    "Delete unneeded disks by hand, or run ",
                    command("destroy", remove_disks=True),
                    " to delete the disks that rarms created.",
                ),
                address=str(step.address),
                partition=step.address.partition,
                host=desired.host,
                disks=tuple(disks),
                _join=", ".join(disks),
            )


def review_undo(request: PlanRequest, plan: HostPlan) -> Iterator[Diagnostic]:
    """Yield steps without an undo; who destroys asked for it. What comes back in part is listed with the plan."""
    if request.purpose is Purpose.DESTROY:
        return
    for step in plan.steps:
        if step.undo.level is UndoLevel.NONE:
            yield NOT_UNDONE.at(
                step.place,
                "{resource}, {step}: {reason}.",
                (
                    "Before the apply, save the data and settings that you need. `rarms undo` and the undo script "
                    "cannot restore them."
                ),
                address=str(step.address),
                resource=str(step.address),
                step=step.title,
                reason=step.undo.message,
            )


def review_width(desired: Desired, plan: HostPlan) -> Iterator[Diagnostic]:
    """Yield a partition wider than its host waits for itself, and no reserve is guaranteed to it (windows.md 1.2)."""
    available = desired.seen.state.facts.logical_processors
    for change in plan.changes:
        partition = partition_after_change(change)
        if partition is not None and (after := partition.settings).processors > available:
            yield UNFIT_MACHINE.at(
                change.reason.place,
                (
                    '"{partition}" has {processors} virtual processors, but {host} has only {has_lp} logical '
                    "processors. The virtual processors cannot all run at once."
                ),
                f"Write `processors: {available}` or less.",
                address=str(change.address),
                partition=after.name,
                processors=after.processors,
                host=desired.host,
                has_lp=available,
            )
