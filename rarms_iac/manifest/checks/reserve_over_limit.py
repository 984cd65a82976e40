"""A limit leaves room for the reserve."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import address, on_every, wishes
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Related, Severity
from rarms_iac.model.quantities import CpuAmount, ProcessorTime, ShareOfHost, in_processors, show_amount
from rarms_iac.model.system import Host, Measured, System

FINDING = Finding(code="RARMS060", severity=Severity.ERROR, summary="The reserve is above the limit")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of components and partitions whose limit is below what they reserve, on every host they may run on."""
    for section, name, cpu, hosts in wishes(system):
        reserve, limit = cpu.reserve, cpu.limit
        if reserve is None or limit is None or isinstance(reserve, Measured):
            continue
        if _exceeds(reserve, limit, hosts):
            yield FINDING.at(
                places.value(section, name, "cpu", "limit"),
                f'"{name}" reserves {show_amount(reserve)} and may use no more than {show_amount(limit)}: a limit '
                "below the reserve takes back what was promised.",
                "Raise the limit, lower the reserve, or remove the limit.",
                address=address(section, name),
                related=(Related(place=places.value(section, name, "cpu", "reserve"), says="the reserve"),),
            )


def _exceeds(reserve: CpuAmount, limit: CpuAmount, hosts: list[Host]) -> bool:
    if isinstance(reserve, ShareOfHost) and isinstance(limit, ShareOfHost):
        return reserve.percent > limit.percent
    if isinstance(reserve, ProcessorTime) and isinstance(limit, ProcessorTime):
        return reserve.processors > limit.processors
    return on_every(
        hosts,
        lambda host: in_processors(reserve, host.logical_processors) > in_processors(limit, host.logical_processors),
    )
