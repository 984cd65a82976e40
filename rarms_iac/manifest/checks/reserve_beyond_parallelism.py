"""A component has enough threads for what it reserves."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import fixed_reserve, may_run_on
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.quantities import show_processors
from rarms_iac.model.system import RunsOn, System

FINDING = Finding(code="RARMS063", severity=Severity.WARNING, summary="A reserve that the component cannot use")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of fixed reserves that are more LPs than the component has threads."""
    for component in system.components.values():
        hosts = may_run_on(system, component)
        threads = None if component.simulation is None else component.simulation.threads
        if threads is None or component.runs_on is RunsOn.HOST or (component.processors or threads + 1) <= threads:
            continue
        reserves = [reserve for host in hosts if (reserve := fixed_reserve(component.cpu, host)) is not None]
        if reserves and min(reserves) > threads:
            yield FINDING.at(
                places.value("components", component.name, "cpu", "reserve"),
                f'"{component.name}" reserves {show_processors(min(reserves))}, and '
                f"{_threads(threads)} can use no more than "
                f"{show_processors(threads)} at a time: the rest is promised to nobody else and never used.",
                f"Say `processors: {threads}`, with a reserve of at most {show_processors(threads)}.",
                address=f"component/{component.name}",
            )


def _threads(number: int) -> str:
    return "its one thread" if number == 1 else f"its {number} threads"
