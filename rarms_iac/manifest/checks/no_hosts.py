"""There is a host for the components."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS088", severity=Severity.ERROR, summary="There is no host")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of a manifest with components and without hosts."""
    if system.components and not system.hosts:
        yield FINDING.at(
            places.value("hosts"),
            "No host is described, so that nothing can run anywhere.",
            "Add one: `hosts: { onboard: { provider: simulated, logical_processors: 2, memory: 4 GiB } }`.",
        )
