"""Virtual NUMA is off when dynamic memory is on (FACTS 2)."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination, address_of, called
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity

FINDING = Finding(code="RARMS237", severity=Severity.WARNING, summary="Dynamic memory turns virtual NUMA off")


def check(host: Examination) -> Iterator[Diagnostic]:
    """Tells of machines with dynamic memory on a host of several nodes."""
    nodes = host.condition.numa_nodes or 1
    for machine, _ in host.machines():
        if nodes > 1 and machine.settings.dynamic_memory:
            yield FINDING.at(
                host.place,
                f"{called(machine)} has dynamic memory, and {host.state.facts.name} has {nodes} NUMA nodes: its guest "
                "does not see them, and its memory may lie on a node far from its processors.",
                "Give it static memory: `Set-VMMemory -DynamicMemoryEnabled $false`, while it is off. Partitions of "
                "rarms have static memory.",
                address=address_of(machine),
            )
