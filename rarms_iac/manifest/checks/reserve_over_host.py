"""Some host has what a component or partition reserves."""

from collections.abc import Iterator
from fractions import Fraction

from rarms_iac.manifest.checks.common import address, fixed_reserve, on_every, wishes
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.quantities import in_processors, show_amount, show_processors
from rarms_iac.model.system import CpuWish, Host, Measured, System

FINDING = Finding(code="RARMS061", severity=Severity.ERROR, summary="A reserve that no host can give")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of fixed reserves above what every possible host has less `keep_for_host`."""
    for section, name, cpu, hosts in wishes(system):
        reserve = cpu.reserve
        if reserve is None or isinstance(reserve, Measured) or not on_every(hosts, lambda h: _exceeds(cpu, h)):  # noqa: B023  asked at once
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


def _exceeds(cpu: CpuWish, host: Host) -> bool:
    reserve = fixed_reserve(cpu, host)
    return reserve is not None and reserve > room(host)
