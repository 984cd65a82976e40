"""Some host has what a component or partition reserves."""

from collections.abc import Iterator
from fractions import Fraction
from typing import assert_never

from rarms_iac.manifest.checks.common import address, wishes
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.quantities import (
    CpuAmount,
    ProcessorTime,
    ShareOfHost,
    in_processors,
    show_amount,
    show_processors,
)
from rarms_iac.model.system import Host, Measured, System

FINDING = Finding(code="RARMS061", severity=Severity.ERROR, summary="A reserve that no host can give")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of fixed reserves above what every possible host has less `keep_for_host`."""
    rooms = {host.name: (room(host), 100 * room(host) / host.logical_processors) for host in system.hosts.values()}
    for section, name, cpu, hosts in wishes(system):
        reserve = cpu.reserve
        if reserve is None or isinstance(reserve, Measured) or not hosts:
            continue
        if not all(_exceeds(reserve, *rooms[host.name]) for host in hosts):
            continue
        largest = max(hosts, key=lambda host: (room(host), host.name))
        yield FINDING.at(
            places.value(section, name, "cpu", "reserve"),
            f'"{name}" reserves {show_amount(reserve)}, and "{largest.name}" can promise '
            f"{show_processors(room(largest))} of its {largest.logical_processors} LPs"
            f"{', more than any other host it may run on' if len(hosts) > 1 else ''}.",
            "Lower the reserve, keep less for the host, or allow a larger host.",
            address=address(section, name),
        )


def room(host: Host) -> Fraction:
    """The LPs that partitions may be promised."""
    return host.logical_processors - in_processors(host.keep_for_host.processor, host.logical_processors)


def _exceeds(reserve: CpuAmount, processors: Fraction, percent: Fraction) -> bool:
    """Whether it is more than a host's room, which is given in LPs and as a share of the host."""
    match reserve:
        case ShareOfHost(percent=share):
            return share > percent
        case ProcessorTime(processors=time):
            return time > processors
        case _:
            assert_never(reserve)
