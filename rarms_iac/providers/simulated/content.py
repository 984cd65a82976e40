"""The content of a simulated host (its machines and the registries of its operating systems), its file and its State.

The machine itself (processors, memory, build, scheduler, rights) is described by the manifest each time; this is what
was done to it since. The file is one JSON object: `format`, `checksum` (SHA-256 of the text of `content`) and
`content`. What is not exactly as it was written is damaged, and is never taken for something else. Pure.
"""

import hashlib
import re
import uuid
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

from rarms_iac.model.capacity import core_sharing
from rarms_iac.model.host import Host, SimulatedHost
from rarms_iac.model.mmcss import USUAL
from rarms_iac.model.quantities import LEAST_MEMORY, MEMORY_GRAIN, show_bytes
from rarms_iac.model.state import (
    Disk,
    HostFacts,
    Partition,
    PartitionSettings,
    RegistryValue,
    Responsiveness,
    Rights,
    RunState,
    State,
    TaskClass,
    TaskRecord,
    ValueKind,
)
from rarms_iac.model.wording import quoted
from rarms_iac.providers.marks import MarkReading, read_marks
from rarms_iac.storage.codec import NotDecodable, decode
from rarms_iac.storage.json_text import canonical, parse_json

NAMESPACE = uuid.UUID("6f1d3c52-8a0e-5b7c-9d44-72a1b0e5c301")
"""Ids of simulated hosts and machines are made in it, so that the same input gives the same bytes."""

FORMAT = "rarms-simulated-host/1"
DISK_FOLDER = "C:\\disks"
"""The folder of a simulated host's disks, as its facts name it."""

_HEAD = re.compile(r'\{"format":"(?P<format>[^"\\]{1,60})","checksum":"(?P<checksum>[0-9a-f]{64})","content":')
_TAIL = "}\n"
_PENDING = re.compile(r"(?P<partition>[a-z0-9-]+)\.rarms-[0-9a-f]+")

LONGEST_NAME = 100
"""Characters of a machine's name (windows.md 10)."""

MOST_PROCESSORS = {1: 64, 2: 240}
"""Virtual processors by generation (windows.md 2)."""

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
        """The same machine in this state."""
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
    """A host of this name on which nothing was ever done."""
    return Content(id=str(uuid.uuid5(NAMESPACE, f"host/{host}")))


def next_id(content: Content, name: str) -> str:
    """The id of the next machine, if it is called so."""
    return str(uuid.uuid5(uuid.UUID(content.id), f"{name}/{content.made + 1}"))


def write_content(content: Content) -> bytes:
    """The file that holds this content."""
    machines = ",".join(
        f'"{machine}":{_machine_text(content.machines[machine])}' for machine in sorted(content.machines)
    )
    others = {name: canonical(getattr(content, name)) for name in ("id", "made", "struck", "disks")}
    registries = ",".join(
        f'"{registry}":{canonical(content.registries[registry])}' for registry in sorted(content.registries)
    )
    members = {**others, "machines": f"{{{machines}}}", "registries": f"{{{registries}}}"}
    text = ",".join(f'"{name}":{member}' for name, member in sorted(members.items()))
    return _file(f"{{{text}}}")


def _file(text: str) -> bytes:
    return f'{{"format":"{FORMAT}","checksum":"{_checksum(text)}","content":{text}{_TAIL}'.encode("ascii")


@lru_cache(maxsize=10_000)  # one operation changes one machine: the others need not be written anew
def _machine_text(machine: SimulatedMachine) -> str:
    return canonical(machine)


def read_content(data: bytes) -> Content:
    """The content of the file.

    Raises:
        NotDecodable: it is not as it was written, is of another format, or holds what cannot be.
    """
    try:
        file = data.decode("ascii").replace("\r\n", "\n")
    except UnicodeDecodeError:
        raise NotDecodable("", "it is not the text that rarms wrote") from None
    head = _HEAD.match(file)
    if head is None or not file.endswith(_TAIL):
        raise NotDecodable("", "it is cut off, or was not written by rarms")
    if head["format"] != FORMAT:
        raise NotDecodable("format", f"this rarms reads {FORMAT}, not {head['format']}")
    text = file[head.end() : -len(_TAIL)]
    if head["checksum"] != _checksum(text):
        raise NotDecodable("checksum", "it does not fit the content")
    content = decode(Content, parse_json(text))
    _check(content)
    return content


def to_state(content: Content, host: Host, serials: Mapping[str, int]) -> State:
    """The State that an observation shows: without the rights, no machines and no guests (windows.md 5)."""
    facts = facts_of(content, host)
    partitions = partitions_of(content, host) if facts.rights is Rights.PROVEN else ()
    return State(
        facts=facts,
        partitions=partitions,
        tasks=tasks_of(content, partitions),
        serials=serials,
        responsiveness=content.registry("").responsiveness,
        disks=visible_disks(content, facts),
    )


def visible_disks(content: Content, facts: HostFacts) -> tuple[Disk, ...]:
    """The virtual disks, where machines may be seen."""
    return content.disks if facts.rights is Rights.PROVEN else ()


def partitions_of(content: Content, host: Host) -> tuple[Partition, ...]:
    """The machines by name, then id, with the marks that count."""
    sharing, build = core_sharing(facts_of(content, host)), description(host).guest_windows_build
    judged = read_marks({machine.id: machine.notes for machine in content.machines.values()})
    machines = sorted(content.machines.values(), key=lambda machine: (machine.settings.name, machine.id))
    return tuple(
        replace(_partition(machine, judged[machine.id]), sharing=sharing, guest_build=build) for machine in machines
    )


def tasks_of(content: Content, partitions: Iterable[Partition]) -> tuple[TaskClass, ...]:
    """The task classes of the host, and those in the guests of these partitions, where they are partitions of rarms."""
    guests = sorted((inside, partition.id) for partition in partitions if (inside := stands_for(partition)))
    return tuple(task for inside, machine in [("", ""), *guests] for task in _tasks(content, inside, machine))


def facts_of(content: Content, host: Host) -> HostFacts:
    """The facts of the host that decisions rest on, as the manifest describes it now."""
    described = description(host)
    return HostFacts(
        name=host.name,
        id=content.id,
        provider=host.provider,
        computer_name=host.name,
        os_build=described.windows_build,
        client=described.client,
        scheduler=described.scheduler,
        smt=described.smt,
        logical_processors=host.logical_processors,
        memory=int(host.memory),
        rights=Rights.PROVEN if described.administrator else Rights.MISSING,
        disk_folder=DISK_FOLDER,
    )


def description(host: Host) -> SimulatedHost:
    """The machine that the host pretends to be."""
    return host.settings if isinstance(host.settings, SimulatedHost) else SimulatedHost()


def stands_for(partition: Partition) -> str:
    """The manifest's name of a partition of rarms, also of one that is being made; empty for the machines of others."""
    if partition.mark is not None:
        return partition.mark.name
    pending = _PENDING.fullmatch(partition.settings.name)
    return pending["partition"] if pending else ""


def _checksum(text: str) -> str:
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def _partition(machine: SimulatedMachine, judged: MarkReading) -> Partition:
    return Partition(
        settings=machine.settings,
        id=machine.id,
        state=machine.state,
        mark=judged.mark,
        other_notes=judged.other_notes,
        foreign_mark=judged.foreign,
    )


def _tasks(content: Content, inside: str, machine: str) -> list[TaskClass]:
    """The task classes of one operating system by name, a record without its key included."""
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


def _check(content: Content) -> None:
    """Refuse what no series of operations could have made."""
    _check_id("id", content.id)
    for machine in content.machines.values():
        path = f"machines.{machine.id}"
        _check_id(path, machine.id)
        if content.machines.get(machine.id) is not machine:
            raise NotDecodable(path, "the machine is filed under another id")
        if problem := out_of_range(machine.settings):
            raise NotDecodable(path, problem)
        if machine.settings.running is not (machine.state is RunState.RUNNING):
            raise NotDecodable(path, "it is said to be running and not running")
    if unknown := content.registries.keys() - content.machines.keys() - {""}:
        raise NotDecodable(f"registries.{min(unknown)}", "there is no such machine")
    if content.made < len(content.machines) or any(count < 0 for count in content.struck.values()):
        raise NotDecodable("made", "a count is too small")


def _check_id(path: str, text: str) -> None:
    try:
        sound = str(uuid.UUID(text)) == text
    except ValueError:
        sound = False
    if not sound:
        raise NotDecodable(path, f"{quoted(text)} is no id")


def out_of_range(settings: PartitionSettings) -> str:
    """Describe what of the settings no machine can have; empty where all is possible (windows.md 1.1, 1.3, 2)."""
    if settings.generation not in MOST_PROCESSORS:
        return f"there is no generation {settings.generation}, only 1 and 2"
    if not 0 < len(settings.name) <= LONGEST_NAME:
        return f"a machine's name has 1 to {LONGEST_NAME} characters, not {len(settings.name)}"
    most = MOST_PROCESSORS[settings.generation]
    if not 1 <= settings.processors <= most:
        return f"generation {settings.generation} has 1 to {most} virtual processors, not {settings.processors}"
    if settings.memory < LEAST_MEMORY or settings.memory % MEMORY_GRAIN:
        least = show_bytes(LEAST_MEMORY)
        return f"a machine has an even number of MiB, at least {least}, not {show_bytes(settings.memory)}"
    return _cpu_out_of_range(settings.reserve, settings.limit, settings.weight)


def _cpu_out_of_range(reserve: int, limit: int, weight: int) -> str:
    if not 0 <= reserve <= 100 or not 0 <= limit <= 100:
        return f"reserve and limit are 0 to 100 %, not {reserve} % and {limit} %"
    if reserve > limit:
        return f"the reserve of {reserve} % is above the limit of {limit} %"
    if not 1 <= weight <= 10_000:
        return f"a weight is 1 to 10000, not {weight}"
    return ""
