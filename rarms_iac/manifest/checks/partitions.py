"""Checks of partitions: which components share one, on which host they can be together, and how much memory it has."""

from collections.abc import Iterator, Mapping, Sequence

from rarms_iac.manifest.checks.hosts import TOO_LITTLE
from rarms_iac.manifest.checks.names import KEPT_NAME
from rarms_iac.manifest.checks.violation import (
    Path,
    Violation,
    allowed_hosts,
    behaves_like_hyperv,
    bound_groups,
    check,
    component_check,
    hosts_for,
    members,
    partition_check,
    partition_of_component,
    violation,
)
from rarms_iac.model.host import Host
from rarms_iac.model.quantities import LEAST_MEMORY, MEMORY_GRAIN, machine_memory
from rarms_iac.model.system import Component, PartitionRequest, RunsOn, System, bound_together
from rarms_iac.texts.findings import OVER_HOST, WRONG_VALUE, Finding
from rarms_iac.texts.messages import list_names, list_others
from rarms_iac.texts.quantities import write_bytes

ON_HOST = Finding.error("RARMS046", "A component that runs on the host has partition settings")

CONTRADICTION = Finding.error("RARMS049", "The rules for sharing a partition contradict each other")


_MEBIBYTE = 2**20


@check(CONTRADICTION)
def several_partitions(system: System) -> Iterator[Violation]:
    """Find every partition but the first that lists a component."""
    listed: dict[str, Path] = {}
    for partition in system.partitions.values():
        for number, name in enumerate(partition.components):
            path = ("partitions", partition.name, "components", number)
            first = listed.setdefault(name, path)
            if name in system.components and first != path:
                yield violation(
                    path,
                    '"{component}" is already in the partition "{_first}". A component can be in only one partition.',
                    "Keep it in one of the two partitions.",
                    related=((first, False, "listed here first"),),
                    component=name,
                    partitions=(str(first[1]), partition.name),
                    _first=first[1],
                )


@check(ON_HOST)
def host_component_in_partition(system: System) -> Iterator[Violation]:
    """Find partitions, and `together`, that name a component with `runs_on: host`."""
    on_host = {component.name for component in system.components.values() if component.runs_on is RunsOn.HOST}
    for partition in system.partitions.values():
        for number, name in enumerate(partition.components):
            if name in on_host:
                yield _host_component_violation(("partitions", partition.name, "components", number), name)
    for component in system.components.values():
        for number, name in enumerate(component.together):
            if name in on_host and component.runs_on is RunsOn.PARTITION:
                yield _host_component_violation(("components", component.name, "together", number), name)


def _host_component_violation(path: Path, name: str) -> Violation:
    return violation(
        path,
        '"{component}" has `runs_on: host`: it runs in the operating system of the host, not in a partition.',
        f'Remove "{name}" here, or remove its `runs_on`.',
        component=name,
    )


@component_check(ON_HOST)
def host_component_with_cpu(component: Component) -> Iterator[Violation]:
    """Find `runs_on: host` with a reserve, limit, weight, `processors`, `dedicated` or `together`."""
    if component.runs_on is RunsOn.HOST:
        for path, is_set in _partition_settings(component):
            if is_set:
                yield violation(
                    ("components", component.name, *path),
                    '"{component}" runs on the host itself. It has no partition, so `{key}` has no effect.',
                    f"Remove `{'.'.join(path)}`, or remove `runs_on: host`.",
                    key=".".join(path),
                )


def _partition_settings(component: Component) -> Iterator[tuple[tuple[str, ...], bool]]:
    """Yield the path of each setting that only a partition has, and whether the component has it."""
    yield ("cpu", "reserve"), component.cpu.reserve is not None
    yield ("cpu", "limit"), component.cpu.limit is not None
    yield ("cpu", "weight"), component.cpu.weight is not None
    yield ("processors",), component.processors is not None
    yield ("dedicated",), component.dedicated
    yield ("together",), bool(component.together)


@partition_check(KEPT_NAME)
def partition_of_another_name(system: System, partition: PartitionRequest) -> Iterator[Violation]:
    """Find partitions that have the name of a component that is not a member."""
    name = partition.name
    if name in system.components and name not in partition.components:
        yield violation(
            ("partitions", name),
            'The partition "{partition}" does not contain the component "{partition}". This name is misleading.',
            f'Add "{name}" to its components, or name the partition after its most critical member.',
            at_key=True,
            component=name,
        )


@check(CONTRADICTION)
def together_and_apart(system: System) -> Iterator[Violation]:
    """Find components with `apart` from one that `together` binds to them, directly or by others."""
    bound = _bound(system)
    for component in system.components.values():
        for number, other in enumerate(component.apart):
            if bound.get(other) is bound[component.name]:
                yield violation(
                    ("components", component.name, "apart", number),
                    _contradiction(system, component, other),
                    "Remove `together` or `apart`.",
                    other=other,
                    bound=tuple(bound[other]),
                    _between=list_others(bound[other], (component.name, other)) if len(bound[other]) > 2 else "",
                )


@component_check(CONTRADICTION)
def together_with_itself(component: Component) -> Iterator[Violation]:
    """Yield a component that `together` binds to itself: another was probably meant."""
    for number, other in enumerate(component.together):
        if other == component.name:
            yield violation(
                ("components", component.name, "together", number),
                '"{component}" is always together with itself.',
                "Name another component, or remove this entry of `together`.",
                component=other,
            )


def _bound(system: System) -> dict[str, list[str]]:
    """Return for each component all that `together` binds, including itself, by name; they share one list."""
    groups: dict[str, list[str]] = {}
    first = bound_together(system.components)
    for name in sorted(first):
        groups.setdefault(first[name], []).append(name)
    return {name: groups[first[name]] for name in first}


def _contradiction(system: System, component: Component, other: str) -> str:
    if component.name == other:
        return '"{component}" cannot be apart from itself.'
    is_direct = other in component.together or component.name in system.components[other].together
    chain = "" if is_direct else " through {_between}"
    return f'"{{component}}" must be apart from "{{other}}", but `together` binds the two{chain}.'


@check(CONTRADICTION)
def dedicated_shares(system: System) -> Iterator[Violation]:
    """Find dedicated components that `together` or a partition's entry puts together with others."""
    bound = _bound(system)
    for name, component in system.components.items():
        if component.dedicated and len(bound[name]) > 1:
            yield _dedicated_violation(name, bound[name], f"`together` binds it to {list_others(bound[name], (name,))}")
    for partition in system.partitions.values():
        components = members(system, partition)
        names = [component.name for component in components]
        for component in components:
            if component.dedicated and len(components) > 1:
                others = list_others(names, (component.name,))
                reason = f'the partition "{partition.name}" also contains {others}'
                yield _dedicated_violation(component.name, names, reason)


def _dedicated_violation(name: str, members: Sequence[str], reason: str) -> Violation:
    return violation(
        ("components", name, "dedicated"),
        '"{component}" is dedicated: it must be alone in its partition, but {_reason}.',
        "Remove `dedicated`, or leave the component alone in its partition.",
        members=tuple(members),
        _reason=reason,
    )


@partition_check(CONTRADICTION)
def apart_in_one_partition(system: System, partition: PartitionRequest) -> Iterator[Violation]:
    """Find members of one partition that are apart from each other."""
    components = members(system, partition)
    names = {component.name for component in components}
    for component in components:
        for number, other in enumerate(component.apart):
            if other in names and other != component.name:
                yield violation(
                    ("components", component.name, "apart", number),
                    '"{component}" must be apart from "{other}", but the partition "{partition}" contains both.',
                    "Move one of the two to another partition, or remove `apart`.",
                    related=((("partitions", partition.name, "components"), False, "contains both"),),
                    other=other,
                    partition=partition.name,
                )


@check(CONTRADICTION)
def together_is_separated(system: System) -> Iterator[Violation]:
    """Find components bound by `together` of which one has an entry and the other is elsewhere."""
    listed = partition_of_component(system)
    for component in system.components.values():
        for number, name in enumerate(component.together):
            other = system.components.get(name)
            if other is None or not (component.runs_on is other.runs_on is RunsOn.PARTITION):
                continue  # RARMS042 and RARMS046 report these
            if listed.get(component.name) != listed.get(name):
                yield violation(
                    ("components", component.name, "together", number),
                    '"{component}" must be together with "{other}", but {_this_one}, and {_other_one}.',
                    "List both in one partition, or remove `together`.",
                    other=name,
                    partitions=tuple(listed[each] for each in (component.name, name) if each in listed),
                    _this_one=_location(component.name, listed),
                    _other_one=_location(name, listed),
                )


def _location(name: str, listed: Mapping[str, str]) -> str:
    return f'"{name}" is in the partition "{listed[name]}"' if name in listed else f'no partition lists "{name}"'


@check(CONTRADICTION)
def no_common_host(system: System) -> Iterator[Violation]:
    """Find partitions, and `together`, whose components allow no common host."""
    for partition in system.partitions.values():
        components = members(system, partition)
        if components and _have_no_common_host(system, components):
            yield _no_common_host_violation(system, ("partitions", partition.name, "components"), components)
    for group in bound_groups(system):
        components = sorted(group, key=lambda component: (not component.together, component.name))
        if _have_no_common_host(system, components):
            yield _no_common_host_violation(system, ("components", components[0].name, "together"), components)


def _have_no_common_host(system: System, components: list[Component]) -> bool:
    return all(allowed_hosts(system, component) for component in components) and not hosts_for(system, components)


def _no_common_host_violation(system: System, path: Path, components: list[Component]) -> Violation:
    each = list_names(
        f"{component.name} on {list_names(host.name for host in allowed_hosts(system, component))}"
        for component in components
    )
    return violation(
        path,
        "These components share a partition, but no host is allowed for all of them: {_each}.",
        "Allow a common host in `hosts` of each, or put them into different partitions.",
        components=tuple(component.name for component in components),
        _each=each,
    )


@partition_check(TOO_LITTLE)
def partition_memory_below_members(system: System, partition: PartitionRequest) -> Iterator[Violation]:
    """Find partitions whose own memory is less than the sum of their components'."""
    components = members(system, partition)
    needed = sum(component.memory for component in components)
    if partition.memory is not None and partition.memory < needed:
        each = list_names(f"{component.name} {write_bytes(component.memory)}" for component in components)
        yield violation(
            ("partitions", partition.name, "memory"),
            '"{partition}" has {has_memory:bytes}, but its components need {needs_memory:bytes} ({_each}).',
            "Raise `memory`, or remove it to use the sum.",
            has_memory=partition.memory,
            needs_memory=needed,
            _each=each,
        )


@check(OVER_HOST)
def memory_over_host(system: System) -> Iterator[Violation]:
    """Find partitions with more memory than every possible host has without what is kept for it."""
    for section, name, memory, hosts in _memory_of_partitions(system):
        if hosts and all(memory > _memory_for_partitions(host) for host in hosts):
            largest = max(hosts, key=lambda host: (_memory_for_partitions(host), host.name))
            if _memory_for_partitions(largest) < 0:
                continue  # RARMS061 says so at the hosts
            yield violation(
                (section, name, "memory"),
                '"{name}" needs {needs_memory:bytes}, but "{host}" has {has_memory:bytes} for partitions.',
                "Lower the memory, keep less for the host, or allow a larger host.",
                needs_memory=memory,
                host=largest.name,
                has_memory=_memory_for_partitions(largest),
                name=name,
            )


@check(WRONG_VALUE)
def memory_not_of_hyperv(system: System) -> Iterator[Violation]:
    """Find memory that a host like Hyper-V refuses: too little, or an odd number of MiB."""
    for section, name, memory, hosts in _memory_of_partitions(system):
        up = machine_memory(memory)
        if memory != up and any(map(behaves_like_hyperv, hosts)):
            down = up - MEMORY_GRAIN
            less = f" or {down // _MEBIBYTE} MiB" if down >= LEAST_MEMORY else ""
            yield violation(
                (section, name, "memory"),
                '"{name}" has {has_memory:bytes}, but Hyper-V needs an even number of MiB, at least {_least:bytes}.',
                f"Write {up // _MEBIBYTE} MiB{less}.",
                has_memory=memory,
                fits_memory_bytes=up,
                name=name,
                _least=LEAST_MEMORY,
            )


def _memory_for_partitions(host: Host) -> int:
    return host.memory - host.keep_for_host.memory


def _memory_of_partitions(system: System) -> Iterator[tuple[str, str, int, list[Host]]]:
    """Yield section, name, bytes and possible hosts of every partition."""
    listed = partition_of_component(system)
    for component in system.components.values():
        if component.name not in listed and component.runs_on is RunsOn.PARTITION:
            yield "components", component.name, component.memory, allowed_hosts(system, component)
    for partition in system.partitions.values():
        components = members(system, partition)
        if partition.components and not components and partition.memory is None:
            continue  # RARMS042 reports that its components do not exist
        memory = sum(component.memory for component in components) if partition.memory is None else partition.memory
        yield "partitions", partition.name, memory, hosts_for(system, components)
