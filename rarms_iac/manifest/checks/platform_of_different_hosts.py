"""Hosts that share measurements are alike."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Related, Severity
from rarms_iac.model.system import Host, System

FINDING = Finding(code="RARMS085", severity=Severity.ERROR, summary="Hosts of one platform differ")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of hosts whose provider or LPs differ from the first host of their platform."""
    first: dict[str, Host] = {}
    for host in system.hosts.values():
        other = first.setdefault(host.platform, host)
        differs = _differs(other, host)
        if differs:
            yield FINDING.at(
                places.value("hosts", host.name, "platform"),
                f'"{host.name}" and "{other.name}" are of the platform "{host.platform}" and share measurements, but '
                f"{differs}: what was measured on one says nothing of the other.",
                "Give them different platforms.",
                address=f"host/{host.name}",
                related=(Related(place=places.key("hosts", other.name), says="the other host"),),
            )


def _differs(host: Host, other: Host) -> str:
    if host.provider is not other.provider:
        return f"their providers are {host.provider.value} and {other.provider.value}"
    if host.logical_processors != other.logical_processors:
        return f"they have {host.logical_processors} and {other.logical_processors} logical processors"
    return ""
