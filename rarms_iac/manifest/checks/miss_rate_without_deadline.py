"""Where misses are counted there is something to miss."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS071", severity=Severity.ERROR, summary="A deadline-miss rate without a deadline")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of `deadline_miss_rate` of a component without deadline and period."""
    for component in system.components.values():
        if "deadline_miss_rate" in component.apt and component.run is not None and component.run.deadline is None:
            yield FINDING.at(
                places.key("components", component.name, "apt", "deadline_miss_rate"),
                f'"{component.name}" has no deadline that a job could miss.',
                "Say `run.deadline`, or `run.arrival: { every: ... }`, whose period is then the deadline.",
                address=f"component/{component.name}",
            )
