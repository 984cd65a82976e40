"""Which disks of a machine rarms itself made, and so may delete when that is asked for: everything else stays.

A disk counts as rarms' own where it lies at the path that making the partition chooses (`model.operations.disk_file`),
grows out of another one, is attached to the machine with our mark and to no other, and no checkpoint rests on it.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from re import escape, fullmatch

from rarms_iac.diff.readings import same_path
from rarms_iac.model.state import Disk, DiskKind, Partition, State


@dataclass(frozen=True, slots=True, kw_only=True)
class DiskVerdict:
    """A disk of a machine that is to be removed; `reason_to_keep` is empty where it may be deleted."""

    disk: Disk
    reason_to_keep: str


def judge_disks(machine: Partition, state: State, folders: Iterable[str]) -> Iterator[DiskVerdict]:
    """Judge each disk of a machine.

    Args:
        machine: the machine that is to be removed.
        state: the host, with all disks of all machines.
        folders: where rarms makes disks for this partition.

    Yields:
        A verdict for each disk that is attached to the machine, in the order of the state.
    """
    known = tuple(folders)
    for disk in state.disks:
        if disk.machine == machine.id:
            yield DiskVerdict(disk=disk, reason_to_keep=_reason_to_keep(disk, machine, state, known))


def _reason_to_keep(disk: Disk, machine: Partition, state: State, folders: tuple[str, ...]) -> str:
    if machine.mark is None:
        return "its machine carries no mark of rarms"
    if machine.checkpoints:
        return "checkpoints of its machine rest on it"
    if disk.kind is DiskKind.UNKNOWN:
        return "what kind of disk it is could not be read"
    if disk.kind is not DiskKind.DIFFERENCING or not disk.parent:
        return "it does not grow out of an image, and rarms makes no others"
    if not _is_made_by_rarms(disk.path, machine.mark.name, folders):
        return f"it does not lie where rarms makes the disk of {machine.mark.name}"
    if any(same_path(other.parent, disk.path) for other in state.disks):
        return "another disk grows out of it"
    if any(other.machine != disk.machine for other in state.disks if same_path(other.path, disk.path)):
        return "another machine has it, too"
    return ""


def _is_made_by_rarms(path: str, partition: str, folders: tuple[str, ...]) -> bool:
    folder, _, file = path.replace("/", "\\").rpartition("\\")
    if not fullmatch(rf"{escape(partition)}-[0-9a-f]{{12}}\.vhdx?", file.lower()):
        return False
    return any(same_path(folder, known.rstrip("\\/")) for known in folders if known)
