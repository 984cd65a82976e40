"""The content of a simulated host, and its file: machines, their disks and the registries of its operating systems.

The machine itself (processors, memory, build, scheduler, rights) is described by the manifest each time; this is what
was done to it since. The file is one record as in a journal, with a checksum: a file that is not exactly as it was
written is damaged, and is never taken for something else. Pure.
"""

import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, cast

from rarms_iac.model.state import Disk, PartitionSettings, RunState
from rarms_iac.providers.simulated.registry import FRESH, Registry
from rarms_iac.storage.append import Record, records_in, sealed_line
from rarms_iac.storage.codec import NotDecodable, decode, encode

NAMESPACE = uuid.UUID("6f1d3c52-8a0e-5b7c-9d44-72a1b0e5c301")
"""Ids of simulated hosts and machines are made in it, so that the same input gives the same bytes."""


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
    if others or data.count(b"\n") != 1:
        raise NotDecodable("", "it is not the one line that rarms wrote")
    return decode(Content, record)
