"""What is measured can be started."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import Measured, System

FINDING = Finding(
    code="RARMS079", severity=Severity.ERROR, summary="A component that is to be measured says nothing to run"
)


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of components whose reserve is to be measured and that have neither `run` nor `simulation`."""
    for component in system.components.values():
        if component.cpu.reserve is Measured.MEASURED and component.run is None and component.simulation is None:
            yield FINDING.at(
                places.key("components", component.name),
                f'The reserve of "{component.name}" is to be measured, and nothing says how it is started.',
                "Add `run` with a command, or `simulation` with its demand on a simulated host.",
                address=f"component/{component.name}",
            )
