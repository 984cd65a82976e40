"""Partitions and hosts have different names."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import partition_names
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS044", severity=Severity.ERROR, summary="A partition is called like a host")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of partitions, with an entry or without, that bear a host's name."""
    hosts = {name.lower(): name for name in system.hosts}
    for name in sorted(partition_names(system)):
        if name.lower() in hosts:
            section = "partitions" if name in system.partitions else "components"
            yield FINDING.at(
                places.key(section, name),
                f'"{name}" is also the name of a host. Hyper-V lists the host computer among its machines, so that '
                "whoever looks for the partition may find the host.",
                "Rename the partition (its component, where it has no entry of its own) or the host.",
                address=f"partition/{name}",
            )
