"""A measured reserve rests on a data log."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from rarms_iac.manifest.checks.common import may_run_on, some
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import Component, Measured, System

FINDING = Finding(code="RARMS100", severity=Severity.ERROR, summary="A measured reserve without a data log")


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


def check(system: System, places: Places, logs: DataLogs, *, before_measuring: bool) -> Iterator[Diagnostic]:
    """Tells of measured reserves without a log on any platform that the component may run on.

    NOTE: the finding is an error, because nothing can be planned on it. Where nobody plans yet (`validate`), the
    manifest is right as it stands and measuring comes next: there it is shown as a warning.
    """
    for one in system.components.values():
        load = one.interference or system.policy.interference
        platforms = list(dict.fromkeys(host.platform for host in may_run_on(system, one)))
        if needs_a_log(one) and platforms and not any(logs.exists(place, one.name, load) for place in platforms):
            found = FINDING.at(
                places.value("components", one.name, "cpu", "reserve"),
                f'The reserve of "{one.name}" is measured, and there is no data log of it on {some(platforms)} against '
                f"{load} (measurements/{platforms[0]}/{one.name}/{load}.jsonl).",
                "Measure it, or fix it for now: `cpu: { reserve: 20 % }`.",
                address=f"component/{one.name}",
            )
            yield replace(found, severity=Severity.WARNING) if before_measuring else found


def needs_a_log(component: Component) -> bool:
    """Whether the reserve is said to be measured."""
    return component.cpu.reserve is Measured.MEASURED
