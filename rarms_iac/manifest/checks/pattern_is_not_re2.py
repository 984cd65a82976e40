"""Patterns match in linear time."""

from collections.abc import Iterator, Mapping

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import System

MEMORY = 2**20

FINDING = Finding(code="RARMS072", severity=Severity.ERROR, summary="A pattern that is not RE2")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of patterns that google-re2 refuses, or that would take too much memory."""
    for component in system.components.values():
        if component.run is None or component.run.samples.source != "pattern":
            continue
        wrong = why_not_re2(component.run.samples.pattern)
        if wrong is not None:
            yield FINDING.at(
                places.value("components", component.name, "run", "samples", "pattern"),
                f'The pattern of "{component.name}" cannot be used: {wrong}. Patterns are RE2, '
                "so that no line of output "
                "takes long to match: without back-references and look-around.",
                "Write it without them; named groups are `(?P<name>...)`.",
                address=f"component/{component.name}",
            )


def why_not_re2(pattern: str) -> str | None:
    """What is wrong with the pattern, or None."""
    compiled = compiled_pattern(pattern)
    return compiled if isinstance(compiled, str) else None


def compiled_pattern(pattern: str) -> Mapping[str, int] | str:
    """The named groups of the pattern with their numbers, or what is wrong with it."""
    import re2

    options = re2.Options()
    options.max_mem = MEMORY
    options.log_errors = False
    try:
        groups: Mapping[str, int] = re2.compile(pattern, options=options).groupindex
    except re2.error as refused:
        return _text(refused.args[0] if refused.args else "it is refused")
    except UnicodeEncodeError:
        return "it holds half a character"
    return groups


def _text(reason: object) -> str:
    return reason.decode("utf-8", "replace") if isinstance(reason, bytes) else str(reason)
