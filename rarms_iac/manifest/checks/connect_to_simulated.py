"""`connect` stands where there is something to reach."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import ProviderKind, System

FINDING = Finding(code="RARMS084", severity=Severity.WARNING, summary="A simulated host is not connected to")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of `connect` on a simulated host."""
    for host in system.hosts.values():
        if host.provider is ProviderKind.SIMULATED and host.connect is not None:
            yield FINDING.at(
                places.key("hosts", host.name, "connect"),
                f'"{host.name}" is simulated: it lies in a file here, and `connect` has no effect.',
                "Remove `connect`, or name the provider of the real host.",
                address=f"host/{host.name}",
            )
