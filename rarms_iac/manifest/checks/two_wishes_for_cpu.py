"""One value is asked for once."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import members
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Related, Severity
from rarms_iac.model.system import CpuWish, System

FINDING = Finding(
    code="RARMS094", severity=Severity.ERROR, summary="A partition and its only component ask for different CPU"
)


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of a reserve, limit or weight that a partition and its only component fix differently."""
    for partition in system.partitions.values():
        inside = members(system, partition)
        if len(inside) != 1:
            continue
        for key, theirs, own in _pairs(partition.cpu, inside[0].cpu):
            if theirs is not None and own is not None and theirs != own:
                yield FINDING.at(
                    places.value("partitions", partition.name, "cpu", key),
                    f'The partition "{partition.name}" and its only component fix a different {key}.',
                    "Remove one of the two.",
                    address=f"partition/{partition.name}",
                    related=(
                        Related(
                            place=places.value("components", inside[0].name, "cpu", key), says="what the component asks"
                        ),
                    ),
                )


def _pairs(partition: CpuWish, component: CpuWish) -> Iterator[tuple[str, object, object]]:
    yield "reserve", partition.reserve, component.reserve
    yield "limit", partition.limit, component.limit
    yield "weight", partition.weight, component.weight
