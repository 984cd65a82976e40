"""A setting is long enough for a job."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Related, Severity
from rarms_iac.model.quantities import show_milliseconds
from rarms_iac.model.system import Elapsed, Periodic, Run, System

FINDING = Finding(code="RARMS068", severity=Severity.ERROR, summary="A setting ends before its first job")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of periodic components that are measured for less than one period."""
    for component in system.components.values():
        match component.run:
            case Run(until=Elapsed(time=time), arrival=Periodic(period=period)) if time < period:
                yield FINDING.at(
                    places.value("components", component.name, "run", "until"),
                    f'"{component.name}" is measured for {show_milliseconds(time)}, and a job starts every '
                    f"{show_milliseconds(period)}.",
                    "Measure for many periods: `until: { samples: 200 }`, or a longer `elapsed`.",
                    address=f"component/{component.name}",
                    related=(
                        Related(place=places.value("components", component.name, "run", "arrival"), says="the period"),
                    ),
                )
