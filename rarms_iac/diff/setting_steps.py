"""Steps of one machine on its way from what it is to what it is to be: one call a setting."""

from dataclasses import dataclass, replace
from math import ceil

from rarms_iac.diff.readings import partition_readings
from rarms_iac.diff.step_context import claim_of
from rarms_iac.model.changes import Address, Reason
from rarms_iac.model.facets import FACETS, Facet, Readings, change_text, differing, setting_values, settings_of
from rarms_iac.model.operation_effects import (
    applied,
    change_title,
    describe_stop,
    mark_operation,
    partition_after,
    reverse,
)
from rarms_iac.model.operations import MachineOperation, RenamePartition, Set, StartPartition, StopPartition
from rarms_iac.model.plan import Step, Undo, UndoLevel
from rarms_iac.model.state import Mark, Partition, PartitionSettings, RunState
from rarms_iac.model.system import GRACE, Disruption

STARTS_AGAIN = "it starts again: what its programs had in memory is lost"
_NOT_PAUSED_AGAIN = Undo(level=UndoLevel.NONE, operation=None, message="it was paused: it is not so again")
_WITH_ITS_MACHINE = Undo(level=UndoLevel.FULL, operation=None, message="it goes with the machine, which is removed")
_EXISTS: Readings = {"exists": True}


@dataclass(slots=True)
class StepBuilder:
    """Makes the steps of one machine; its settings after a step are the `before` of the next."""

    address: Address
    now: Partition
    reason: Reason
    grace_ms: int = ceil(GRACE)  # for its guest to shut down
    forces: bool = True  # the host can force the guest to, before it turns the machine off
    new: bool = False  # made by this plan: its own undo removes it, and its first values are the host's affair

    def step(self, operation: MachineOperation, names: tuple[str, ...], why: str, *, title: str = "") -> Step:
        """Make the step of an operation on the machine as it is now.

        Args:
            operation: the call; on a new machine the removal of that machine undoes it.
            names: the readings that the step compares before and after.
            title: the call in a few words; empty: as the operation says it.

        Returns:
            The step, done live; from now on the builder's machine is as the operation leaves it.
        """
        before, self.now = self.now, partition_after(self.now, operation)
        undo = _WITH_ITS_MACHINE
        if not self.new:
            undo = Undo(level=UndoLevel.FULL, operation=reverse(operation, before, grace_ms=self.grace_ms))
        return Step(
            address=self.address,
            title=title or str(operation),
            operation=operation,
            before=_EXISTS if self.new else some_readings(before, names),
            after=some_readings(self.now, names),
            undo=undo,
            disruption=Disruption.LIVE,
            claim_before=claim_of(before),
            claim_after=claim_of(self.now),
            comment=why,
            place=self.reason.place,
        )


def some_readings(partition: Partition, names: tuple[str, ...]) -> Readings:
    """Return these readings of a partition, and that it exists.

    Args:
        names: of the readings, as `partition_readings` has them.

    Returns:
        The readings by name, `exists` first.

    Raises:
        KeyError: there is no such reading.
    """
    everything = partition_readings(partition)
    return {name: everything[name] for name in ("exists", *names)}


def mark_step(builder: StepBuilder, mark: Mark, why: str) -> Step:
    """Write the mark; the undo writes the one that is there now, or erases the new one where there is none.

    Args:
        builder: of the machine as it is at this step; it goes on with the new mark.
        mark: the mark to write; its machine's id is set here.

    Returns:
        The step, titled with the mark and its digest of the settings.
    """
    address = builder.address
    operation = mark_operation(mark, address.partition, address.machine)
    settings = builder.now.settings
    return builder.step(operation, ("mark", "set"), why, title=change_title(operation, settings, settings))


def facet_step(builder: StepBuilder, facet: Facet, old: PartitionSettings, new: PartitionSettings) -> Step:
    """Give the machine all that `new` has of this facet, in one call; its undo gives it the values that it has now.

    Args:
        old: the settings before the change.
        new: the settings after it.
    """
    row = FACETS[facet]
    names = differing(facet, old, new) if row.only_changed and not builder.new else row.settings
    names = tuple(name for name in names if name in settings_of(new.generation))
    operation = Set(
        partition=builder.address.partition,
        facet=facet,
        before={} if builder.new else setting_values(builder.now.settings, names),
        after=setting_values(new, names),
        machine=builder.address.machine,
    )
    is_off = builder.now.state is RunState.OFF
    reads_state = row.while_off.intersection(names) or (is_off and row.maybe_off.intersection(names))
    return builder.step(
        operation,
        (*names, "state") if reads_state else names,
        row.comment or _why_here(row.capacity, old, new, is_new=builder.new),
        title=change_text(names, None if builder.new else old, new),
    )


def _why_here(setting: str, old: PartitionSettings, to: PartitionSettings, *, is_new: bool) -> str:
    if is_new:
        return "while it is off nothing is promised yet"
    before, after = getattr(old, setting), getattr(to, setting)
    if after < before:
        return "what is given back comes before what is taken"
    return "after the others gave back" if after > before else "nothing is taken or given back"


def rename_step(builder: StepBuilder, name: str) -> Step:
    """Give the machine another name, the one that people see.

    Args:
        builder: of the machine as it is at this step; it goes on with the new name.
        name: its name after this step.

    Returns:
        The step, whose undo gives the old name back.
    """
    address, settings = builder.address, builder.now.settings
    operation = RenamePartition(partition=address.partition, name=name, machine=address.machine)
    title = change_title(operation, settings, applied(settings, operation))
    return builder.step(operation, ("name",), "its settings stay", title=title)


def stop_step(builder: StepBuilder, why: str) -> Step:
    """Stop the machine.

    What is read before must still be what the plan saw: a machine that ran then must run, since a machine that was
    saved or paused with another tool was not stopped by this plan.

    Args:
        builder: of the machine as it is at this step; it goes on with a stopped one.

    Returns:
        A step that stops the partition; its undo starts it again, where it ran.
    """
    address, was_running = builder.address, builder.now.settings.running
    stop = builder.step(
        StopPartition(partition=address.partition, grace_ms=builder.grace_ms, machine=address.machine),
        ("running", "state"),
        why,
        title=f"stop it ({describe_stop(builder.grace_ms, forces=builder.forces)})" if was_running else "turn it off",
    )
    undo = replace(stop.undo, level=UndoLevel.PARTIAL, message=STARTS_AGAIN) if was_running else _NOT_PAUSED_AGAIN
    return replace(stop, disruption=Disruption.PARTITION_STOP, undo=undo)


def start_step(builder: StepBuilder, why: str = "after all that it is to have is set") -> Step:
    """Start the machine, the last of its steps where it is not saved.

    Args:
        builder: of the machine as it is at this step; it goes on with a running one.

    Returns:
        The step; its undo stops the machine. A machine that was saved is left off by the undo, not saved again.
    """
    address, was_off = builder.address, builder.now.state is RunState.OFF
    start = builder.step(
        StartPartition(partition=address.partition, machine=address.machine),
        ("running", "state"),
        why,
    )
    if was_off:
        return start
    # What was saved cannot be so again: its undo leaves it off, and asks no more than that.
    undo = replace(start.undo, level=UndoLevel.PARTIAL, message="it is turned off, not saved again")
    return replace(start, before={"exists": True, "running": False}, undo=undo)
