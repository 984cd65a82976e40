"""There is something to run."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS089", severity=Severity.WARNING, summary="There is no component")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of a manifest without components."""
    if not system.components:
        yield FINDING.at(
            places.value("components"),
            "No component is described: a plan would stop every partition that rarms made before.",
            "Add a component; to remove everything, use `rarms destroy`.",
            address=f"application/{system.application.name}",
        )
