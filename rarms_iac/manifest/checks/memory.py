"""Checks of the memory of partitions."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import (
    Violation,
    behaves_like_hyperv,
    hosts_for,
    may_run_on,
    members,
    partition_of_component,
)
from rarms_iac.model.diagnostics import Finding
from rarms_iac.model.host import Host
from rarms_iac.model.quantities import LEAST_MEMORY, MEMORY_GRAIN, machine_memory, show_bytes
from rarms_iac.model.system import RunsOn, System
from rarms_iac.model.wording import list_names

BELOW_MEMBERS = Finding.warning("RARMS065", "A partition has less memory than its components")
MEMORY_OVER_HOST = Finding.error("RARMS066", "More memory than any host has")
NOT_A_MACHINES = Finding.error("RARMS067", "Memory that Hyper-V does not take")


_MEBIBYTE = 2**20


def partition_memory_below_members(system: System) -> Iterator[Violation]:
    """Partitions whose own memory is less than the sum of their components'."""
    for partition in system.partitions.values():
        inside = members(system, partition)
        needed = sum(component.memory for component in inside)
        if partition.memory is not None and partition.memory < needed:
            each = list_names(f"{component.name} {show_bytes(component.memory)}" for component in inside)
            yield Violation(
                path=("partitions", partition.name, "memory"),
                detail=f'"{partition.name}" has {show_bytes(partition.memory)}, but its components need '
                f"{show_bytes(needed)} ({each}).",
                advice="Raise the memory, or remove it: the partition then gets the sum.",
            )


def memory_over_host(system: System) -> Iterator[Violation]:
    """Partitions whose memory is above that of every possible host less what is kept for it."""
    for section, name, memory, hosts in _memory_of_partitions(system):
        if hosts and all(memory > _memory_for_partitions(host) for host in hosts):
            largest = max(hosts, key=lambda host: (_memory_for_partitions(host), host.name))
            yield Violation(
                path=(section, name, "memory"),
                detail=f'"{name}" needs {show_bytes(memory)}, but "{largest.name}" has '
                f"{show_bytes(max(0, _memory_for_partitions(largest)))} for partitions.",
                advice="Lower the memory, keep less for the host, or allow a larger host.",
            )


def memory_not_a_machines(system: System) -> Iterator[Violation]:
    """Memory on a host like Hyper-V that is too little for a machine, or no even number of MiB."""
    for section, name, memory, hosts in _memory_of_partitions(system):
        up = machine_memory(memory)
        if memory != up and any(map(behaves_like_hyperv, hosts)):
            down = up - MEMORY_GRAIN
            less = f" or {down // _MEBIBYTE} MiB" if down >= LEAST_MEMORY else ""
            yield Violation(
                path=(section, name, "memory"),
                detail=f'"{name}" has {show_bytes(memory)}, but Hyper-V takes an even number of MiB, at least '
                f"{show_bytes(LEAST_MEMORY)}.",
                advice=f"Write {up // _MEBIBYTE} MiB{less}.",
            )


def _memory_for_partitions(host: Host) -> int:
    return host.memory - host.keep_for_host.memory


def _memory_of_partitions(system: System) -> Iterator[tuple[str, str, int, list[Host]]]:
    """Section, name, bytes and possible hosts of every partition."""
    listed = partition_of_component(system)
    for component in system.components.values():
        if component.name not in listed and component.runs_on is RunsOn.PARTITION:
            yield "components", component.name, component.memory, may_run_on(system, component)
    for partition in system.partitions.values():
        inside = members(system, partition)
        if partition.components and not inside and partition.memory is None:
            continue  # RARMS042 reports that its components do not exist
        memory = sum(component.memory for component in inside) if partition.memory is None else partition.memory
        yield "partitions", partition.name, memory, hosts_for(system, inside)
