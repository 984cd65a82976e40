"""The content of a simulated host: its file, what operations make of it, and the State that a look shows.

The machine itself (processors, memory, build, scheduler, rights) is described by the manifest each time; this is what
was done to it since: machines, disks, registries. The file is one record as in a journal, with a checksum: a file that
is not exactly as it was written is damaged, and is never taken for something else. Pure: what is refused was refused
before (`refusals.py`).
"""

import re
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, TypeVar, assert_never, cast

from rarms_iac.model import operations
from rarms_iac.model.capacity import core_sharing
from rarms_iac.model.changes import RESPONSIVENESS, Address
from rarms_iac.model.host import Host
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS, USUAL
from rarms_iac.model.plan import Scope
from rarms_iac.model.state import (
    Checkpoints,
    Disk,
    DiskKind,
    HostFacts,
    Partition,
    PartitionSettings,
    RegistryValue,
    Responsiveness,
    Rights,
    RunState,
    StartAction,
    State,
    StopAction,
    TaskClass,
    TaskRecord,
    ValueKind,
)
from rarms_iac.providers.machines import KeptMachine, changed, new_settings, notes_of, with_marks
from rarms_iac.storage.codec import NotDecodable, decode, encode
from rarms_iac.storage.records import Record, records_in, sealed_line

T = TypeVar("T")

Values = Mapping[str, RegistryValue]


def _shipped(category: str, priority: int, background_priority: int | None, background_only: str) -> Values:
    def dword(data: int) -> RegistryValue:
        return RegistryValue(kind=ValueKind.DWORD, data=data)

    def text(data: str) -> RegistryValue:
        return RegistryValue(kind=ValueKind.SZ, data=data)

    background = {} if background_priority is None else {"BackgroundPriority": dword(background_priority)}
    return {
        "Affinity": dword(0),
        "Background Only": text(background_only),
        **background,
        "Clock Rate": dword(10_000),
        "GPU Priority": dword(8),
        "Priority": dword(priority),
        "SFIO Priority": text("Normal"),
        "Scheduling Category": text(category),
    }


SHIPPED: Mapping[str, Values] = {
    "Audio": _shipped("Medium", 6, None, "True"),
    "Capture": _shipped("Medium", 5, None, "True"),
    "DisplayPostProcessing": _shipped("High", 8, 8, "True"),
    "Distribution": _shipped("Medium", 4, None, "True"),
    "Games": _shipped("Medium", 2, None, "False"),
    "Playback": _shipped("Medium", 3, 4, "False"),
    "Pro Audio": _shipped("High", 1, None, "False"),
    "Window Manager": _shipped("Medium", 5, None, "True"),
}
"""The task classes that every Windows brings (windows.md 6.5)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Registry:
    """The part of an operating system's registry that concerns rarms. Key names are compared without case."""

    tasks: Mapping[str, Values] = field(default_factory=lambda: SHIPPED)
    records: Mapping[str, TaskRecord] = field(default_factory=dict)  # by the class's name in lower case
    responsiveness: Responsiveness = Responsiveness(value=RegistryValue(kind=ValueKind.DWORD, data=USUAL))

    def entry(self, task: str) -> tuple[Values | None, TaskRecord | None]:
        """Return the values of a task class or SystemResponsiveness (None without a key), and our record of it."""
        if task == SYSTEM_RESPONSIVENESS:
            return self.responsiveness.values or None, self.responsiveness.record
        key = self.key(task)
        return None if key is None else self.tasks[key], self.records.get(task.lower())

    def key(self, task: str) -> str | None:
        """Return the name of a task class's key as it is written there; None: there is none."""
        wanted = task.lower()
        return next((name for name in self.tasks if name.lower() == wanted), None)


FRESH = Registry()
"""As Windows is installed."""


def change_registry(registry: Registry, operation: operations.TaskOperation) -> Registry:
    """Return the registry after the operation. A key that exists keeps the case of its name."""
    values, record = registry.entry(operation.task)
    match operation:
        case operations.WriteTaskClass(values=wanted):
            values = dict(wanted)
        case operations.RemoveTaskClass():
            values = None
        case operations.WriteTaskRecord(record=wanted):
            record = wanted
        case operations.EraseTaskRecord():
            record = None
        case _:
            assert_never(operation)
    if operation.task == SYSTEM_RESPONSIVENESS:
        changed = Responsiveness(value=(values or {}).get(SYSTEM_RESPONSIVENESS), record=record)
        return replace(registry, responsiveness=changed)
    key = registry.key(operation.task) or operation.task
    return replace(
        registry,
        tasks=_with_entry(registry.tasks, key, values),
        records=_with_entry(registry.records, operation.task.lower(), record),
    )


def _with_entry(entries: Mapping[str, T], name: str, entry: T | None) -> Mapping[str, T]:
    others = {known: value for known, value in entries.items() if known != name}
    return others if entry is None else {**others, name: entry}


NAMESPACE = uuid.UUID("6f1d3c52-8a0e-5b7c-9d44-72a1b0e5c301")
"""Ids of simulated hosts and machines are made in it, so that the same input gives the same bytes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedMachine(KeptMachine):
    """A machine of the host."""

    state: RunState  # `running` of its settings agrees with it

    def now(self, state: RunState) -> "SimulatedMachine":
        """Return the machine in this state."""
        running = state is RunState.RUNNING
        return replace(self, state=state, settings=replace(self.settings, running=running))


@dataclass(frozen=True, slots=True, kw_only=True)
class Content:
    """Everything on the host."""

    id: str
    format: Literal["rarms-simulated-host/1"] = "rarms-simulated-host/1"
    made: int = 0  # how many machines there ever were: no id comes twice
    machines: Mapping[str, SimulatedMachine] = field(default_factory=dict)  # by id
    registries: Mapping[str, Registry] = field(default_factory=dict)  # by machine, "" the host's; absent: FRESH
    disks: tuple[Disk, ...] = ()  # by path
    struck: Mapping[str, int] = field(default_factory=dict)  # how often a fault of this name struck

    def registry(self, machine: str) -> Registry:
        """Return the registry of this machine's guest, of the host itself for the empty id."""
        return self.registries.get(machine, FRESH)

    def with_machine(self, machine: SimulatedMachine) -> "Content":
        """Return the content with this machine, new or in place of the one of its id."""
        return replace(self, machines={**self.machines, machine.id: machine})

    def without_machine(self, machine: str) -> "Content":
        """Return the content without the machine of this id and its guest; its disks stay."""
        return replace(
            self,
            machines={key: value for key, value in self.machines.items() if key != machine},
            registries={key: value for key, value in self.registries.items() if key != machine},
            disks=tuple(replace(disk, machine="") if disk.machine == machine else disk for disk in self.disks),
        )

    def with_disk(self, disk: Disk) -> "Content":
        """Return the content with one disk more."""
        return replace(self, disks=tuple(sorted((*self.disks, disk), key=lambda disk: disk.path)))

    def without_disk(self, path: str) -> "Content":
        """Return the content without the disk of this path."""
        return replace(self, disks=tuple(disk for disk in self.disks if disk.path != path))

    def with_registry(self, machine: str, registry: Registry) -> "Content":
        """Return the content with this registry in that machine's guest, or on the host for the empty id."""
        return replace(self, registries={**self.registries, machine: registry})


def empty(host: str) -> Content:
    """Return a host on which nothing was ever done.

    Args:
        host: its name, with overlays behind that of the robot's folder.
    """
    return Content(id=str(uuid.uuid5(NAMESPACE, f"host/{host}")))


def next_id(content: Content, name: str) -> str:
    """Return the id of the next machine, if it is called so."""
    return str(uuid.uuid5(uuid.UUID(content.id), f"{name}/{content.made + 1}"))


def write_content(content: Content) -> bytes:
    """Return the file that holds this content."""
    return sealed_line(cast("Record", encode(content)))


def read_content(data: bytes, path: Path) -> Content:
    """Return the content of the file; `path` says where it comes from, for people.

    Raises:
        Damaged: it is not as it was written.
        NotDecodable: it is of another format.
    """
    record, *others = records_in(data, path)
    if others or data.count(b"\n") != 1 or not data.endswith(b"\n"):
        raise NotDecodable("", "it is not the one line that rarms wrote")
    return decode(Content, record)


def address_of(operation: operations.Operation) -> Address:
    """Return the address of what the operation changes, as faults name it."""
    match operation:
        case operations.CreatePartition() | operations.RestorePartition():
            return Address(partition=operation.partition)
        case operations.RemoveDisk():
            return Address(partition=operation.partition, disk=operation.path)
        case _ if isinstance(operation, operations.TaskOperation):
            if operation.task == SYSTEM_RESPONSIVENESS:
                return RESPONSIVENESS
            return Address(partition=operation.inside, task=operation.task)
        case _:
            return Address(partition=operation.partition, machine=operation.machine)


def made_settings(operation: operations.CreatePartition, scope: Scope) -> PartitionSettings:
    """Return a new machine, off, without reserve, under its pending name; the rest as Hyper-V makes it."""
    return replace(
        new_settings(scope.pending(operation.partition), operation.memory),
        generation=operation.generation,
        start_action=StartAction.START_IF_RUNNING,
        stop_action=StopAction.SAVE,
        checkpoints=Checkpoints.PRODUCTION,
        secure_boot=(operation.secure_boot or "MicrosoftWindows") if operation.generation == 2 else "",
    )


def with_new_machine(content: Content, settings: PartitionSettings) -> Content:
    """Return the content with one machine more."""
    machine = SimulatedMachine(id=next_id(content, settings.name), settings=settings, state=RunState.OFF)
    return replace(content, made=content.made + 1).with_machine(machine)


def with_restored_machine(content: Content, operation: operations.RestorePartition) -> Content:
    """Return the content with a machine again that was removed: off, and with rarms' task classes in its guest."""
    machine = SimulatedMachine(
        id=operation.machine, settings=operation.settings, state=RunState.OFF, notes=notes_of(operation)
    )
    if not operation.tasks:
        return content.with_machine(machine)
    registry = replace(
        FRESH,
        tasks={**FRESH.tasks, **{task.name: task.values for task in operation.tasks if task.values}},
        records={task.name.lower(): task.record for task in operation.tasks if task.record},
    )
    return content.with_machine(machine).with_registry(machine.id, registry)


def with_new_disk(
    content: Content, machine: str, operation: operations.CreatePartition, folder: str, scope: Scope
) -> Content:
    """Return the content with one disk more, of a machine, which grows out of an image."""
    path = operations.disk_path(operation, scope.plan, folder)
    disk = Disk(path=path, kind=DiskKind.DIFFERENCING, parent=operation.image, machine=machine)
    return content.with_disk(disk)


def change_machine(content: Content, machine: SimulatedMachine, operation: operations.MachineOperation) -> Content:
    """Return the content after the operation on this machine."""
    match operation:
        case operations.RemovePartition():
            return content.without_machine(machine.id)
        case operations.StartPartition():
            return content.with_machine(machine.now(RunState.RUNNING))
        case operations.StopPartition():
            return content.with_machine(machine.now(RunState.OFF))
        case _:
            return content.with_machine(changed(machine, operation))


DISK_FOLDER = "C:\\disks"
"""The folder of a simulated host's disks, as its facts name it."""

_PENDING = re.compile(r"(?P<partition>[a-z0-9-]+)\.rarms-[0-9a-f]+")


def to_state(content: Content, host: Host) -> State:
    """Return the State that an observation shows: without the rights, no machines and no guests (windows.md 5)."""
    facts = facts_of(content, host)
    is_visible = facts.rights is Rights.PROVEN
    partitions = _partitions(content, host, facts) if is_visible else ()
    guests = sorted((inside, partition.id) for partition in partitions if (inside := _stands_for(partition)))
    return State(
        facts=facts,
        partitions=partitions,
        tasks=tuple(task for inside, machine in [("", ""), *guests] for task in _tasks(content, inside, machine)),
        responsiveness=content.registry("").responsiveness,
        disks=content.disks if is_visible else (),
    )


def _partitions(content: Content, host: Host, facts: HostFacts) -> tuple[Partition, ...]:
    """Return the machines by name, then id, with the marks that count."""
    sharing, build = core_sharing(facts), host.simulated.guest_windows_build
    return with_marks(
        (
            Partition(
                settings=machine.settings, id=machine.id, state=machine.state, sharing=sharing, guest_build=build
            ),
            machine.notes,
        )
        for machine in content.machines.values()
    )


def facts_of(content: Content, host: Host) -> HostFacts:
    """Return the facts of the host that decisions use, as the manifest describes it now."""
    described = host.simulated
    return HostFacts(
        name=host.name,
        id=content.id,
        provider=host.provider,
        computer_name=host.name,
        os_build=described.windows_build,
        client=described.client,
        scheduler=described.scheduler_type,
        smt=described.smt,
        logical_processors=host.logical_processors,
        memory=int(host.memory),
        rights=Rights.PROVEN if described.administrator else Rights.MISSING,
        disk_folder=DISK_FOLDER,
    )


def _stands_for(partition: Partition) -> str:
    """Return the manifest's name of a partition of rarms, also of one that is being made.

    Empty for the machines of others.
    """
    if partition.mark is not None:
        return partition.mark.name
    pending = _PENDING.fullmatch(partition.settings.name)
    return pending["partition"] if pending else ""


def _tasks(content: Content, inside: str, machine: str) -> list[TaskClass]:
    """Return the task classes of one operating system by name, a record without its key included."""
    registry = content.registry(machine)
    if registry is FRESH:
        return [TaskClass(name=name, inside=inside, machine=machine, values=values) for name, values in SHIPPED.items()]
    keys = {name.lower(): name for name in registry.tasks}
    names = sorted({**{record: record for record in registry.records}, **keys}.items())
    return [
        TaskClass(
            name=name,
            inside=inside,
            machine=machine,
            values=registry.tasks.get(name, {}),
            record=registry.records.get(lower),
        )
        for lower, name in names
    ]
