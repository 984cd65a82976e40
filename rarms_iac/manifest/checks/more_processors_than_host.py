"""A partition has no more processors than its host."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import address, hosts_for, may_run_on, members
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import Host, System

FINDING = Finding(code="RARMS064", severity=Severity.ERROR, summary="More processors than the host has")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of `processors` above the LPs of every possible host."""
    for section, name, processors, hosts in _asked(system):
        most = max((host.logical_processors for host in hosts), default=processors)
        if processors > most:
            yield FINDING.at(
                places.value(section, name, "processors"),
                f'"{name}" has {processors} processors, and no host that it may run on has more than {most}. A '
                "reservation is not guaranteed to a partition with more processors than the host can run at once.",
                f"Say `processors: {most}` or fewer, or allow a larger host.",
                address=address(section, name),
            )


def _asked(system: System) -> Iterator[tuple[str, str, int, list[Host]]]:
    for component in system.components.values():
        if component.processors is not None:
            yield "components", component.name, component.processors, may_run_on(system, component)
    for partition in system.partitions.values():
        if partition.processors is not None:
            hosts = hosts_for(system, members(system, partition))
            yield "partitions", partition.name, partition.processors, hosts
