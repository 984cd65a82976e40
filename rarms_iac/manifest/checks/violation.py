"""What a check is, what it reports, and what several checks ask of a system."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain

from rarms_iac.model.commands import Wording
from rarms_iac.model.diagnostics import Diagnostic, Place, Places, Related
from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.model.names import ROBOTIC_TASKS
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
from rarms_iac.texts.findings import Finding, Given

Path = tuple[str | int, ...]

_ADDRESSED = ("hosts", "components", "partitions", "interference", "tasks")


Violation = Callable[[Finding, Places], Diagnostic]
"""One case of a check, to be made a finding of its kind with its places in the manifest's text."""


def violation(
    path: Path,
    template: str,
    advice: Wording,
    *,
    at_key: bool = False,
    address: str | None = None,
    related: tuple[tuple[Path, bool, str], ...] = (),
    **facts: Given,
) -> Violation:
    """Return one case of a check; places are looked up only for those that are shown.

    Args:
        path: Where in the manifest. The host, component, ... that it leads into is a fact under that name.
        at_key: The place is the key of the path, not its value.
        address: As `policy.accept` names it; None: the host, component, ... that the path leads into.
        related: Other paths, whether their key is meant, and a label.
    """

    def case(finding: Finding, places: Places) -> Diagnostic:
        return finding.at(
            _place(places, path, at_key),
            template,
            advice,
            address=next((f"{kind}/{name}" for kind, name in _owner(path).items()), "") if address is None else address,
            related=tuple(Related(place=_place(places, other, key), message=label) for other, key, label in related),
            **{**_owner(path), **facts},
        )

    return case


Check = Callable[[System], Iterator[Violation]]
"""A check yields every violation that it finds; it judges only what no other check judges."""

CHECKS: list[tuple[Finding, Check]] = []
"""Every check that asks the manifest alone, with its finding, as the modules of this room add them."""


def check(finding: Finding) -> Callable[[Check], Check]:
    """Add the function below to `CHECKS`: it yields the violations of this kind."""

    def add(judge: Check) -> Check:
        CHECKS.append((finding, judge))
        return judge

    return add


def component_check(finding: Finding) -> Callable[[Callable[[Component], Iterator[Violation]]], Check]:
    """Add the function below to `CHECKS`, to be asked for each component of a system."""
    return lambda judge: check(finding)(lambda system: chain.from_iterable(map(judge, system.components.values())))


def host_check(finding: Finding) -> Callable[[Callable[[Host], Iterator[Violation]]], Check]:
    """Add the function below to `CHECKS`, to be asked for each host of a system."""
    return lambda judge: check(finding)(lambda system: chain.from_iterable(map(judge, system.hosts.values())))


def partition_check(finding: Finding) -> Callable[[Callable[[System, PartitionRequest], Iterator[Violation]]], Check]:
    """Add the function below to `CHECKS`, to be asked for each entry of `partitions`, with the system it stands in."""
    return lambda judge: check(finding)(
        lambda system: chain.from_iterable(judge(system, partition) for partition in system.partitions.values())
    )


def _place(places: Places, path: Path, at_key: bool) -> Place:
    return places.key(*path) if at_key else places.value(*path)


def _owner(path: Path) -> Mapping[str, str]:
    """Return kind and name of the entry that a path leads into: `components, vision, cpu` -> `component: vision`."""
    if len(path) < 2 or path[0] not in _ADDRESSED:
        return {}
    return {str(path[0]).removesuffix("s"): str(path[1])}


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
    """Return the first partition that lists each component; unlisted components are left out."""
    partitions: dict[str, str] = {}
    for partition in system.partitions.values():
        for name in partition.components:
            partitions.setdefault(name, partition.name)
    return partitions


def partition_names(system: System) -> set[str]:
    """Return the wanted partitions: those with an entry, and one for each component without."""
    listed = partition_of_component(system)
    own = {
        component.name
        for component in system.components.values()
        if component.runs_on is RunsOn.PARTITION and component.name not in listed
    }
    return own | set(system.partitions)


def bound_groups(system: System) -> list[list[Component]]:
    """Group components that `together` binds outside partition entries, each group sorted by name."""
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
    """Yield section, name, CPU and possible hosts of what the manifest fixes CPU for."""
    for component in system.components.values():
        if component.cpu != _NOTHING_FIXED:
            yield "components", component.name, component.cpu, allowed_hosts(system, component)
    for partition in system.partitions.values():
        if partition.cpu != _NOTHING_FIXED:
            yield "partitions", partition.name, partition.cpu, hosts_for(system, members(system, partition))


def on_every(hosts: list[Host], holds: Callable[[Host], bool]) -> bool:
    """Return whether there are hosts and it holds on all of them: then no other host avoids the problem."""
    return bool(hosts) and all(map(holds, hosts))


def behaves_like_hyperv(host: Host) -> bool:
    """Return whether the host takes the same settings as Hyper-V; the simulated host does."""
    return host.provider in {ProviderKind.HYPERV, ProviderKind.SIMULATED}
