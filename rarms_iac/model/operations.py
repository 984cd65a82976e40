"""The operations of steps: each is one call to a host, with all it needs.

Each operation is one indivisible call on every provider, so that a kill leaves it either undone or done. Partitions
are named as the manifest names them; the provider resolves the name as `diff.readings.resolve` says: `machine`, the id,
where the plan knew it (always for one that existed), otherwise our mark or the plan's pending name.

SystemResponsiveness of the host itself is written, removed and recorded by the operations of task classes: its value
has the name of the class, and no task class of the manifest may have that name (RARMS043).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from rarms_iac.model.changes import SLASH
from rarms_iac.model.facets import FACETS, Facet, FacetRow, Reading, Readings, facet_of, refuse_values
from rarms_iac.model.state import ID_DIGITS, Mark, PartitionSettings, RegistryValue, StoppedBy, TaskClass, TaskRecord


@dataclass(frozen=True, slots=True, kw_only=True)
class CreatePartition:
    """Make the machine, off, under its pending name `<name>.rarms-<plan id>` and without reserve."""

    partition: str
    generation: int
    memory: int  # bytes
    image: str = ""  # parent disk of a differencing child; empty: no disk
    switch: str = ""  # empty: not connected
    vm_path: str = ""  # empty: the host's default
    secure_boot: str = ""  # a template, or `SECURE_BOOT_OFF`; empty: as the host makes it
    kind: Literal["create_partition"] = "create_partition"


def disk_path(making: CreatePartition, plan: str, usual: str) -> str:
    """Return the path of a planned partition's disk: in the partition's folder, or in the host's own.

    Args:
        plan: its id, which the file's name holds.
        usual: the host's folder of disks, for a partition that has no `vm_path`.

    Returns:
        The path, in the format of its parent.
    """
    file = f"{making.partition}-{plan}{'.vhd' if making.image.lower().endswith('.vhd') else '.vhdx'}"
    folder = partition_folder(making, making.partition) if making.vm_path else usual.rstrip(SLASH)
    return f"{folder}{SLASH}{file}"


def partition_folder(making: CreatePartition, name: str) -> str:
    """Return the folder that Hyper-V makes below `vm_path` for a machine of this name."""
    return f"{making.vm_path.rstrip(SLASH)}{SLASH}{name}"


@dataclass(frozen=True, slots=True, kw_only=True)
class RemovePartition:
    """Remove the machine; its disks are kept."""

    partition: str
    machine: str = ""
    kind: Literal["remove_partition"] = "remove_partition"


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
    stopped_by: StoppedBy = StoppedBy.NO_USER
    robot: str = ""
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
            robot=self.robot,
            protected=self.protected,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class EraseMark:
    """Take our line out of the notes."""

    partition: str
    machine: str = ""
    kind: Literal["erase_mark"] = "erase_mark"


@dataclass(frozen=True, slots=True, kw_only=True)
class Set:
    """Give a machine settings of one facet, in one call."""

    partition: str
    facet: Facet
    before: Readings = field(default_factory=dict)  # empty: it is not known, as of a machine that is new
    after: Readings  # the other settings of the facet stay as they are
    machine: str = ""
    kind: Literal["set"] = "set"

    def __post_init__(self) -> None:
        """Refuse what is not of the facet (ValueError)."""
        refuse_values(self.facet, self.before)
        refuse_values(self.facet, self.after)

    @property
    def row(self) -> FacetRow:
        """How the facet is set."""
        return FACETS[self.facet]

    @property
    def reversed(self) -> "Set":
        """The operation that undoes this one."""
        return replace(self, before=self.after, after=self.before)


def set_to(partition: str, machine: str = "", **values: Reading) -> Set:
    """Return the operation that gives a machine these settings, all of one facet, without the values before it."""
    return Set(partition=partition, machine=machine, facet=facet_of(next(iter(values))), after=values)


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


FORCED_MS = 300_000
"""What `Stop-VM -Force` gives the programs of a guest, and no more (windows.md 3)."""


def forced_after_ms(grace_ms: int) -> int:
    """Return the time at which a Hyper-V guest that was asked to shut down is forced to.

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


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoveTaskClass:
    """Remove the key of a task class that we made; of SystemResponsiveness only its value."""

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


MachineOperation = RemovePartition | RenamePartition | WriteMark | EraseMark | Set | StartPartition | StopPartition
"""Operations on a machine that exists."""

TaskOperation = WriteTaskClass | RemoveTaskClass | WriteTaskRecord | EraseTaskRecord
Operation = CreatePartition | RestorePartition | MachineOperation | RemoveDisk | TaskOperation


def call_name(operation: Operation) -> str:
    """Return the name of the call, by which faults of a simulated host name it: `start_partition`, `set_cpu`."""
    return f"set_{operation.facet}" if isinstance(operation, Set) else operation.kind
