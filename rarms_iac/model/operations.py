"""The operations of steps: each is one call to a host, with all it needs.

Each operation is one indivisible call on every provider, so that a kill leaves it either undone or done. Partitions
are named as the manifest names them; the provider resolves the name as `diff.readings.resolve` says: `machine`, the id,
where the plan knew it (always for one that existed), otherwise our mark or the plan's pending name. As text an
operation says what it does, for a person, without the address that stands before it.

SystemResponsiveness of the host itself is written, removed and recorded by the operations of task classes: its value
has the name of the class, and no task class of the manifest may have that name (RARMS229).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil
from typing import Literal, assert_never

from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.quantities import show_bytes, show_period
from rarms_iac.model.state import (
    ID_DIGITS,
    NO_GENERATION,
    SECURE_BOOT_OFF,
    Checkpoints,
    Mark,
    Partition,
    PartitionSettings,
    RegistryValue,
    Responsiveness,
    RunState,
    StartAction,
    StopAction,
    StoppedBy,
    TaskClass,
    TaskRecord,
)
from rarms_iac.model.system import GRACE


@dataclass(frozen=True, slots=True, kw_only=True)
class CreatePartition:
    """Make the machine, off, under its pending name `<name>.rarms-<plan id>` and without reserve."""

    partition: str
    generation: int
    memory: int  # bytes
    image: str = ""  # parent disk of a differencing child; empty: no disk
    switch: str = ""  # empty: not connected
    vm_path: str = ""  # empty: the host's default
    secure_boot: str | None = None  # a template, or `SECURE_BOOT_OFF`; None: as the host makes it
    kind: Literal["create_partition"] = "create_partition"

    def __str__(self) -> str:
        if self.generation == NO_GENERATION:
            return f"make a control group with {show_bytes(self.memory)}"
        return f"make a machine of generation {self.generation} with {show_bytes(self.memory)}"


def disk_file(making: CreatePartition, plan: str) -> str:
    """The name of the disk that the plan of this id makes for a partition: its parent's format, and the plan's id."""
    return f"{making.partition}-{plan}{'.vhd' if making.image.lower().endswith('.vhd') else '.vhdx'}"


@dataclass(frozen=True, slots=True, kw_only=True)
class RemovePartition:
    """Remove the machine; its disks are kept."""

    partition: str
    machine: str = ""
    kind: Literal["remove_partition"] = "remove_partition"

    def __str__(self) -> str:
        return "remove the machine"


@dataclass(frozen=True, slots=True, kw_only=True)
class RestorePartition:
    """Make a machine again that was removed and had no disk: off, under its id, as it was."""

    partition: str
    machine: str  # its id
    settings: PartitionSettings  # `running` is false
    mark: Mark | None
    other_notes: str = ""  # the lines of the notes that are the user's
    tasks: tuple[TaskClass, ...] = ()  # of its guest, as they were
    kind: Literal["restore_partition"] = "restore_partition"

    def __str__(self) -> str:
        return "make it again as it was"


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoveDisk:
    """Delete the file of a virtual disk that grows out of `parent` and that no machine has any more."""

    partition: str  # that had it
    path: str
    parent: str
    kind: Literal["remove_disk"] = "remove_disk"

    def __str__(self) -> str:
        return f"delete its disk {self.path}"


@dataclass(frozen=True, slots=True, kw_only=True)
class RenamePartition:
    """Give the machine its (new) name; on a pending one this ends its making."""

    partition: str  # as resolved before the step
    name: str  # as it is called afterwards
    machine: str = ""
    kind: Literal["rename_partition"] = "rename_partition"

    def __str__(self) -> str:
        return f"give it its name {self.name}"


@dataclass(frozen=True, slots=True, kw_only=True)
class WriteMark:
    """Write our line into the notes; the provider reads the machine's id for it. Other lines stay."""

    partition: str
    application: str
    name: str
    set: str
    stopped_by: StoppedBy = StoppedBy.NO_USER
    protected: bool = False
    machine: str = ""
    kind: Literal["write_mark"] = "write_mark"

    def mark(self, machine: str) -> Mark:
        """Return the mark as it is written on the machine of this id."""
        return Mark(
            application=self.application,
            name=self.name,
            machine=machine[:ID_DIGITS].lower(),
            set=self.set,
            stopped_by=self.stopped_by,
            protected=self.protected,
        )

    def __str__(self) -> str:
        return f"mark it as {self.application}/{self.name}"


@dataclass(frozen=True, slots=True, kw_only=True)
class EraseMark:
    """Take our line out of the notes."""

    partition: str
    machine: str = ""
    kind: Literal["erase_mark"] = "erase_mark"

    def __str__(self) -> str:
        return "erase the mark"


@dataclass(frozen=True, slots=True, kw_only=True)
class SetProcessors:
    """The number of virtual processors; the machine must be off."""

    partition: str
    processors: int
    machine: str = ""
    kind: Literal["set_processors"] = "set_processors"

    def __str__(self) -> str:
        return f"processors {self.processors}"


@dataclass(frozen=True, slots=True, kw_only=True)
class SetCpu:
    """Reserve, limit and weight in one call; on Linux with the period of the limit."""

    partition: str
    reserve: int
    limit: int
    weight: int
    quota_period_us: int | None = None
    machine: str = ""
    kind: Literal["set_cpu"] = "set_cpu"

    def __str__(self) -> str:
        period = f", counted every {show_period(self.quota_period_us)}" if self.quota_period_us else ""
        return f"reserve {self.reserve} %, limit {self.limit} %{period}, weight {self.weight}"


@dataclass(frozen=True, slots=True, kw_only=True)
class SetMemory:
    """Memory at start, and whether it is dynamic."""

    partition: str
    memory: int  # bytes
    dynamic: bool = False
    machine: str = ""
    kind: Literal["set_memory"] = "set_memory"

    def __str__(self) -> str:
        return f"memory {show_bytes(self.memory)}{', dynamic' if self.dynamic else ''}"


@dataclass(frozen=True, slots=True, kw_only=True)
class SetActions:
    """Set what happens to the machine when the host starts and stops, and its checkpoints; None leaves one as it is.

    The action at the host's stop is taken only while the machine is off.
    """

    partition: str
    start: StartAction | None = None
    stop: StopAction | None = None
    checkpoints: Checkpoints | None = None
    machine: str = ""
    kind: Literal["set_actions"] = "set_actions"

    def __str__(self) -> str:
        said = []
        if self.start:
            said.append(f"when the host starts: {self.start.value.replace('_', ' ')}")
        if self.stop:
            said.append(f"when the host stops: {self.stop.value.replace('_', ' ')}")
        if self.checkpoints:
            disabled = self.checkpoints is Checkpoints.DISABLED
            said.append(f"{'no' if disabled else self.checkpoints.value.replace('_', ' ')} checkpoints")
        return "; ".join(said)


@dataclass(frozen=True, slots=True, kw_only=True)
class SetSecureBoot:
    """Switch secure boot off, or on with this template; only generation 2 has it, and only while the machine is off."""

    partition: str
    secure_boot: str  # a template's name, or `SECURE_BOOT_OFF`
    machine: str = ""
    kind: Literal["set_secure_boot"] = "set_secure_boot"

    def __str__(self) -> str:
        return f"secure boot {self.secure_boot}"


@dataclass(frozen=True, slots=True, kw_only=True)
class StartPartition:
    """Start the machine; refused where its reserve or memory does not fit."""

    partition: str
    machine: str = ""
    kind: Literal["start_partition"] = "start_partition"

    def __str__(self) -> str:
        return "start it"


@dataclass(frozen=True, slots=True, kw_only=True)
class StopPartition:
    """Ask the guest to shut down; after the grace, or where it does not run, turn the machine off."""

    partition: str
    grace_ms: int
    machine: str = ""
    kind: Literal["stop_partition"] = "stop_partition"

    def __str__(self) -> str:
        return "stop it"


FORCED_MS = 300_000
"""What `Stop-VM -Force` gives the programs of a guest, and no more (windows.md 3)."""


def forced_after_ms(grace_ms: int) -> int:
    """When a guest on Hyper-V that was asked to shut down is forced to.

    Args:
        grace_ms: milliseconds until its machine is turned off.

    Returns:
        Milliseconds after it was asked: half of the grace, or five minutes before its end where that is later.
    """
    return max(grace_ms // 2, grace_ms - FORCED_MS)


@dataclass(frozen=True, slots=True, kw_only=True)
class WriteTaskClass:
    """Make the task class, or SystemResponsiveness, exactly these values, with their types."""

    task: str  # its name, or `SYSTEM_RESPONSIVENESS`
    inside: str  # partition whose guest it is; empty: the host itself
    values: Mapping[str, RegistryValue]
    kind: Literal["write_task_class"] = "write_task_class"

    def __str__(self) -> str:
        return "set " + ", ".join(f"{name} {value.data}" for name, value in sorted(self.values.items()))


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoveTaskClass:
    """Remove the key of a task class that we made; of SystemResponsiveness only its value."""

    task: str
    inside: str
    kind: Literal["remove_task_class"] = "remove_task_class"

    def __str__(self) -> str:
        return "take the value away" if self.task == SYSTEM_RESPONSIVENESS else "remove the class"


@dataclass(frozen=True, slots=True, kw_only=True)
class WriteTaskRecord:
    """Keep whose a task class is and what was there before, outside the multimedia keys."""

    task: str
    inside: str
    record: TaskRecord
    kind: Literal["write_task_record"] = "write_task_record"

    def __str__(self) -> str:
        return "record that it is ours, and what was there"


@dataclass(frozen=True, slots=True, kw_only=True)
class EraseTaskRecord:
    """Forget a task class: it is no longer ours."""

    task: str
    inside: str
    application: str
    kind: Literal["erase_task_record"] = "erase_task_record"

    def __str__(self) -> str:
        return "forget it: it is no longer ours"


MachineOperation = (
    RemovePartition
    | RenamePartition
    | WriteMark
    | EraseMark
    | SetProcessors
    | SetCpu
    | SetMemory
    | SetActions
    | SetSecureBoot
    | StartPartition
    | StopPartition
)
"""Operations on a machine that exists."""

TaskOperation = WriteTaskClass | RemoveTaskClass | WriteTaskRecord | EraseTaskRecord
Operation = CreatePartition | RestorePartition | MachineOperation | RemoveDisk | TaskOperation


def mark_operation(mark: Mark | None, partition: str, machine: str = "") -> WriteMark | EraseMark:
    """Write this mark on a machine; without one, erase the mark that it has."""
    if mark is None:
        return EraseMark(partition=partition, machine=machine)
    return WriteMark(
        partition=partition,
        application=mark.application,
        name=mark.name,
        set=mark.set,
        stopped_by=mark.stopped_by,
        protected=mark.protected,
        machine=machine,
    )


def applied(settings: PartitionSettings, operation: MachineOperation) -> PartitionSettings:
    """Return what an operation makes of a partition's settings.

    Args:
        settings: before the operation.
        operation: one that the host accepts.

    Returns:
        The settings after it; one that is about something else leaves them as they are.
    """
    match operation:
        case RenamePartition(name=name):
            return replace(settings, name=name)
        case SetProcessors(processors=processors):
            return replace(settings, processors=processors)
        case SetCpu(reserve=reserve, limit=limit, weight=weight, quota_period_us=period):
            return replace(settings, reserve=reserve, limit=limit, weight=weight, quota_period_us=period)
        case SetMemory(memory=memory, dynamic=dynamic):
            return replace(settings, memory=memory, dynamic_memory=dynamic)
        case SetActions(start=start, stop=stop, checkpoints=checkpoints):
            return replace(
                settings,
                start_action=start or settings.start_action,
                stop_action=stop or settings.stop_action,
                checkpoints=checkpoints or settings.checkpoints,
            )
        case SetSecureBoot(secure_boot=secure_boot):
            return replace(settings, secure_boot=secure_boot)
        case StartPartition() | StopPartition():
            return replace(settings, running=isinstance(operation, StartPartition))
        case RemovePartition() | WriteMark() | EraseMark():
            return settings
        case _:
            assert_never(operation)


def partition_after(partition: Partition, operation: MachineOperation) -> Partition:
    """Return a machine after an operation on it that leaves it there: its settings, its state and its mark.

    Args:
        partition: before the operation.
        operation: one that the host accepts.

    Returns:
        The machine after it.
    """
    after = replace(partition, settings=applied(partition.settings, operation))
    match operation:
        case WriteMark():
            return replace(after, mark=operation.mark(partition.id))
        case EraseMark():
            return replace(after, mark=None)
        case StartPartition():
            return replace(after, state=RunState.RUNNING)
        case StopPartition():
            return replace(after, state=RunState.OFF)
        case _:
            return after


def reverse(operation: MachineOperation, before: Partition, *, grace_ms: int = ceil(GRACE)) -> Operation | None:
    """Return the operation that takes this one back, given the machine that was there before.

    Args:
        operation: on that machine.
        before: the machine before the operation.
        grace_ms: how long its guest may take to shut down, where taking back means to stop it.

    Returns:
        None where nothing takes it back: a machine is not made again, and one that was stopped while it was paused is
        not so again.
    """
    settings, partition, machine = before.settings, operation.partition, operation.machine
    match operation:
        case RenamePartition():
            return replace(operation, name=settings.name)
        case SetProcessors():
            return replace(operation, processors=settings.processors)
        case SetCpu():
            return replace(
                operation,
                reserve=settings.reserve,
                limit=settings.limit,
                weight=settings.weight,
                quota_period_us=settings.quota_period_us,
            )
        case SetMemory():
            return replace(operation, memory=settings.memory, dynamic=settings.dynamic_memory)
        case SetActions(start=start, stop=stop, checkpoints=checkpoints):
            return replace(
                operation,
                start=start and settings.start_action,
                stop=stop and settings.stop_action,
                checkpoints=checkpoints and settings.checkpoints,
            )
        case SetSecureBoot():
            return replace(operation, secure_boot=settings.secure_boot or SECURE_BOOT_OFF)
        case WriteMark() | EraseMark():
            return mark_operation(before.mark, partition, machine)
        case StartPartition():
            return StopPartition(partition=partition, grace_ms=grace_ms, machine=machine)
        case StopPartition():
            return StartPartition(partition=partition, machine=machine) if settings.running else None
        case RemovePartition():
            return None
        case _:
            assert_never(operation)


def reverse_task(operation: TaskOperation, before: TaskClass | Responsiveness | None) -> TaskOperation:
    """Return the operation that takes this one back, given the task class, or SystemResponsiveness, before it.

    Args:
        operation: on that class, or on that value.
        before: as it was; None: nothing was there.

    Returns:
        One that brings back the values, or rarms' record, that were there.
    """
    task, inside = operation.task, operation.inside
    values, record = (before.values, before.record) if before else ({}, None)
    match operation:
        case WriteTaskClass() | RemoveTaskClass():
            return values_operation(task, inside, values)
        case WriteTaskRecord(record=TaskRecord(application=application)) | EraseTaskRecord(application=application):
            if record is None:
                return EraseTaskRecord(task=task, inside=inside, application=application)
            return WriteTaskRecord(task=task, inside=inside, record=record)
        case _:
            assert_never(operation)


def values_operation(task: str, inside: str, values: Mapping[str, RegistryValue]) -> WriteTaskClass | RemoveTaskClass:
    """Make a task class, or SystemResponsiveness, exactly these values; without values, remove it."""
    if not values:
        return RemoveTaskClass(task=task, inside=inside)
    return WriteTaskClass(task=task, inside=inside, values=dict(values))
