"""Where the reserve comes from a measurement there is a threshold to look up."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import Measured, System

FINDING = Finding(code="RARMS077", severity=Severity.ERROR, summary="A measured reserve without an APT")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of `reserve: measured` on a component without `apt`."""
    for component in system.components.values():
        if component.cpu.reserve is Measured.MEASURED and not component.apt:
            yield FINDING.at(
                places.value("components", component.name, "cpu", "reserve"),
                f'The reserve of "{component.name}" is to be the least that meets its APT, and it has none.',
                "Add `apt`, or fix the reserve: `reserve: 20 %`.",
                address=f"component/{component.name}",
            )
