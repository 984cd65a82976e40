"""Pieces of Markdown for a pull request: texts that can do nothing there, folded parts, and findings.

Everything in them may come from a stranger's manifest: each piece of text is escaped for Markdown and HTML.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from html import escape

from rarms_iac.model.commands import plain_text, sentences
from rarms_iac.model.diagnostics import Diagnostic, Severity
from rarms_iac.model.wording import counted
from rarms_iac.views.console import styled
from rarms_iac.views.harmless import GLUE, visible
from rarms_iac.views.table import Column, Content, Table, text_of_cell

_LONGEST_TEXT = 500
"""Characters that are shown of one name, message or title."""

_TABLE, _TOTALS, _FINDINGS, _NOTES = 20_000, 10_000, 8_000, 3_000
"""Characters of the parts of a comment: together they stay below the longest that GitHub takes."""


def findings_markdown(findings: Sequence[Diagnostic]) -> str:
    """Return findings as a list."""
    return "\n\n".join([*finding_parts(findings)] or ["No findings."]) + "\n"


def finding_parts(findings: Sequence[Diagnostic]) -> Iterator[str]:
    """Errors and warnings, and folded the notes."""
    grouped = {
        severity: [_finding(finding) for finding in findings if finding.severity is severity] for severity in Severity
    }
    notes = grouped.pop(Severity.NOTE)
    problems = [line for lines in grouped.values() for line in lines]
    if problems:
        yield "#### Findings\n\n" + "\n".join(_fitting(problems, _FINDINGS, ITEM, "more findings"))
    if notes:
        yield folded(counted(len(notes), "note"), _fitting(notes, _NOTES, ITEM, "more notes"))


def _finding(finding: Diagnostic) -> str:
    place = f" {code(str(finding.place))}" if finding.place else ""
    detail = safe(plain_text(sentences(finding.detail, finding.advice)))
    return f"- **{finding.severity.value} {finding.code}** {safe(finding.summary)}{place}: {detail}"


ROW, ITEM = "| {} |", "- {}"
"""How a line stands in a table and in a list."""


def table_markdown(table: Table, more_rows: str, more_totals: str) -> str:
    """Return a table and its totals, as many of them as have room; the words are for those that are left out."""
    titles = [column.title for column in table.columns]
    rules = ["--:" if column.right else "---" for column in table.columns]
    rows = [ROW.format(" | ".join(map(_cell, row, table.columns))) for row in table.rows]
    lines = [ITEM.format(safe(line)) for line in table.totals]
    return "\n".join(
        [ROW.format(" | ".join(titles)), ROW.format(" | ".join(rules)), *_fitting(rows, _TABLE, ROW, more_rows)]
        + ["", *_fitting(lines, _TOTALS, ITEM, more_totals)] * bool(lines)
    )


def _cell(content: Content, column: Column) -> str:
    text = styled(text_of_cell(content, column)).plain.replace(GLUE, " ")
    return re.sub(r"(?<!\\)\|", r"\|", safe(text))


def _fitting(lines: Sequence[str], room: int, form: str, more: str) -> list[str]:
    """Return the first lines that have room, and in the form of a line how many there are more."""
    used, shown = 0, []
    for line in lines:
        used += len(line) + 1
        if used > room:
            break
        shown.append(line)
    left_out = len(lines) - len(shown)
    return [*shown, form.format(f"{left_out} {more}: `rarms plan` shows all")] if left_out else shown


def folded(title: str, lines: Iterable[str]) -> str:
    """Lines below a title, which a reader opens."""
    return "\n".join([f"<details><summary>{title}</summary>", "", *lines, "", "</details>"])


def plain_line(text: str, *, indent: bool = False) -> str:
    """Return the text on one line, for a block of code, which nothing in it can end."""
    line = visible(text, keep="").replace("`", "'")
    line = line if indent else line.strip()
    return line if len(line) <= _LONGEST_TEXT else f"{line[:_LONGEST_TEXT]}..."


def code(text: str) -> str:
    """Return the text as code in a line; in a table, too."""
    return f"`{plain_line(text).replace('|', '/')}`"


def safe(text: str) -> str:
    """Return the text so that neither Markdown nor HTML, no link and no mention of a person begins in it.

    Code of ours stays code.
    """
    line = visible(text, keep="")
    line = line if len(line) <= _LONGEST_TEXT else f"{line[:_LONGEST_TEXT]}..."
    pieces = re.split(r"((?<!`)`[^`]+`(?!`))", line)  # runs of two or more could open what one does not close
    return "".join(piece if at % 2 else _escaped(piece) for at, piece in enumerate(pieces))


_NOTHING = "<!-- -->"
"""Parts a text for GitHub, which also finds links, persons and issues in the characters that escapes stand for."""

_LINKED = re.compile(r"(?<=:)(?=//)|(?<=www)(?=\.)|(?<=@)|(?<=#)(?=[0-9])", re.IGNORECASE)
"""Where an address, an e-mail address, a person or the number of an issue is parted."""


def _escaped(text: str) -> str:
    escaped = re.sub(r"([\\`*_\[\]|~#])", r"\\\1", escape(text, quote=False))
    return _LINKED.sub(_NOTHING, escaped).replace("@", "&#64;")
