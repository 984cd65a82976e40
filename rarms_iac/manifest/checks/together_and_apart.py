"""`together` and `apart` agree."""

from collections.abc import Iterator, Mapping

from rarms_iac.manifest.checks.common import companions, some
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS049", severity=Severity.ERROR, summary="Together and apart contradict each other")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of components that are apart from one which `together` binds to them, however many steps away."""
    group = companions(system)
    for component in system.components.values():
        for number, other in enumerate(component.apart):
            if other in group and group[other] == group[component.name]:
                yield FINDING.at(
                    places.value("components", component.name, "apart", number),
                    _why(system, component.name, other, group),
                    "Remove one of the two wishes.",
                    address=f"component/{component.name}",
                )


def _why(system: System, name: str, other: str, group: Mapping[str, str]) -> str:
    if name == other:
        return f'"{name}" cannot be apart from itself.'
    direct = other in system.components[name].together or name in system.components[other].together
    through = sorted(one for one in group if group[one] == group[name] and one not in {name, other})
    chain = "" if direct else f" through {some(through)}"
    return f'"{name}" wants to be apart from "{other}", and `together` binds the two{chain}.'
