"""A measured reserve rests on a data log."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from rarms_iac.manifest.checks.common import may_run_on, some
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import Component, Measured, System

FINDING = Finding(code="RARMS101", severity=Severity.WARNING, summary="A reserve that has not been measured yet")


class DataLogs(Protocol):
    """What the check asks of the folder `measurements/`."""

    def exists(self, platform: str, component: str, interference: str) -> bool:
        """Whether that component was measured on that platform against that interference; reads no content."""
        ...


@dataclass(frozen=True, slots=True)
class LogsInFolder:
    """The data logs of a `measurements` folder, by the names of their files."""

    folder: Path

    def exists(self, platform: str, component: str, interference: str) -> bool:
        """Whether the log's file is there."""
        return (self.folder / platform / component / f"{interference}.jsonl").is_file()


def check(system: System, places: Places, logs: DataLogs) -> Iterator[Diagnostic]:
    """Tells of measured reserves without a log on any platform that the component may run on.

    NOTE: a warning, because the manifest is right as it stands and measuring comes after writing it. Whoever plans
    cannot go on without the log: there the planner tells of it, as the error RARMS100.
    """
    for component in system.components.values():
        load = component.interference or system.policy.interference
        platforms = list(dict.fromkeys(host.platform for host in may_run_on(system, component)))
        if (
            needs_a_log(component)
            and platforms
            and not any(logs.exists(place, component.name, load) for place in platforms)
        ):
            yield FINDING.at(
                places.value("components", component.name, "cpu", "reserve"),
                f'The reserve of "{component.name}" is measured, and there is no data log of it on '
                f"{some(platforms)} against "
                f"{load} (measurements/{platforms[0]}/{component.name}/{load}.jsonl).",
                f"Measure it before planning: `rarms measure {component.name}`. Or fix it for now: "
                "`cpu: { reserve: 20 % }`.",
                address=f"component/{component.name}",
            )


def needs_a_log(component: Component) -> bool:
    """Whether the reserve is said to be measured and can be; else RARMS077 or RARMS079 tells of it."""
    can_be = bool(component.apt) and (component.run is not None or component.simulation is not None)
    return component.cpu.reserve is Measured.MEASURED and can_be
