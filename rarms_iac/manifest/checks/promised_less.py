"""Who has an APT is not held back by hand unnoticed: neither by a cap nor by a low weight (DESIGN section 3)."""

from collections.abc import Iterator, Sequence

from rarms_iac.manifest.checks.common import address, members, on_every, wishes
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.quantities import CpuAmount, in_processors, show_amount
from rarms_iac.model.system import Component, Host, System

FINDING = Finding(code="RARMS130", severity=Severity.NOTE, summary="A component with an APT is held back by hand")

USUAL_WEIGHT = 100

_ADVICE = "It stands as written. Unless it is meant so, leave the {} to the planner."


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of components with an APT, and of their partitions, that are capped or weigh less than the usual 100."""
    for section, name, cpu, hosts in wishes(system):
        inside, processors = _inside(system, section, name)
        promised = [component.name for component in inside if component.apt]
        if not promised:
            continue
        whose = f'"{name}" has an APT' if section == "components" else f'"{name}" holds {promised[0]} with its APT'
        if cpu.limit is not None and _caps(cpu.limit, processors, inside, hosts):
            yield FINDING.at(
                places.value(section, name, "cpu", "limit"),
                f"{whose}, and never gets more than {show_amount(cpu.limit)}, although its virtual processors could "
                "use more: it answers later than without this cap, and what was measured without it does not hold.",
                _ADVICE.format("limit"),
                address=address(section, name),
            )
        if cpu.weight is not None and cpu.weight < USUAL_WEIGHT:
            yield FINDING.at(
                places.value(section, name, "cpu", "weight"),
                f"{whose}, and weighs {cpu.weight}, less than the usual {USUAL_WEIGHT}: beyond its reserve it waits "
                "for others, which no measurement shows.",
                _ADVICE.format("weight"),
                address=address(section, name),
            )


def _inside(system: System, section: str, name: str) -> tuple[Sequence[Component], int | None]:
    """Who gets it, and the virtual processors that the manifest fixes for all of them."""
    if section == "components":
        return [system.components[name]], None
    partition = system.partitions[name]
    return members(system, partition), partition.processors


def _caps(limit: CpuAmount, processors: int | None, inside: Sequence[Component], hosts: list[Host]) -> bool:
    def below(host: Host) -> bool:
        own = processors or max(component.processors or host.logical_processors for component in inside)
        return in_processors(limit, host.logical_processors) < own

    return on_every(hosts, below)
