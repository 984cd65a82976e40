"""Steps of one machine on its way from what it is to what it is to be: one call a setting."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import ceil

from rarms_iac.diff.readings import partition_readings
from rarms_iac.diff.step_context import claim_of
from rarms_iac.model.changes import Address, Reason
from rarms_iac.model.facets import FACETS, Facet, FacetRow, Readings, differing, setting_values, settings_of
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.operation_effects import applied, mark_operation, partition_after, reverse
from rarms_iac.model.operations import MachineOperation, RenamePartition, Set, StartPartition, StopPartition
from rarms_iac.model.plan import Step, Undo, UndoLevel
from rarms_iac.model.state import Mark, Partition, PartitionSettings, RunState, Starting, settings_at_start
from rarms_iac.model.system import GRACE, Disruption
from rarms_iac.texts.plans import change_text, change_title, describe_stop, operation_text
from rarms_iac.texts.quantities import show_duration

STARTS_AGAIN = "undo starts it again, without its data in memory"
_NOT_PAUSED_AGAIN = Undo(level=UndoLevel.NONE, operation=None, message="it was paused, and is not paused again")
_WITH_ITS_MACHINE = Undo(level=UndoLevel.FULL, operation=None, message="it is removed with the partition")
_EXISTS: Readings = {"exists": True}


@dataclass(slots=True)
class StepBuilder:
    """Makes the steps of one machine; its settings after a step are the `before` of the next."""

    address: Address
    now: Partition
    reason: Reason
    grace_ms: int = ceil(GRACE)  # for its guest to shut down
    provider: ProviderKind = ProviderKind.HYPERV  # of its host
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
            title=title or operation_text(operation),
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
        KeyError: no such reading.
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
        _why_here(row, old, new, is_new=builder.new),
        title=change_text(names, None if builder.new else old, new),
    )


def _why_here(row: FacetRow, old: PartitionSettings, to: PartitionSettings, *, is_new: bool) -> str:
    if row.while_off.issuperset(row.settings):
        return "only while it is off"
    if not row.capacity:
        return "its start and stop with the host"
    if is_new:
        return "it reserves nothing while it is off"
    before, after = getattr(old, row.capacity), getattr(to, row.capacity)
    if after < before:
        return "decreases come before increases"
    return "after the decreases of the others" if after > before else "the reservation does not change"


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
    return builder.step(operation, ("name",), "its settings do not change", title=title)


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
        title=f"stop it ({describe_stop(builder.grace_ms, builder.provider)})" if was_running else "turn it off",
    )
    undo = replace(stop.undo, level=UndoLevel.PARTIAL, message=STARTS_AGAIN) if was_running else _NOT_PAUSED_AGAIN
    return replace(stop, disruption=Disruption.PARTITION_STOP, undo=undo)


def start_step(builder: StepBuilder, why: str = "after all settings") -> Step:
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
    undo = replace(start.undo, level=UndoLevel.PARTIAL, message="it is turned off, not saved")
    return replace(start, before={"exists": True, "running": False}, undo=undo)


def steps_of_start(builder: StepBuilder, starting: Starting | None) -> Iterator[Step]:
    """Start the machine; where it reserves more for that time, give it that before, and its lasting values after it.

    The values that its mark stands for are the lasting ones. An undo of the first step gives them back, so that of the
    last one has nothing to do.

    Args:
        builder: of the machine as it is at this step; it goes on with a running one.
        starting: what it reserves while it starts; None: no more than later.

    Yields:
        The start, between two steps where it has more.
    """
    lasting = builder.now.settings
    larger = settings_at_start(lasting, starting)
    if larger is None or starting is None:
        yield start_step(builder)
        return
    more = facet_step(builder, Facet.CPU, lasting, larger)
    shown, names = show_duration(starting.time_ms), differing(Facet.CPU, lasting, larger)
    title = change_text(names, lasting, larger)
    yield replace(more, title=f"for its start: {title}", comment=f"for {shown} from its start on", wait_ms=0)
    yield start_step(builder)
    less = facet_step(builder, Facet.CPU, larger, lasting)
    yield replace(
        less,
        title=f"{shown} after its start: {change_text(names, larger, lasting)}",
        comment="the host gets back the reservation for the start",
        undo=Undo(level=UndoLevel.FULL, operation=None),
        wait_ms=starting.time_ms,
    )
