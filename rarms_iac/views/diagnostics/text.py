"""Findings as a person reads them in a terminal (STYLE: Problems): complete without colour."""

from collections.abc import Iterator, Mapping, Sequence

from rarms_iac.model.diagnostics import Diagnostic, Place, Severity, Sources
from rarms_iac.views.diagnostics.layout import columns, hanging, visible, wrap
from rarms_iac.views.diagnostics.source import excerpt, line_at, source_lines

WIDTH = 80
INDENT = "  "


def as_text(
    diagnostics: Sequence[Diagnostic],
    sources: Sources,
    *,
    accepted: Sequence[Diagnostic] = (),
    width: int = WIDTH,
) -> str:
    """Every finding with its source line, and a last line that counts them; ends with a line end."""
    lines = {file: source_lines(sources[file]) for file in _files(diagnostics) if file in sources}
    blocks = ["\n".join(_block(diagnostic, lines, width)) for diagnostic in diagnostics]
    return "\n\n".join([*blocks, summary(diagnostics, accepted)]) + "\n"


def summary(diagnostics: Sequence[Diagnostic], accepted: Sequence[Diagnostic] = ()) -> str:
    """`1 error, 2 warnings, 0 notes`, or `No findings`; what the policy accepts is counted apart."""
    counts = ", ".join(
        counted(sum(diagnostic.severity is severity for diagnostic in diagnostics), severity.value)
        for severity in Severity
    )
    told = counts if diagnostics else "No findings"
    return f"{told} ({len(accepted)} accepted)." if accepted else f"{told}."


def counted(number: int, noun: str) -> str:
    """`1 error`, `2 errors`."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _files(diagnostics: Sequence[Diagnostic]) -> set[str]:
    places = [diagnostic.place for diagnostic in diagnostics] + [
        other.place for diagnostic in diagnostics for other in diagnostic.related
    ]
    return {place.file for place in places if place is not None}


def _block(diagnostic: Diagnostic, sources: Mapping[str, Sequence[str]], width: int) -> Iterator[str]:
    yield from hanging(f"{diagnostic.severity.value}[{diagnostic.code}] ", visible(diagnostic.summary, keep=""), width)
    yield from _where(diagnostic, width)
    if diagnostic.place is not None:
        yield from _snippet(diagnostic.place, sources, width)
    yield from wrap(diagnostic.detail, width, INDENT)
    yield from wrap(diagnostic.advice, width, INDENT)
    for related in diagnostic.related:
        yield f"{INDENT}{visible(str(related.place), keep='')}, {visible(related.says, keep='')}"
        yield from _snippet(related.place, sources, width)


def _where(diagnostic: Diagnostic, width: int) -> Iterator[str]:
    """The place, on several lines where it is too long for one.

    A warning also says its address, which is what `policy.accept` would name.
    """
    parts = (
        [] if diagnostic.place is None else [part for part in (str(diagnostic.place), diagnostic.place.path) if part]
    )
    if diagnostic.address and (diagnostic.severity is Severity.WARNING or diagnostic.place is None):
        parts.append(f"at {diagnostic.address}")
    line = ""
    for part in (visible(each, keep="") for each in parts):
        if line and columns(f"{INDENT}{line}, {part}") > width:
            yield f"{INDENT}{line},"
            line = part
        else:
            line = f"{line}, {part}" if line else part
    if line:
        yield INDENT + line


def _snippet(place: Place, sources: Mapping[str, Sequence[str]], width: int) -> Iterator[str]:
    line = line_at(sources.get(place.file, []), place.line)
    if not line.strip():
        return
    gutter = f"{INDENT}{place.line} | "
    shown = excerpt(line, place, width - len(gutter))
    yield gutter + shown.line
    yield " " * (len(gutter) - 2) + "| " + " " * shown.before + "^" * shown.carets
