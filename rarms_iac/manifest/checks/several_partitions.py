"""A component is in one partition."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import entry_of
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Related, Severity
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS045", severity=Severity.ERROR, summary="A component is in several partitions")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of every partition but the first that lists a component."""
    first = entry_of(system)
    for partition in system.partitions.values():
        for number, name in enumerate(partition.components):
            seen = partition.components.index(name)
            if name in system.components and (first[name] != partition.name or seen < number):
                yield FINDING.at(
                    places.value("partitions", partition.name, "components", number),
                    f'"{name}" is already in the partition "{first[name]}"; it runs once.',
                    "Leave it in one of them.",
                    address=f"partition/{partition.name}",
                    related=(_first(places, first[name], system.partitions[first[name]].components.index(name)),),
                )


def _first(places: Places, partition: str, number: int) -> Related:
    return Related(place=places.value("partitions", partition, "components", number), says="listed here first")
