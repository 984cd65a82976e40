"""The partitions keep `together`."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.common import entry_of
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import Component, RunsOn, System

FINDING = Finding(
    code="RARMS052", severity=Severity.ERROR, summary="Components that belong together are in different partitions"
)


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of components bound by `together` of which one has an entry and the other is elsewhere."""
    entry = entry_of(system)
    for component in system.components.values():
        for number, other in enumerate(component.together):
            here, there = entry.get(component.name), entry.get(other)
            if (
                here != there
                and other in system.components
                and _both_in_partitions(component, system.components[other])
            ):
                yield FINDING.at(
                    places.value("components", component.name, "together", number),
                    f'"{component.name}" belongs together with "{other}", but {_where(component.name, here)}, '
                    f"and {_where(other, there)}.",
                    "List both in one partition, or remove the wish.",
                    address=f"component/{component.name}",
                )


def _both_in_partitions(component: Component, other: Component) -> bool:
    """Whether neither runs on the host: that is RARMS046's to tell."""
    return component.runs_on is other.runs_on is RunsOn.PARTITION


def _where(name: str, partition: str | None) -> str:
    if partition is None:
        return f'"{name}" is listed in none'
    return f'"{name}" is in the partition "{partition}"'
