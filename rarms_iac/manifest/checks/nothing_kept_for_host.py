"""`keep_for_host` makes room for components that run on the host itself."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import may_run_on, some
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.quantities import in_processors, show_bytes
from rarms_iac.model.system import RunsOn, System

FINDING = Finding(code="RARMS058", severity=Severity.WARNING, summary="Nothing is kept for what runs on the host")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of hosts on which such a component may run and that keep no processor time, or too little memory."""
    on_host = [component for component in system.components.values() if component.runs_on is RunsOn.HOST]
    for host in system.hosts.values():
        here = [component for component in on_host if host in may_run_on(system, component)]
        memory = sum(component.memory for component in here)
        lacks = []
        if here and in_processors(host.keep_for_host.processor, host.logical_processors) == 0:
            lacks.append("no processor time")
        if here and host.keep_for_host.memory < memory:
            lacks.append(f"{show_bytes(host.keep_for_host.memory)} of the {show_bytes(memory)} they need")
        if lacks:
            yield FINDING.at(
                places.value("hosts", host.name, "keep_for_host"),
                f'{some(component.name for component in here)} may run on "{host.name}" itself, and it keeps '
                f"{' and '.join(lacks)}: partitions may be promised all the rest.",
                f"Say `keep_for_host: {{ processor: ..., memory: {show_bytes(memory)} }}` with what they need.",
                address=f"host/{host.name}",
            )
