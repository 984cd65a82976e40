"""Readings: all that can be read at an address, by the names that a step's `before` and `after` use.

`diff` makes both from states with `readings`, a host answers with the same function over what it observes now; so a
step's guard compares like with like.

For a partition: `exists`, `machine` (id), each of its settings (`model.facets`), `state` (a paused machine is neither
running nor off), `mark` (`<application>/<partition>` or empty), `set` (the digest, with the word of who stopped it),
`snapshots` (how many checkpoints were taken), `disks` (how many it has). For a disk: `exists`, `parent`, `used` (a
machine has it, or a disk that grows out of it). For a task class: `exists`, `values` (their names), `value:<name>` as
`<kind>:<data>`, `record` (`<application>` or empty), `set`. The names are in lower case in `values`, as Windows ignores
their case. For SystemResponsiveness the same as for a task class with that one value.
"""

from collections.abc import Iterable, Mapping

from rarms_iac.model.changes import Address
from rarms_iac.model.facets import Readings, setting_values
from rarms_iac.model.plan import Scope
from rarms_iac.model.state import Disk, Partition, RegistryValue, Responsiveness, State, TaskClass, TaskRecord

NOTHING: Readings = {"exists": False}
"""The readings of an address where nothing is."""

VALUE = "value:"
"""Stands before the name of a task class's value."""


def readings(state: State, address: Address, scope: Scope) -> Readings:
    """Read everything at an address.

    Args:
        address: a partition, a disk, a task class or SystemResponsiveness.
        scope: whose marks and pending names count.

    Returns:
        The readings by name; `NOTHING` where nothing is. Where several machines answer to the name, only `exists` and
        `machines`, their number: no guard accepts that.
    """
    if address.responsiveness:
        return task_readings(state.responsiveness)
    if address.disk:
        return disk_readings(state.disks, address.disk)
    if not address.partition:
        return task_readings(find_task(state.tasks, address.task, inside="", machine=""))
    machines = resolve(state.partitions, address.partition, scope, address.machine)
    if len(machines) > 1:
        return {"exists": True, "machines": len(machines)}
    if not machines:
        return task_readings(None) if address.task else NOTHING
    (partition,) = machines
    if address.task:
        return task_readings(find_task(state.tasks, address.task, inside=address.partition, machine=partition.id))
    return {**partition_readings(partition), "disks": count_disks(state, partition.id)}


def count_disks(state: State, machine: str) -> int:
    """Count the virtual disks that a machine has.

    Returns:
        How many disks of the state name this machine.
    """
    return sum(disk.machine == machine for disk in state.disks)


def resolve(partitions: Iterable[Partition], name: str, scope: Scope, machine: str = "") -> tuple[Partition, ...]:
    """Find the machines that a partition's name stands for; only exactly one may be changed.

    Args:
        scope: the application whose mark counts, and the plan whose pending name does.
        machine: an id; where it is given, the machine of this id is the answer, under any name.

    Returns:
        Those that carry the mark for the name, and those under the pending name of this plan. A machine that merely has
        the name is never managed.
    """
    if machine:
        return tuple(partition for partition in partitions if partition.id == machine)
    pending = scope.pending(name)
    return tuple(
        partition
        for partition in partitions
        if is_marked(partition, scope.application, name) or partition.settings.name == pending
    )


def is_marked(partition: Partition, application: str, name: str) -> bool:
    """Tell whether the machine carries a valid mark of this application's partition.

    Args:
        name: the partition's name in the manifest; the machine's own name does not matter.

    Returns:
        False also where the mark is another application's.
    """
    mark = partition.mark
    return mark is not None and mark.name == name and mark.application == application


def find_task(tasks: Iterable[TaskClass], name: str, *, inside: str, machine: str) -> TaskClass | None:
    """Find the task class of this name, in any case, in this operating system.

    Args:
        inside: the partition whose guest it is in; empty: the host itself.
        machine: the id of that partition's machine; empty for the host itself.

    Returns:
        The first such class; None: there is none.
    """
    wanted = name.lower()
    for task in tasks:
        if task.inside == inside and task.machine == machine and task.name.lower() == wanted:
            return task
    return None


def partition_readings(partition: Partition) -> Readings:
    """Return the readings at a partition's address.

    Returns:
        All readings by name, memory in bytes, reserve and limit in per cent of each virtual processor.
    """
    mark = partition.mark
    return {
        "exists": True,
        "machine": partition.id,
        **setting_values(partition.settings),
        "state": partition.state.value,
        "mark": f"{mark.application}/{mark.name}" if mark else "",
        "set": mark.written if mark else "",
        "snapshots": partition.checkpoints,
    }


def disk_readings(disks: Iterable[Disk], path: str) -> Readings:
    """Return the readings at a disk's address.

    Args:
        path: the disk's file; Windows' rules for equal paths hold.

    Returns:
        `exists`, `parent` and `used`; a disk that grows out of this file uses it as a machine does. `NOTHING` where
            there is no such disk.
    """
    known = tuple(disks)
    here = [disk for disk in known if same_path(disk.path, path)]
    if not here:
        return NOTHING
    used = any(disk.machine for disk in here) or any(same_path(disk.parent, path) for disk in known)
    return {"exists": True, "parent": here[0].parent, "used": used}


def same_path(path: str, other: str) -> bool:
    """Tell whether Windows takes two paths for the same: slashes and case do not matter.

    Args:
        path: as the host gives it, or as rarms makes it; not made absolute.

    Returns:
        False for two spellings that only the host could tell to be the same, such as a short name or a link.
    """
    return path.replace("/", "\\").lower() == other.replace("/", "\\").lower()


def task_readings(task: TaskClass | Responsiveness | None) -> Readings:
    """Return the readings at the address of a task class or of SystemResponsiveness.

    A key without values counts as absent. rarms' record may outlive its key, and may be written before it.

    Args:
        task: as observed; None: neither values nor a record are there.

    Returns:
        The values' readings and the record's.
    """
    return {**values_readings(task.values), **record_readings(task.record)} if task else _NO_TASK


def values_readings(values: Mapping[str, RegistryValue]) -> Readings:
    """Return the readings of registry values.

    Returns:
        `exists`, the names in lower case, and kind and data of each value, in the order of the names.
    """
    return {
        "exists": bool(values),
        "values": ", ".join(sorted(name.lower() for name in values)),
        **{f"{VALUE}{name}": f"{value.kind.value}:{value.data}" for name, value in sorted(values.items())},
    }


def record_readings(record: TaskRecord | None) -> Readings:
    """Return the readings of rarms' own record.

    Args:
        record: as observed; None: there is none.

    Returns:
        `record` (the application), `robot` and `set` (the digest), all empty without a record.
    """
    if record is None:
        return {"record": "", "robot": "", "set": ""}
    return {"record": record.application, "robot": record.robot, "set": record.set}


_NO_TASK: Readings = {**values_readings({}), **record_readings(None)}
