"""A job may last as long as its APT and deadline allow."""

from collections.abc import Iterator
from fractions import Fraction

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.quantities import show_milliseconds
from rarms_iac.model.system import AtMost, Component, Run, System

FINDING = Finding(code="RARMS069", severity=Severity.WARNING, summary="The time-out comes before the threshold")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of time-outs at or below a deadline or a response time that would still be good enough."""
    for component in system.components.values():
        if component.run is None:
            continue
        for name, allowed in _allowed(component, component.run):
            if component.run.timeout <= allowed:
                yield FINDING.at(
                    places.value("components", component.name, "run", "timeout"),
                    f'"{component.name}" is stopped after '
                    f"{show_milliseconds(component.run.timeout)}, and its {name} allows "
                    f"{show_milliseconds(allowed)}: a job that is late would count as failed instead.",
                    f"Raise the time-out well above {show_milliseconds(allowed)}.",
                    address=f"component/{component.name}",
                )


def _allowed(component: Component, run: Run) -> Iterator[tuple[str, Fraction]]:
    if run.deadline is not None:
        yield "deadline", run.deadline
    for index, threshold in component.apt.items():
        if index.endswith("response_time") and isinstance(threshold, AtMost):
            yield index, threshold.value
