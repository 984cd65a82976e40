"""The samples carry what the APT is about."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import Call, Samples, System

FINDING = Finding(
    code="RARMS070", severity=Severity.ERROR, summary="A performance index without the samples it is made of"
)


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of indexes whose values no field of `run.samples` gives."""
    for one in system.components.values():
        if one.run is None or one.run.samples.source == "per_run" or isinstance(one.run.start, Call):
            continue  # there the runner itself sees when a job starts, ends and fails
        for index in one.apt:
            lacking = _lacking(index, one.run.samples)
            if lacking:
                yield FINDING.at(
                    places.key("components", one.name, "apt", index),
                    f'The {index} of "{one.name}" is made of {_MADE_OF[lacking]}, and `run.samples` does not say '
                    "where a sample has it.",
                    f"Add `{lacking}: {{ field: ... }}` to `run.samples`.",
                    address=f"component/{one.name}",
                )


_MADE_OF = {
    "response_time": "response times",
    "success": "whether each job succeeded",
    "count": "how much was done",
}


def _lacking(index: str, samples: Samples) -> str | None:
    """The field to add, or None."""
    if index.endswith("response_time") or index in {"jitter", "deadline_miss_rate"}:
        return "response_time" if samples.response_time is None else None
    if index == "success_rate":
        return "success" if samples.success is None else None
    nothing = samples.count is samples.success is samples.response_time is None
    return "count" if index == "throughput" and nothing else None
