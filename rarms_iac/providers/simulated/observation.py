"""What a look at a simulated host gives: the State that its content and its description in the manifest make. Pure."""

import re
from collections.abc import Iterable, Mapping

from rarms_iac.model.capacity import core_sharing
from rarms_iac.model.host import Host, SimulatedHost
from rarms_iac.model.state import Disk, HostFacts, Partition, Rights, State, TaskClass
from rarms_iac.providers.marks import with_marks
from rarms_iac.providers.simulated.content import FRESH, SHIPPED, Content

DISK_FOLDER = "C:\\disks"
"""The folder of a simulated host's disks, as its facts name it."""

_PENDING = re.compile(r"(?P<partition>[a-z0-9-]+)\.rarms-[0-9a-f]+")


def to_state(content: Content, host: Host, serials: Mapping[str, int]) -> State:
    """Return the State that an observation shows: without the rights, no machines and no guests (windows.md 5)."""
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
    """Return the virtual disks, where machines may be seen."""
    return content.disks if facts.rights is Rights.PROVEN else ()


def partitions_of(content: Content, host: Host) -> tuple[Partition, ...]:
    """Return the machines by name, then id, with the marks that count."""
    sharing, build = core_sharing(facts_of(content, host)), description(host).guest_windows_build
    return with_marks(
        (
            Partition(
                settings=machine.settings, id=machine.id, state=machine.state, sharing=sharing, guest_build=build
            ),
            machine.notes,
        )
        for machine in content.machines.values()
    )


def tasks_of(content: Content, partitions: Iterable[Partition]) -> tuple[TaskClass, ...]:
    """Return the task classes of the host, and those in the guests of these partitions if rarms made them."""
    guests = sorted((inside, partition.id) for partition in partitions if (inside := stands_for(partition)))
    return tuple(task for inside, machine in [("", ""), *guests] for task in _tasks(content, inside, machine))


def facts_of(content: Content, host: Host) -> HostFacts:
    """Return the facts of the host that decisions rest on, as the manifest describes it now."""
    described = description(host)
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


def description(host: Host) -> SimulatedHost:
    """Return the machine that the host pretends to be."""
    return host.settings if isinstance(host.settings, SimulatedHost) else SimulatedHost()


def stands_for(partition: Partition) -> str:
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
