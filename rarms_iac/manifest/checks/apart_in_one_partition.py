"""A partition keeps `apart`."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import members
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Related, Severity
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS051", severity=Severity.ERROR, summary="Components that are apart share a partition")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of members of one partition that are apart from each other."""
    for partition in system.partitions.values():
        inside = {member.name for member in members(system, partition)}
        for component in members(system, partition):
            for number, other in enumerate(component.apart):
                if other in inside and other != component.name:
                    yield FINDING.at(
                        places.value("components", component.name, "apart", number),
                        f'"{component.name}" wants to be apart from "{other}", and the partition '
                        f'"{partition.name}" holds both.',
                        "Move one of the two to another partition, or remove the wish.",
                        address=f"component/{component.name}",
                        related=(
                            Related(
                                place=places.value("partitions", partition.name, "components"), says="both are here"
                            ),
                        ),
                    )
