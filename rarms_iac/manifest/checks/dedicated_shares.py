"""A dedicated component is alone."""

from collections import Counter
from collections.abc import Iterator

from rarms_iac.manifest.checks.common import companions, members, some
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS050", severity=Severity.ERROR, summary="A dedicated component shares its partition")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of dedicated components that `together` or a partition's entry puts beside others."""
    group = companions(system)
    sizes = Counter(group.values())
    for component in system.components.values():
        if component.dedicated and sizes[group[component.name]] > 1:
            others = [name for name in group if group[name] == group[component.name] and name != component.name]
            yield _told(places, component.name, f"`together` binds it to {some(sorted(others))}")
    for partition in system.partitions.values():
        inside = members(system, partition)
        for component in inside:
            if component.dedicated and len(inside) > 1:
                others = [one.name for one in inside if one is not component]
                yield _told(places, component.name, f'the partition "{partition.name}" also holds {some(others)}')


def _told(places: Places, name: str, because: str) -> Diagnostic:
    return FINDING.at(
        places.value("components", name, "dedicated"),
        f'"{name}" is dedicated, which means a partition of its own, and {because}.',
        "Remove `dedicated`, or let it be alone.",
        address=f"component/{name}",
    )
