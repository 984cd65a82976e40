"""Findings as a person reads them (STYLE: Problems): complete without colour.

Findings of one kind are one finding with a list. `finding_forms` has the forms that programs read.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rarms_iac.model.commands import prose, sentences
from rarms_iac.model.diagnostics import Diagnostic, Place, Severity, Sources
from rarms_iac.texts.messages import counted
from rarms_iac.views.console import (
    DIM,
    ERROR,
    NOTE,
    STRONG,
    UNLIMITED,
    WARNING,
    columns,
    paragraph,
    render,
    stack,
    styled,
    visible,
)

if TYPE_CHECKING:
    from rich.console import RenderableType


LINE_END = re.compile(r"\r\n|[\n\r]")
"""What ends a line for editors and for the YAML reader, which refuses the other line ends of Unicode."""

STYLES = {Severity.ERROR: ERROR, Severity.WARNING: WARNING, Severity.NOTE: NOTE}
INDENT = 2
EXCERPT_WIDTH = 80
"""Columns of a line of a file that is shown, however wide the terminal is."""
REACH = 400
"""Characters looked at on either side of the spot: a file of one line of megabytes is not a reason to be slow."""
ELLIPSIS = "..."
TAB_STOP = 8
SECRETS = frozenset({"RARMS090", "RARMS091"})
"""Findings whose line of the file is not shown: the log of a workflow has more readers than the file."""


def findings_text(
    diagnostics: Sequence[Diagnostic],
    sources: Sources,
    *,
    accepted: Sequence[Diagnostic] = (),
    brief: bool = False,
    in_progress: bool = False,
) -> "RenderableType":
    """Show every finding, and a last line that counts them.

    Args:
        diagnostics: what is shown, in this order; those of one kind stand together, at the first of them.
        sources: the text of each file, or its lines, by the name that places use; it may lack some.
        accepted: findings that the policy silences; they are counted.
        brief: a kind of notes is one line, which says where; `rarms validate` and `rarms explain` say the rest.
        in_progress: a result follows, so that one kind of notes is not counted again.
    """
    lines = {file: source_lines(sources[file]) for file in _files(diagnostics) if file in sources}
    kinds: dict[tuple[str, str], list[Diagnostic]] = {}
    for diagnostic in diagnostics:
        kinds.setdefault((diagnostic.code, diagnostic.summary), []).append(diagnostic)
    notes = [alike for alike in kinds.values() if brief and alike[0].severity is Severity.NOTE]
    parts: list[RenderableType] = []
    for alike in kinds.values():
        if alike not in notes:
            parts += [*(_one_finding(alike[0], lines) if len(alike) == 1 else _finding_group(alike)), ""]
    parts += map(_note, notes)
    only_notes = notes and len(notes) == len(kinds)
    if in_progress and len(kinds) == 1 and diagnostics[0].severity is Severity.NOTE:
        return stack(*parts[:-1])
    return stack(*parts, None if only_notes else findings_summary(diagnostics, accepted))


def findings_summary(diagnostics: Sequence[Diagnostic], accepted: Sequence[Diagnostic] = ()) -> str:
    """Write as `1 error, 2 warnings.`, or `No findings.`; accepted findings are counted apart."""
    numbers = {severity: sum(diagnostic.severity is severity for diagnostic in diagnostics) for severity in Severity}
    counts = ", ".join(counted(number, severity.value) for severity, number in numbers.items() if number)
    return f"{counts or 'No findings'} ({len(accepted)} accepted)." if accepted else f"{counts or 'No findings'}."


def source_lines(text: str | Sequence[str]) -> Sequence[str]:
    """Return the lines of a file without their ends and without a byte-order mark; lines are given back as they are."""
    return LINE_END.split(text.removeprefix("\ufeff")) if isinstance(text, str) else text


def _files(diagnostics: Sequence[Diagnostic]) -> set[str]:
    places = [diagnostic.place for diagnostic in diagnostics]
    places += [other.place for diagnostic in diagnostics for other in diagnostic.related]
    return {place.file for place in places if place is not None}


def _head(diagnostic: Diagnostic, number: int = 1) -> "RenderableType":
    start = styled((f"{diagnostic.severity.value}[{diagnostic.code}] ", STYLES[diagnostic.severity]))
    return paragraph(
        styled((visible(diagnostic.summary, keep="") + (f" ({number})" if number > 1 else ""), STRONG)), start=start
    )


def _note(alike: Sequence[Diagnostic]) -> "RenderableType":
    """Write as `note[RARMS086] An entry is not used: rarms.yaml:82:3, interference.browsers`."""
    locations = "; ".join(", ".join(_location(diagnostic)) for diagnostic in alike)
    summary = visible(alike[0].summary, keep="")
    text = f"{summary}: {locations}" if any(diagnostic.place or diagnostic.address for diagnostic in alike) else summary
    return paragraph(styled((f"note[{alike[0].code}] ", NOTE), text), more=2)


def _one_finding(diagnostic: Diagnostic, sources: Mapping[str, Sequence[str]]) -> "Iterator[RenderableType]":
    yield _head(diagnostic)
    location = ", ".join(_location(diagnostic))
    if location:
        yield paragraph(location, indent=INDENT)
    yield from _finding_excerpt(diagnostic, sources)
    yield from (paragraph(text, indent=INDENT) for text in (diagnostic.detail, diagnostic.advice) if text)
    for related in diagnostic.related:
        yield paragraph(visible(f"{related.place}, {related.message}", keep=""), indent=INDENT)
        yield from _excerpt(related.place, sources)


def excerpt_text(diagnostic: Diagnostic, sources: Sources) -> str:
    """Return the line of the file that a finding points at, with carets below the spot; empty where none is shown."""
    lines = {file: source_lines(sources[file]) for file in _files([diagnostic]) if file in sources}
    parts = tuple(_finding_excerpt(diagnostic, lines))
    return render(stack(*parts), UNLIMITED) if parts else ""


def _finding_excerpt(diagnostic: Diagnostic, sources: Mapping[str, Sequence[str]]) -> "Iterator[RenderableType]":
    if diagnostic.place is not None and diagnostic.code not in SECRETS:
        yield from _excerpt(diagnostic.place, sources)


def _finding_group(diagnostics: Sequence[Diagnostic]) -> "Iterator[RenderableType]":
    """Yield the head once, an item for each, and the advice once where it is the same for all."""
    yield _head(diagnostics[0], len(diagnostics))
    advices = {diagnostic.advice for diagnostic in diagnostics}
    for diagnostic in diagnostics:
        parts = [
            *_location(diagnostic, with_path="path" not in diagnostic.values),  # else the detail begins with it
            *(f"{other.place}, {other.message}" for other in diagnostic.related),
        ]
        location = visible(", ".join(parts), keep="")
        text = sentences(diagnostic.detail, diagnostic.advice if len(advices) > 1 else "")
        yield paragraph(prose(location, ": " if location and text else "", text), indent=INDENT, start="- ")
    if len(advices) == 1:
        yield from (paragraph(advice, indent=INDENT) for advice in advices if advice)


def _location(diagnostic: Diagnostic, *, with_path: bool = True) -> Iterator[str]:
    """Yield the place, and for a warning its address, which is what `policy.accept` would name."""
    if diagnostic.place is not None:
        yield visible(str(diagnostic.place), keep="")
        if diagnostic.place.path and with_path:
            yield visible(diagnostic.place.path, keep="")
    if diagnostic.address and (diagnostic.severity is Severity.WARNING or diagnostic.place is None):
        yield f"at {visible(diagnostic.address, keep='')}"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Excerpt:
    """A source line and what is to be underlined in it, both ready for a terminal."""

    line: str
    before: int  # columns before the first caret
    carets: int  # columns to underline, at least 1


def _excerpt(place: Place, sources: Mapping[str, Sequence[str]]) -> "Iterator[RenderableType]":
    """Yield the line that the place points at, with carets under the spot; nothing where the text lacks it."""
    lines = sources.get(place.file, ())
    line = lines[place.line - 1] if 0 < place.line <= len(lines) else ""
    if not line.strip():
        return
    gutter = f"{' ' * INDENT}{place.line} | "
    excerpt = _cut_line(line, place, EXCERPT_WIDTH - len(gutter))
    yield styled((gutter, DIM), excerpt.line)
    yield styled((f"{'| ':>{len(gutter)}}", DIM), " " * excerpt.before, ("^" * excerpt.carets, ERROR))


def _cut_line(line: str, place: Place, width: int) -> _Excerpt:
    """Return the place in its line, cut to at most `width` columns around the spot where the line is longer."""
    first = min(max(place.column, 1) - 1, len(line))
    last = min(first + max(place.length, 1), len(line))
    before = _without_tabs(line[max(first - REACH, 0) : first])
    under = _without_tabs(line[first : min(last, first + REACH)], columns(before))
    after = _without_tabs(line[last : last + REACH], columns(before) + columns(under))
    if columns(before) + columns(under) + columns(after) > width:
        under = _cut_to(under, width // 2)
        room = width - columns(under) - 2 * len(ELLIPSIS)
        if columns(before) > room + len(ELLIPSIS):
            before = ELLIPSIS + _cut_to(before[::-1], room * 2 // 3)[::-1]
        rest = width - columns(before) - columns(under)
        after = after if columns(after) <= rest else _cut_to(after, rest - len(ELLIPSIS)) + ELLIPSIS
    return _Excerpt(line=(before + under + after).rstrip(), before=columns(before), carets=max(columns(under), 1))


def _without_tabs(text: str, start: int = 0) -> str:
    """Return the visible text, tabs as spaces up to the next stop; its first character stands in column `start`."""
    expanded = ""
    for character in visible(text, keep="\t"):
        expanded += " " * (TAB_STOP - (start + columns(expanded)) % TAB_STOP) if character == "\t" else character
    return expanded


def _cut_to(text: str, width: int) -> str:
    start = text[:width]
    while columns(start) > width:
        start = start[:-1]
    return start


_LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")
_BLOCK_STARTS = ("#", "- ", "* ", "```")


def unknown_code(code: str) -> str:
    """Say that a code has no page. A similar number says nothing about what was meant."""
    return f"The finding {code} does not exist: docs/diagnostics.md lists them all."


def page_text(page: str) -> "RenderableType":
    """Lay out Markdown as plain text: headings underlined, paragraphs wrapped, code indented as it is."""
    parts: list[RenderableType] = []
    lines: list[str] = []
    in_code = False
    for line in [*page.splitlines(), ""]:
        if lines and (not line or line.startswith(_BLOCK_STARTS)):
            parts.append(paragraph(_LINK.sub(r"\1", " ".join(lines))))
            lines = []
        if line.startswith("```"):
            in_code = not in_code
        elif in_code:
            parts.append(_code(line))
        elif line.startswith("#"):
            title = line.lstrip("#").strip()
            parts += [styled(title), ("=" if line.startswith("# ") else "-") * columns(title)]
        elif line:
            lines.append(line.strip())
        else:
            parts.append("")
    return stack(*parts[:-1])


def _code(line: str) -> "RenderableType":
    """Return a line of an example: where it is longer than the terminal, the rest stands below its first word."""
    text = line.lstrip()
    return paragraph(text, indent=4 + len(line) - len(text))
