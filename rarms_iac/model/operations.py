"""What one step does to a host: one call, with all it needs (DESIGN section 4).

Each operation is one indivisible call on every provider, so that a kill leaves it either undone or done. Partitions
are named as the manifest names them; the provider resolves the name as `diff.readings.resolve` says: `machine`, the id,
where the plan knew it (always for one that existed), otherwise our mark or the plan's pending name.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from rarms_iac.model.state import Checkpoints, RegistryValue, StartAction, StopAction, StoppedBy, TaskRecord


@dataclass(frozen=True, slots=True, kw_only=True)
class CreatePartition:
    """Make the machine, off, under its pending name `<name>.rarms-<plan id>` and without reserve."""

    partition: str
    generation: int
    memory: int  # bytes
    image: str = ""  # parent disk of a differencing child; empty: no disk
    switch: str = ""  # empty: not connected
    vm_path: str = ""  # empty: the host's default
    kind: Literal["create_partition"] = "create_partition"


def disk_file(making: CreatePartition, plan: str) -> str:
    """The name of the disk that the plan of this id makes for a partition: its parent's format, and the plan's id."""
    return f"{making.partition}-{plan}{'.vhd' if making.image.lower().endswith('.vhd') else '.vhdx'}"


@dataclass(frozen=True, slots=True, kw_only=True)
class RemovePartition:
    """Remove the machine; its disks are kept."""

    partition: str
    machine: str = ""
    kind: Literal["remove_partition"] = "remove_partition"


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoveDisk:
    """Delete the file of a virtual disk that grows out of `parent` and that no machine has any more."""

    partition: str  # that had it
    path: str
    parent: str
    kind: Literal["remove_disk"] = "remove_disk"


@dataclass(frozen=True, slots=True, kw_only=True)
class RenamePartition:
    """Give the machine its (new) name; on a pending one this ends its making."""

    partition: str  # as resolved before the step
    name: str  # as it is called afterwards
    machine: str = ""
    kind: Literal["rename_partition"] = "rename_partition"


@dataclass(frozen=True, slots=True, kw_only=True)
class WriteMark:
    """Write our line into the notes; the provider reads the machine's id for it. Other lines stay."""

    partition: str
    application: str
    name: str
    set: str
    stopped_by: StoppedBy = StoppedBy.NOBODY
    machine: str = ""
    kind: Literal["write_mark"] = "write_mark"


@dataclass(frozen=True, slots=True, kw_only=True)
class EraseMark:
    """Take our line out of the notes."""

    partition: str
    machine: str = ""
    kind: Literal["erase_mark"] = "erase_mark"


@dataclass(frozen=True, slots=True, kw_only=True)
class SetProcessors:
    """The number of virtual processors; the machine must be off."""

    partition: str
    processors: int
    machine: str = ""
    kind: Literal["set_processors"] = "set_processors"


@dataclass(frozen=True, slots=True, kw_only=True)
class SetCpu:
    """Reserve, limit and weight in one call."""

    partition: str
    reserve: int
    limit: int
    weight: int
    machine: str = ""
    kind: Literal["set_cpu"] = "set_cpu"


@dataclass(frozen=True, slots=True, kw_only=True)
class SetMemory:
    """Memory at start, and whether it is dynamic."""

    partition: str
    memory: int  # bytes
    dynamic: bool = False
    machine: str = ""
    kind: Literal["set_memory"] = "set_memory"


@dataclass(frozen=True, slots=True, kw_only=True)
class SetActions:
    """What happens to the machine when the host starts and stops, and its checkpoints."""

    partition: str
    start: StartAction
    stop: StopAction
    checkpoints: Checkpoints
    machine: str = ""
    kind: Literal["set_actions"] = "set_actions"


@dataclass(frozen=True, slots=True, kw_only=True)
class StartPartition:
    """Start the machine; refused where its reserve or memory does not fit."""

    partition: str
    machine: str = ""
    kind: Literal["start_partition"] = "start_partition"


@dataclass(frozen=True, slots=True, kw_only=True)
class StopPartition:
    """Ask the guest to shut down; after the grace, or where it does not run, turn the machine off."""

    partition: str
    grace_ms: int
    machine: str = ""
    kind: Literal["stop_partition"] = "stop_partition"


@dataclass(frozen=True, slots=True, kw_only=True)
class WriteTaskClass:
    """Make the task class exactly these values, with their types."""

    task: str
    inside: str  # partition whose guest it is; empty: the host itself
    values: Mapping[str, RegistryValue]
    kind: Literal["write_task_class"] = "write_task_class"


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoveTaskClass:
    """Remove the key of a task class that we made."""

    task: str
    inside: str
    kind: Literal["remove_task_class"] = "remove_task_class"


@dataclass(frozen=True, slots=True, kw_only=True)
class WriteTaskRecord:
    """Keep whose a task class is and what was there before, outside the multimedia keys."""

    task: str
    inside: str
    record: TaskRecord
    kind: Literal["write_task_record"] = "write_task_record"


@dataclass(frozen=True, slots=True, kw_only=True)
class EraseTaskRecord:
    """Forget a task class: it is no longer ours."""

    task: str
    inside: str
    application: str
    kind: Literal["erase_task_record"] = "erase_task_record"


@dataclass(frozen=True, slots=True, kw_only=True)
class WriteResponsiveness:
    """Set SystemResponsiveness of the host's own Windows, with its type."""

    value: RegistryValue
    kind: Literal["write_responsiveness"] = "write_responsiveness"


@dataclass(frozen=True, slots=True, kw_only=True)
class EraseResponsiveness:
    """Take the value away: there was none before rarms."""

    kind: Literal["erase_responsiveness"] = "erase_responsiveness"


@dataclass(frozen=True, slots=True, kw_only=True)
class WriteResponsivenessRecord:
    """Keep whose SystemResponsiveness is and what was there before, where the records of task classes are."""

    record: TaskRecord
    kind: Literal["write_responsiveness_record"] = "write_responsiveness_record"


@dataclass(frozen=True, slots=True, kw_only=True)
class EraseResponsivenessRecord:
    """Forget it: it is no longer ours."""

    application: str
    kind: Literal["erase_responsiveness_record"] = "erase_responsiveness_record"


PartitionOperation = (
    CreatePartition
    | RemovePartition
    | RenamePartition
    | WriteMark
    | EraseMark
    | SetProcessors
    | SetCpu
    | SetMemory
    | SetActions
    | StartPartition
    | StopPartition
)
TaskOperation = WriteTaskClass | RemoveTaskClass | WriteTaskRecord | EraseTaskRecord
ResponsivenessOperation = (
    WriteResponsiveness | EraseResponsiveness | WriteResponsivenessRecord | EraseResponsivenessRecord
)
Operation = PartitionOperation | RemoveDisk | TaskOperation | ResponsivenessOperation
