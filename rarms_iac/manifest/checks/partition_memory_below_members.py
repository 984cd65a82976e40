"""A partition has memory for all its members."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import members, some
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.quantities import show_bytes
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS065", severity=Severity.WARNING, summary="A partition has less memory than its components")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of partitions whose own memory is less than the sum of their components'."""
    for partition in system.partitions.values():
        inside = members(system, partition)
        needed = sum(component.memory for component in inside)
        if partition.memory is not None and partition.memory < needed:
            each = some(f"{component.name} {show_bytes(component.memory)}" for component in inside)
            yield FINDING.at(
                places.value("partitions", partition.name, "memory"),
                f'"{partition.name}" has {show_bytes(partition.memory)}, and its components ask for '
                f"{show_bytes(needed)} ({each}).",
                "Raise it, or remove it: the partition then gets the sum.",
                address=f"partition/{partition.name}",
            )
