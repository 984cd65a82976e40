"""A component of the host asks for nothing that only a partition has."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import Component, RunsOn, System

FINDING = Finding(
    code="RARMS059", severity=Severity.ERROR, summary="A component that runs on the host has wishes of a partition"
)


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of `runs_on: host` beside a reserve, limit, weight, `processors`, `dedicated` or `together`."""
    for one in system.components.values():
        if one.runs_on is RunsOn.HOST:
            for path, given in _wishes(one):
                if given:
                    yield FINDING.at(
                        places.value("components", one.name, *path),
                        f'"{one.name}" runs on the host itself: it has no partition, and so no `{".".join(path)}`.',
                        "Remove it, or remove `runs_on: host`.",
                        address=f"component/{one.name}",
                    )


def _wishes(one: Component) -> Iterator[tuple[tuple[str, ...], bool]]:
    yield ("cpu", "reserve"), one.cpu.reserve is not None
    yield ("cpu", "limit"), one.cpu.limit is not None
    yield ("cpu", "weight"), one.cpu.weight is not None
    yield ("processors",), one.processors is not None
    yield ("dedicated",), one.dedicated
    yield ("together",), bool(one.together)
