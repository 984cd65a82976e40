"""The steps of a partition's change.

Order of an update: mark's name, stop, what gives back, what takes more, start/stop actions, name, mark, start. Only a
saved machine is started before it gets anything, because Hyper-V changes none of these settings while it is saved. A
creation marks right after it makes the machine; see `create_partition`. The mark comes after the values, because a host
that was left half-way must not look as if it had everything that was written.

Of the disks of a machine that is removed, rarms deletes those that it made, where that is asked for: everything else
stays. A disk counts as rarms' own where it lies at the path that making the partition chooses
(`model.operations.disk_path`; early versions had it one folder above), grows out of another one, is attached to the
machine with our mark and to no other, and no checkpoint needs it.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from re import escape, fullmatch

from rarms_iac.diff.disruption import changed_facets, grace_ms, needs_off
from rarms_iac.diff.readings import NOTHING, same_path
from rarms_iac.diff.setting_steps import (
    StepBuilder,
    facet_step,
    mark_step,
    rename_step,
    some_readings,
    start_step,
    steps_of_start,
    stop_step,
)
from rarms_iac.diff.step_context import NO_CLAIM, StepContext, claim_of
from rarms_iac.model.changes import Address, Reason
from rarms_iac.model.facets import FACETS, Facet, Readings
from rarms_iac.model.layout import Making
from rarms_iac.model.operation_effects import mark_operation
from rarms_iac.model.operations import (
    CreatePartition,
    RemoveDisk,
    RemovePartition,
    RenamePartition,
    RestorePartition,
    StartPartition,
    StopPartition,
)
from rarms_iac.model.plan import Step, Undo, UndoLevel
from rarms_iac.model.state import Disk, DiskKind, Partition, RunState, State
from rarms_iac.model.system import Disruption
from rarms_iac.texts.plans import operation_text


def create_partition(address: Address, after: Partition, reason: Reason, context: StepContext) -> Iterator[Step]:
    """Make a partition under its pending name, mark it, set everything, rename it last, and start it.

    Args:
        address: the partition; its machine's id is not known yet.
        after: the partition as it is to be, with its mark.
        reason: shown to the reviewer of every step.
        context: what making needs (image, switch, folder), and how long its guest may take to shut down.

    Yields:
        The steps in their order; each is undone by removing the machine.
    """
    wanted = after.settings
    making = context.making.get(address.partition, Making())
    yield _creation_step(address, after, making, reason)
    pending = replace(after, settings=replace(wanted, running=False), state=RunState.OFF)
    grace = grace_ms(context.graces, address.partition)
    builder = StepBuilder(
        address=replace(address, machine=""),
        now=pending,
        reason=reason,
        grace_ms=grace,
        provider=context.seen.facts.provider,
        new=True,
    )
    name = address.partition
    assert after.mark is not None, "every created machine has a mark"
    yield mark_step(builder, after.mark, "rarms recognises the partition by this mark, also after a crash")
    for facet, row in FACETS.items():
        if not row.in_creation:
            yield facet_step(builder, facet, wanted, wanted)
    yield builder.step(
        RenamePartition(partition=name, name=wanted.name),
        ("name",),
        "last, so that a partition with this name is always complete",
    )
    if wanted.running:
        back = Undo(level=UndoLevel.FULL, operation=StopPartition(partition=name, grace_ms=grace))
        # A new machine starts from settings that were not read, so `start_step` has no full `before`; but it is known
        # to be off, and the undo switches it off.
        off: Readings = {"running": False, "state": RunState.OFF.value}
        for step in steps_of_start(builder, context.starting.get(name)):
            is_start = isinstance(step.operation, StartPartition)
            yield replace(step, before={**step.before, **off}, undo=back) if is_start else step


def _creation_step(address: Address, after: Partition, making: Making, reason: Reason) -> Step:
    wanted = after.settings
    lost = f"all data on the disk created from {making.image} is lost" if making.image else ""
    if lost and after.mark is not None and after.mark.protected:
        lost += "; `protect: true` does not prevent this undo"
    creation = CreatePartition(
        partition=address.partition,
        generation=wanted.generation,
        memory=wanted.memory,
        image=making.image,
        switch=making.switch,
        vm_path=making.vm_path,
        secure_boot=wanted.secure_boot,
    )
    return Step(
        address=replace(address, machine=""),
        title=operation_text(creation),
        operation=creation,
        before=NOTHING,
        after={"exists": True, "generation": wanted.generation, "memory": wanted.memory},
        undo=Undo(
            level=UndoLevel.PARTIAL if lost else UndoLevel.FULL,
            operation=RemovePartition(partition=address.partition),
            message=lost,
        ),
        disruption=Disruption.LIVE,
        claim_before=claim_of(None),
        claim_after=claim_of(None),
        comment="it stays off, with a temporary name, until all settings are made",
        place=reason.place,
    )


def update_partition(
    address: Address, before: Partition, after: Partition, reason: Reason, context: StepContext
) -> Iterator[Step]:
    """Bring a partition to its wanted settings, stopping it only where something cannot change live and it runs.

    Another generation means that the machine is removed and made again.

    Args:
        address: the partition with its machine's id.
        reason: shown to the reviewer of every step.
        context: which settings of this host change live.

    Yields:
        The steps in their order; none where nothing differs.
    """
    if before.settings.generation != after.settings.generation:
        yield from remove_partition(address, before, reason, replace(context, disks={}))
        yield from create_partition(replace(address, machine=""), after, reason, context)
        return
    grace = grace_ms(context.graces, address.partition)
    builder = StepBuilder(
        address=address, now=before, reason=reason, grace_ms=grace, provider=context.seen.facts.provider
    )
    off = needs_off(before, after.settings, context)
    # First, and alone: order.py takes this step out and does all renames of marks before anything else.
    yield from rename_mark(builder.address, before, reason)
    builder.now = replace(before, mark=replace(before.mark, name=address.partition)) if before.mark else before
    if before.settings.running and (off or not after.settings.running):
        yield stop_step(builder, "it must be off for the next steps" if after.settings.running else "it must not run")
    if before.state is RunState.SAVED and after.settings.running:
        yield start_step(builder, "a saved partition can be changed only after a start")
    changed = changed_facets(before.settings, after.settings)
    for facet in sorted(changed, key=lambda facet: _takes_more(facet, before, after)):
        yield facet_step(builder, facet, before.settings, after.settings)
    if before.settings.name != after.settings.name:
        yield rename_step(builder, after.settings.name)
    old = builder.now.mark
    if after.mark is not None and (old is None or old.written != after.mark.written):
        yield mark_step(builder, after.mark, "the mark records the settings that were last written")
    if after.settings.running and not builder.now.settings.running:
        yield from steps_of_start(builder, context.starting.get(address.partition))


def _takes_more(facet: Facet, before: Partition, after: Partition) -> bool:
    """Return whether it takes capacity; what takes none comes after the values that do."""
    setting = FACETS[facet].capacity
    return not setting or getattr(after.settings, setting) > getattr(before.settings, setting)


def rename_mark(address: Address, before: Partition, reason: Reason, between: str = "") -> Iterator[Step]:
    """Give the mark its new name, where the manifest moved the partition; no step where it has that name already.

    Args:
        address: the partition under its new name.
        before: the partition with the mark that it has now.
        between: the name to write instead, which breaks an exchange of two names.

    Yields:
        At most one step.
    """
    name = between or address.partition
    mark = before.mark
    if mark is None or mark.name == name:
        return
    builder = StepBuilder(address=address, now=before, reason=reason)
    why = "two partitions swap names: one gets a temporary name" if between else "its new name in the manifest"
    yield mark_step(builder, replace(mark, name=name), why)


def remove_partition(address: Address, before: Partition, reason: Reason, context: StepContext) -> Iterator[Step]:
    """Stop a machine where it runs or is paused, and remove it. Its disks stay, unless their removal was asked for.

    Args:
        address: the partition with its machine's id.
        reason: shown to the reviewer of every step.
        context: the disks that go with the machine.

    Yields:
        The stop where it is needed, the removal, and a step for each disk that goes too.
    """
    grace = grace_ms(context.graces, address.partition)
    builder = StepBuilder(
        address=address, now=before, reason=reason, grace_ms=grace, provider=context.seen.facts.provider
    )
    if before.state in {RunState.RUNNING, RunState.PAUSED}:
        yield stop_step(builder, f"a {before.state.value} partition cannot be removed")
    going = context.disks.get(before.id, ())
    attached = context.attached.get(before.id, 0)
    others = ", keep its other disks" if going else ", keep its disks" if attached else ""
    operation = RemovePartition(partition=address.partition, machine=address.machine)
    is_lost = before.id not in context.restorable
    lost = "the partition cannot be created again" + ("; its disks are still there" if attached and not going else "")
    again = RestorePartition(
        partition=address.partition,
        machine=before.id,
        settings=builder.now.settings,
        mark=builder.now.mark,
        other_notes=before.other_notes,
        tasks=context.restorable.get(before.id, ()),
    )
    removal = Step(
        address=address,
        title=f"{operation_text(operation)}{others}",
        operation=operation,
        # What it got since the plan was never seen: a checkpoint is merged, a disk would be left behind.
        before={
            **some_readings(builder.now, ("machine", "name", "state", "snapshots")),
            "disks": attached,
        },
        after=NOTHING,
        undo=Undo(level=UndoLevel.NONE, operation=None, message=lost)
        if is_lost
        else Undo(level=UndoLevel.FULL, operation=again),
        disruption=Disruption.REMOVAL if is_lost else Disruption.PARTITION_STOP,
        claim_before=claim_of(builder.now),
        claim_after=claim_of(None),
        comment="removed first, to make room",
        place=reason.place,
    )
    yield removal
    yield from (_disk_step(removal, disk) for disk in going)


def _disk_step(removal: Step, disk: Disk) -> Step:
    """Remove the disk after its machine, so that none uses it; a run killed between the two continues here."""
    operation = RemoveDisk(partition=removal.address.partition, path=disk.path, parent=disk.parent)
    return replace(
        removal,
        address=replace(removal.address, disk=disk.path),
        title=operation_text(operation),
        operation=operation,
        before={"exists": True, "parent": disk.parent, "used": False},
        undo=Undo(level=UndoLevel.NONE, operation=None, message="the data on the disk is lost"),
        claim_before=NO_CLAIM,
        claim_after=NO_CLAIM,
        comment="its removal was requested; rarms created it as a child of " + disk.parent,
    )


def adopt_partition(address: Address, before: Partition, after: Partition, reason: Reason) -> Iterator[Step]:
    """Write the mark on a machine that is taken over, and nothing else.

    Args:
        address: the partition with its machine's id.
        after: the same with its mark; it must have one.
        reason: shown to the reviewer of the step.

    Yields:
        One step.
    """
    assert after.mark is not None, "every imported machine gets a mark"
    builder = StepBuilder(address=address, now=before, reason=reason)
    yield mark_step(builder, after.mark, "only the mark is written")


def release_partition(address: Address, before: Partition, reason: Reason) -> Iterator[Step]:
    """Erase the mark of a machine that is released; the machine stays as it is.

    Args:
        address: the partition with its machine's id.
        before: the machine as observed, with its mark.
        reason: shown to the reviewer of the step.

    Yields:
        One step; its undo writes the mark again.
    """
    assert before.mark is not None, "only managed machines are released"
    builder = StepBuilder(address=address, now=before, reason=reason)
    operation = mark_operation(None, address.partition, address.machine)
    yield builder.step(operation, ("mark", "set"), "the machine is not changed")


def judge_disks(machine: Partition, state: State, folders: Iterable[str]) -> Iterator[tuple[Disk, str]]:
    """Judge each disk of a machine.

    Args:
        state: the host, with all disks of all machines.
        folders: where rarms makes disks for this partition.

    Yields:
        Each disk that is attached to the machine, in the order of the state, with the reason to keep it; empty: it may
            be deleted.
    """
    known = tuple(folders)
    for disk in state.disks:
        if disk.machine == machine.id:
            yield disk, _reason_to_keep(disk, machine, state, known)


def _reason_to_keep(disk: Disk, machine: Partition, state: State, folders: tuple[str, ...]) -> str:
    if machine.mark is None:
        return "its machine does not have a mark of rarms"
    if machine.checkpoints:
        return "checkpoints of its machine need it"
    if disk.kind is DiskKind.UNKNOWN:
        return "its kind could not be read"
    if disk.kind is not DiskKind.DIFFERENCING or not disk.parent:
        return "it is not the child of an image, so rarms did not create it"
    if not _is_made_by_rarms(disk.path, machine.mark.name, folders):
        return f"it is not at the path where rarms creates the disk of {machine.mark.name}"
    if any(same_path(other.parent, disk.path) for other in state.disks):
        return "another disk is its child"
    if any(other.machine != disk.machine for other in state.disks if same_path(other.path, disk.path)):
        return "another machine also uses it"
    return ""


def _is_made_by_rarms(path: str, partition: str, folders: tuple[str, ...]) -> bool:
    folder, _, file = path.replace("/", "\\").rpartition("\\")
    if not fullmatch(rf"{escape(partition)}-[0-9a-f]{{12}}\.vhdx?", file.lower()):
        return False
    at = [known.rstrip("\\/") for known in folders if known]
    return any(same_path(folder, known) for known in (*at, *(f"{known}\\{partition}" for known in at)))
