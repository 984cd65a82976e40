"""The file of a simulated host as its content and back, and its content as a State. Pure.

One JSON object: `format`, `checksum` (SHA-256 of the text of `content`) and `content`. What is not exactly as it was
written is damaged, and is never taken for something else.
"""

import hashlib
import re
import uuid
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache

from rarms_iac.model.capacity import core_sharing
from rarms_iac.model.host import Host, SimulatedHost
from rarms_iac.model.state import Disk, HostFacts, Partition, Rights, RunState, State, TaskClass
from rarms_iac.model.wording import quoted
from rarms_iac.providers.marks import MarkReading, read_marks
from rarms_iac.providers.simulated.content import FRESH, SHIPPED, Content, SimulatedMachine
from rarms_iac.providers.simulated.rules import out_of_range
from rarms_iac.storage.codec import NotDecodable, decode
from rarms_iac.storage.digest import canonical, parse_json

FORMAT = "rarms-simulated-host/1"
DISK_FOLDER = "C:\\disks"
"""The folder of a simulated host's disks, as its facts name it."""

_HEAD = re.compile(r'\{"format":"(?P<format>[^"\\]{1,60})","checksum":"(?P<checksum>[0-9a-f]{64})","content":')
_TAIL = "}\n"
_PENDING = re.compile(r"(?P<partition>[a-z0-9-]+)\.rarms-[0-9a-f]+")


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
