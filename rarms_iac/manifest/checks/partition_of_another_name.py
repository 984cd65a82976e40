"""A partition is not called after a stranger."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import System

FINDING = Finding(
    code="RARMS047", severity=Severity.ERROR, summary="A partition bears the name of a component that is not in it"
)


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of partitions that are called like a component which is no member."""
    for partition in system.partitions.values():
        name = partition.name
        if name in system.components and name not in partition.components:
            yield FINDING.at(
                places.key("partitions", name),
                f'There is a component "{name}", and the partition of that name does not hold it. Whoever reads '
                "the name would look for the component there.",
                f'Add "{name}" to its components, or call the partition after its most critical member.',
                address=f"partition/{name}",
            )
