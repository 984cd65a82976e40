"""A percentile has samples on both sides of it."""

from collections.abc import Iterator
from math import ceil

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Related, Severity
from rarms_iac.model.indexes import percentile_of
from rarms_iac.model.system import SampleCount, System

FINDING = Finding(code="RARMS074", severity=Severity.WARNING, summary="Too few samples for the percentile")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of percentiles above which not one of the samples asked for would lie."""
    for component in system.components.values():
        if component.run is None or not isinstance(component.run.until, SampleCount):
            continue
        for index in component.apt:
            needed = samples_needed(index)
            if needed is not None and component.run.until.samples < needed:
                yield FINDING.at(
                    places.value("components", component.name, "run", "until"),
                    f'"{component.name}" takes {component.run.until.samples} samples a setting; its '
                    f"{index} would be nothing but "
                    "the largest of them.",
                    f"Take at least {needed} samples, better ten times as many.",
                    address=f"component/{component.name}",
                    related=(
                        Related(place=places.key("components", component.name, "apt", index), says="the percentile"),
                    ),
                )


def samples_needed(index: str) -> int | None:
    """How many samples it takes for one to lie above the percentile; None where the index is none."""
    percentile = percentile_of(index)
    return None if percentile is None else ceil(100 / (100 - percentile))
