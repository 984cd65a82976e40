"""The processors of a partition carry its reserve."""

from collections.abc import Iterator
from math import ceil

from rarms_iac.manifest.checks.common import address, fixed_reserve, wishes
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.quantities import show_processors
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS078", severity=Severity.ERROR, summary="A reserve above what its processors can give")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of fixed reserves that are more LPs than `processors` allows, a whole LP each."""
    for section, name, cpu, hosts in wishes(system):
        wish = system.components[name] if section == "components" else system.partitions[name]
        count = wish.processors
        if count is None:
            continue
        # A share of fewer logical processors is less: the smallest host decides.
        smallest = min(hosts, key=lambda host: host.logical_processors, default=None)
        reserve = fixed_reserve(cpu, smallest) if smallest else None
        if reserve is not None and reserve > count:
            yield FINDING.at(
                places.value(section, name, "cpu", "reserve"),
                f'"{name}" reserves {show_processors(reserve)}, and {_processors(count)} can be guaranteed '
                f"{show_processors(count)} at most.",
                f"Say `processors: {ceil(reserve)}`, or reserve at most {show_processors(count)}.",
                address=address(section, name),
            )


def _processors(count: int) -> str:
    return "one processor" if count == 1 else f"{count} processors"
