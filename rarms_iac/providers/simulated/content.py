"""The content of a simulated host: its machines, their disks and the registries of its operating systems.

The machine itself (processors, memory, build, scheduler, rights) is described by the manifest each time; this is what
was done to it since. Pure.
"""

import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from rarms_iac.model.mmcss import USUAL
from rarms_iac.model.state import (
    Disk,
    PartitionSettings,
    RegistryValue,
    Responsiveness,
    RunState,
    TaskRecord,
    ValueKind,
)

NAMESPACE = uuid.UUID("6f1d3c52-8a0e-5b7c-9d44-72a1b0e5c301")
"""Ids of simulated hosts and machines are made in it, so that the same input gives the same bytes."""


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
class SimulatedMachine:
    """A machine of the host."""

    id: str
    settings: PartitionSettings  # `running` agrees with `state`
    state: RunState
    notes: str = ""

    def now(self, state: RunState) -> "SimulatedMachine":
        """Return the machine in this state."""
        running = state is RunState.RUNNING
        return replace(self, state=state, settings=replace(self.settings, running=running))


@dataclass(frozen=True, slots=True, kw_only=True)
class Registry:
    """The part of an operating system's registry that concerns rarms. Key names are compared without case."""

    tasks: Mapping[str, Values] = field(default_factory=lambda: SHIPPED)
    records: Mapping[str, TaskRecord] = field(default_factory=dict)  # by the class's name in lower case
    responsiveness: Responsiveness = Responsiveness(value=RegistryValue(kind=ValueKind.DWORD, data=USUAL))


FRESH = Registry()
"""As Windows is installed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Content:
    """Everything on the host."""

    id: str
    made: int = 0  # how many machines there ever were: no id comes twice
    machines: Mapping[str, SimulatedMachine] = field(default_factory=dict)  # by id
    registries: Mapping[str, Registry] = field(default_factory=dict)  # by machine, "" the host's; absent: FRESH
    disks: tuple[Disk, ...] = ()  # by path
    struck: Mapping[str, int] = field(default_factory=dict)  # how often a fault of this name struck

    def registry(self, machine: str) -> Registry:
        """The registry of this machine's guest, of the host itself for the empty id."""
        return self.registries.get(machine, FRESH)

    def with_machine(self, machine: SimulatedMachine) -> "Content":
        """With this machine, new or in place of the one of its id."""
        return replace(self, machines={**self.machines, machine.id: machine})

    def without_machine(self, machine: str) -> "Content":
        """Without the machine of this id and its guest; its disks stay."""
        return replace(
            self,
            machines={key: value for key, value in self.machines.items() if key != machine},
            registries={key: value for key, value in self.registries.items() if key != machine},
            disks=tuple(replace(disk, machine="") if disk.machine == machine else disk for disk in self.disks),
        )

    def with_disk(self, disk: Disk) -> "Content":
        """With one disk more."""
        return replace(self, disks=tuple(sorted((*self.disks, disk), key=lambda disk: disk.path)))

    def without_disk(self, path: str) -> "Content":
        """Without the disk of this path."""
        return replace(self, disks=tuple(disk for disk in self.disks if disk.path != path))

    def with_registry(self, machine: str, registry: Registry) -> "Content":
        """With this registry in that machine's guest, or on the host for the empty id."""
        return replace(self, registries={**self.registries, machine: registry})


def empty(host: str) -> Content:
    """A host on which nothing was ever done.

    Args:
        host: its name, with overlays behind that of the robot's folder.
    """
    return Content(id=str(uuid.uuid5(NAMESPACE, f"host/{host}")))


def next_id(content: Content, name: str) -> str:
    """The id of the next machine, if it is called so."""
    return str(uuid.uuid5(uuid.UUID(content.id), f"{name}/{content.made + 1}"))
