"""What several checks ask of a System; nothing here tells anything."""

from collections.abc import Callable, Iterable, Iterator

from rarms_iac.model.names import ROBOTIC_TASKS
from rarms_iac.model.quantities import LogicalProcessors, in_processors
from rarms_iac.model.system import (
    Component,
    CpuWish,
    Host,
    Measured,
    PartitionWish,
    ProviderKind,
    RunsOn,
    System,
    TaskWish,
)

SHOWN = 4


def some(names: Iterable[str]) -> str:
    """`a`, `a and b`, `a, b and c`; of many the first few and how many more."""
    known = list(names)
    if len(known) > SHOWN + 1:
        return f"{', '.join(known[:SHOWN])} and {len(known) - SHOWN} more"
    return " and ".join([", ".join(known[:-1]), known[-1]]) if len(known) > 1 else "".join(known)


def may_run_on(system: System, component: Component) -> list[Host]:
    """The hosts of the manifest that the component itself allows."""
    if component.hosts is None:
        return list(system.hosts.values())
    return [system.hosts[name] for name in component.hosts if name in system.hosts]


def members(system: System, partition: PartitionWish) -> list[Component]:
    """The partition's components, each once, those that exist."""
    return [system.components[name] for name in dict.fromkeys(partition.components) if name in system.components]


def hosts_for(system: System, components: Iterable[Component]) -> list[Host]:
    """The hosts that every one of the components allows."""
    allowed = [{host.name for host in may_run_on(system, component)} for component in components]
    return [host for host in system.hosts.values() if all(host.name in names for names in allowed)]


def entry_of(system: System) -> dict[str, str]:
    """Component -> the first partition whose entry lists it."""
    entries: dict[str, str] = {}
    for partition in system.partitions.values():
        for name in partition.components:
            entries.setdefault(name, partition.name)
    return entries


def partition_names(system: System) -> set[str]:
    """Every partition that the manifest wants: those with an entry, and one each for the components without."""
    listed = entry_of(system)
    own = {
        component.name
        for component in system.components.values()
        if component.runs_on is RunsOn.PARTITION and component.name not in listed
    }
    return own | set(system.partitions)


def companions(system: System) -> dict[str, str]:
    """Component -> a name that all have in common that `together` binds, however many steps apart."""
    root = {name: name for name in system.components}

    def find(name: str) -> str:
        while root[name] != name:
            root[name] = root[root[name]]
            name = root[name]
        return name

    for component in system.components.values():
        for other in component.together:
            if other in root:
                first, second = sorted((find(component.name), find(other)))
                root[second] = first
    return {name: find(name) for name in system.components}


def operating_systems(system: System) -> Iterator[list[Component]]:
    """The components that are sure to share one operating system: of one partition, or on one host itself."""
    for partition in system.partitions.values():
        yield members(system, partition)
    listed = entry_of(system)
    bound: dict[str, list[Component]] = {}
    for name, group in companions(system).items():
        if name not in listed:
            bound.setdefault(group, []).append(system.components[name])
    yield from (group for group in bound.values() if len(group) > 1)
    if len(system.hosts) == 1:
        yield [component for component in system.components.values() if component.runs_on is RunsOn.HOST]


def task_wish(system: System, name: str) -> TaskWish | None:
    """The entry of a task class; classes are compared without case."""
    return system.tasks.get(name) or next(
        (task for key, task in system.tasks.items() if key.lower() == name.lower()), None
    )


def known_tasks(system: System) -> list[str]:
    """The classes that a component may name: the manifest's own and the robotic ones."""
    return [*system.tasks, *(name for name in ROBOTIC_TASKS if name not in system.tasks)]


def fixed_reserve(cpu: CpuWish, host: Host) -> LogicalProcessors | None:
    """The reserve in LPs of that host, where the manifest fixes one."""
    if cpu.reserve is None or isinstance(cpu.reserve, Measured):
        return None
    return in_processors(cpu.reserve, host.logical_processors)


def wishes(system: System) -> Iterator[tuple[str, str, CpuWish, list[Host]]]:
    """Section, name, CPU and possible hosts of every component and partition whose CPU the manifest speaks of."""
    for component in system.components.values():
        if component.cpu != _NOTHING:
            yield "components", component.name, component.cpu, may_run_on(system, component)
    for partition in system.partitions.values():
        if partition.cpu != _NOTHING:
            yield "partitions", partition.name, partition.cpu, hosts_for(system, members(system, partition))


def on_every(hosts: list[Host], holds: Callable[[Host], bool]) -> bool:
    """Whether there is a host at all and it holds on all of them: then no other host saves the wish."""
    return bool(hosts) and all(map(holds, hosts))


def address(section: str, name: str) -> str:
    """`components`, `vision` -> `component/vision`, as `policy.accept` names it."""
    return f"{section.removesuffix('s')}/{name}"


def behaves_like_hyperv(host: Host) -> bool:
    """Whether the host takes what Hyper-V takes: the simulated one refuses what Hyper-V refuses."""
    return host.provider in {ProviderKind.HYPERV, ProviderKind.SIMULATED}


_NOTHING = CpuWish()
