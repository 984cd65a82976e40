"""No name is one of Windows' devices."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import address
from rarms_iac.model.diagnostics import Diagnostic, Finding, Place, Places, Severity
from rarms_iac.model.names import WINDOWS_DEVICES
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS043", severity=Severity.ERROR, summary="A name that Windows keeps for a device")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of hosts, components, partitions and interference that no Windows folder can be called after."""
    named = {
        "hosts": system.hosts,
        "components": system.components,
        "partitions": system.partitions,
        "interference": system.interference,
    }
    if system.application.name in WINDOWS_DEVICES:
        yield _told(places.value("application", "name"), system.application.name, "")
    for section, things in named.items():
        for name in things:
            if name in WINDOWS_DEVICES:
                yield _told(places.key(section, name), name, address(section, name))


def _told(place: Place, name: str, where: str) -> Diagnostic:
    return FINDING.at(
        place,
        f'Windows keeps "{name}" for a device: no folder can have that name, so neither can a machine or a data log.',
        f'Choose another name, "{name}-1" for instance.',
        address=where,
    )
