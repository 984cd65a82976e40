"""Some host has the memory of each partition."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import address, entry_of, hosts_for, may_run_on, members
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.quantities import show_bytes
from rarms_iac.model.system import Host, RunsOn, System

FINDING = Finding(code="RARMS066", severity=Severity.ERROR, summary="Memory that no host has")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of partitions whose memory is above that of every possible host less what is kept for it."""
    for section, name, memory, hosts in wanted_memory(system):
        if hosts and all(memory > host.memory - host.keep_for_host.memory for host in hosts):
            largest = max(hosts, key=lambda host: (host.memory - host.keep_for_host.memory, host.name))
            yield FINDING.at(
                places.value(section, name, "memory"),
                f'"{name}" needs {show_bytes(memory)}, and "{largest.name}" has '
                f"{show_bytes(max(0, largest.memory - largest.keep_for_host.memory))} for partitions.",
                "Lower the memory, keep less for the host, or allow a larger host.",
                address=address(section, name),
            )


def wanted_memory(system: System) -> Iterator[tuple[str, str, int, list[Host]]]:
    """Section, name, bytes and possible hosts of every partition."""
    listed = entry_of(system)
    for component in system.components.values():
        if component.name not in listed and component.runs_on is RunsOn.PARTITION:
            yield "components", component.name, component.memory, may_run_on(system, component)
    for partition in system.partitions.values():
        inside = members(system, partition)
        memory = sum(one.memory for one in inside) if partition.memory is None else partition.memory
        yield "partitions", partition.name, memory, hosts_for(system, inside)
