"""The samples carry what the APT is about."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.indexes import SampleValue, find_index
from rarms_iac.model.system import Call, Samples, System

FINDING = Finding(
    code="RARMS070", severity=Severity.ERROR, summary="A performance index without the samples it is made of"
)


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of indexes whose values no field of `run.samples` gives."""
    for component in system.components.values():
        if component.run is None or component.run.samples.source == "per_run" or isinstance(component.run.start, Call):
            continue  # there the runner itself sees when a job starts, ends and fails
        for index in component.apt:
            lacking = _lacking(index, component.run.samples)
            if lacking is not None:
                yield FINDING.at(
                    places.key("components", component.name, "apt", index),
                    f'The {index} of "{component.name}" is made of {_MADE_OF[lacking]}, and `run.samples` does not say '
                    "where a sample has it.",
                    f"Add `{lacking.value}: {{ field: ... }}` to `run.samples`.",
                    address=f"component/{component.name}",
                )


_MADE_OF = {
    SampleValue.RESPONSE_TIME: "response times",
    SampleValue.SUCCESS: "whether each job succeeded",
    SampleValue.COUNT: "how much was done",
}


def _lacking(name: str, samples: Samples) -> SampleValue | None:
    """What is to be added for this index, or None."""
    index = find_index(name)
    if index is None:
        return None
    nothing = samples.count is samples.success is samples.response_time is None
    lacks = {
        SampleValue.RESPONSE_TIME: samples.response_time is None,
        SampleValue.SUCCESS: samples.success is None,
        SampleValue.COUNT: nothing,
    }
    return index.made_of if lacks[index.made_of] else None
