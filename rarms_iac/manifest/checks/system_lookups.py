"""What several checks look up in a `System`: who may run where, and who shares a partition or an operating system."""

from collections.abc import Callable, Iterable, Iterator

from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.model.quantities import LogicalProcessors, in_processors
from rarms_iac.model.system import (
    Component,
    CpuRequest,
    Measured,
    PartitionRequest,
    RunsOn,
    System,
    TaskRequest,
    bound_together,
)
from rarms_iac.model.task_names import ROBOTIC_TASKS

_NOTHING_FIXED = CpuRequest()


def allowed_hosts(system: System, component: Component) -> list[Host]:
    """Return the hosts of the manifest that the component itself allows."""
    if component.hosts is None:
        return list(system.hosts.values())
    return [system.hosts[name] for name in component.hosts if name in system.hosts]


def members(system: System, partition: PartitionRequest) -> list[Component]:
    """Return the partition's components, each once, those that exist."""
    return [system.components[name] for name in dict.fromkeys(partition.components) if name in system.components]


def hosts_for(system: System, components: Iterable[Component]) -> list[Host]:
    """Return the hosts that every one of the components allows."""
    allowed = [{host.name for host in allowed_hosts(system, component)} for component in components]
    return [host for host in system.hosts.values() if all(host.name in names for names in allowed)]


def partition_of_component(system: System) -> dict[str, str]:
    """Component -> the first partition whose entry lists it; components without an entry are not in it."""
    partitions: dict[str, str] = {}
    for partition in system.partitions.values():
        for name in partition.components:
            partitions.setdefault(name, partition.name)
    return partitions


def partition_names(system: System) -> set[str]:
    """Every partition that the manifest wants: those with an entry, and one each for the components without."""
    listed = partition_of_component(system)
    own = {
        component.name
        for component in system.components.values()
        if component.runs_on is RunsOn.PARTITION and component.name not in listed
    }
    return own | set(system.partitions)


def bound_groups(system: System) -> list[list[Component]]:
    """Components without a partition's entry that `together` binds to others, each group sorted by name."""
    listed = partition_of_component(system)
    groups: dict[str, list[Component]] = {}
    for name, group in sorted(bound_together(system.components).items()):
        if name not in listed:
            groups.setdefault(group, []).append(system.components[name])
    return [group for group in groups.values() if len(group) > 1]


def operating_systems(system: System) -> Iterator[list[Component]]:
    """Yield the components that are sure to share one operating system: of one partition, or on one host itself."""
    for partition in system.partitions.values():
        yield members(system, partition)
    yield from bound_groups(system)
    if len(system.hosts) == 1:
        yield [component for component in system.components.values() if component.runs_on is RunsOn.HOST]


def task_entry(system: System, name: str) -> TaskRequest | None:
    """Return the entry of a task class in `tasks`; classes are compared without case."""
    return system.tasks.get(name) or next(
        (task for key, task in system.tasks.items() if key.lower() == name.lower()), None
    )


def known_tasks(system: System) -> list[str]:
    """Return the classes that a component may name: the manifest's own and the robotic ones."""
    return [*system.tasks, *(name for name in ROBOTIC_TASKS if name not in system.tasks)]


def fixed_reserve(cpu: CpuRequest, host: Host) -> LogicalProcessors | None:
    """Return the reserve in LPs of that host, where the manifest fixes one."""
    if cpu.reserve is None or isinstance(cpu.reserve, Measured):
        return None
    return in_processors(cpu.reserve, host.logical_processors)


def cpu_settings(system: System) -> Iterator[tuple[str, str, CpuRequest, list[Host]]]:
    """Section, name, CPU and possible hosts of every component and partition for which the manifest fixes CPU."""
    for component in system.components.values():
        if component.cpu != _NOTHING_FIXED:
            yield "components", component.name, component.cpu, allowed_hosts(system, component)
    for partition in system.partitions.values():
        if partition.cpu != _NOTHING_FIXED:
            yield "partitions", partition.name, partition.cpu, hosts_for(system, members(system, partition))


def on_every(hosts: list[Host], holds: Callable[[Host], bool]) -> bool:
    """Whether there is a host at all and it holds on all of them: then no other host avoids the problem."""
    return bool(hosts) and all(map(holds, hosts))


def behaves_like_hyperv(host: Host) -> bool:
    """Whether the host takes what Hyper-V takes: the simulated host refuses what Hyper-V refuses."""
    return host.provider in {ProviderKind.HYPERV, ProviderKind.SIMULATED}
