"""The pattern captures what the fields read."""

from collections.abc import Iterator

from rarms_iac.manifest.checks.pattern_is_not_re2 import compiled_pattern
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.spelling import suggestion
from rarms_iac.model.system import Field, Samples, System

FINDING = Finding(code="RARMS073", severity=Severity.ERROR, summary="A pattern without the group that a field names")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of fields in `run.samples` that no named group of the pattern gives."""
    for component in system.components.values():
        if component.run is None or component.run.samples.source != "pattern":
            continue
        samples = component.run.samples
        groups = compiled_pattern(samples.pattern)
        for key, field in _fields(samples):
            if not isinstance(groups, str) and field.name not in groups:
                yield FINDING.at(
                    places.value("components", component.name, "run", "samples", key, "field"),
                    f'The pattern of "{component.name}" has no group '
                    f'"{field.name}".{suggestion(field.name, list(groups))}',
                    f"Add `(?P<{field.name}>...)` to the pattern, or correct the name.",
                    address=f"component/{component.name}",
                )


def _fields(samples: Samples) -> Iterator[tuple[str, Field]]:
    fields = {"response_time": samples.response_time, "success": samples.success, "count": samples.count}
    yield from ((key, field) for key, field in fields.items() if field is not None)
