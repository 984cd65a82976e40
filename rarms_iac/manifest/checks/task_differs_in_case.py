"""Task classes are different names for Windows too."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Related, Severity
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS055", severity=Severity.ERROR, summary="Two task classes differ only in case")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of the later of two entries that the registry would take for one."""
    first: dict[str, str] = {}
    for name in system.tasks:
        before = first.setdefault(name.lower(), name)
        if before != name:
            yield FINDING.at(
                places.key("tasks", name),
                f'"{name}" and "{before}" are one registry key: Windows compares the names without case.',
                "Keep one of the two.",
                address=f"task/{name}",
                related=(Related(place=places.key("tasks", before), says="the other one"),),
            )
