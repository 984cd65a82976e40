"""A component of the host asks for nothing that only a partition has."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import Component, RunsOn, System

FINDING = Finding(
    code="RARMS059", severity=Severity.ERROR, summary="A component that runs on the host has wishes of a partition"
)


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of `runs_on: host` beside a reserve, limit, weight, `processors`, `dedicated` or `together`."""
    for component in system.components.values():
        if component.runs_on is RunsOn.HOST:
            for path, given in _wishes(component):
                if given:
                    yield FINDING.at(
                        places.value("components", component.name, *path),
                        f'"{component.name}" runs on the host itself: it has no partition, and '
                        f"so no `{'.'.join(path)}`.",
                        "Remove it, or remove `runs_on: host`.",
                        address=f"component/{component.name}",
                    )


def _wishes(component: Component) -> Iterator[tuple[tuple[str, ...], bool]]:
    yield ("cpu", "reserve"), component.cpu.reserve is not None
    yield ("cpu", "limit"), component.cpu.limit is not None
    yield ("cpu", "weight"), component.cpu.weight is not None
    yield ("processors",), component.processors is not None
    yield ("dedicated",), component.dedicated
    yield ("together",), bool(component.together)
