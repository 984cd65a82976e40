"""Markdown for a pull request: findings, a plan as its comment, and texts that can do nothing there.

Everything may come from an untrusted manifest: each piece of text is escaped for Markdown and HTML.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from typing import TYPE_CHECKING

from rarms_iac.app.manifests import Manifest
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.model.commands import sentences
from rarms_iac.model.diagnostics import Diagnostic, Places, Severity
from rarms_iac.model.plan import Plan
from rarms_iac.texts.messages import counted
from rarms_iac.views.console import GLUE, styled, visible
from rarms_iac.views.finding_forms import OutputFormat, findings_as, in_repository
from rarms_iac.views.json_output import json_of
from rarms_iac.views.plan import CHANGES, plan_summary, plan_table, plan_text
from rarms_iac.views.table import Column, Content, Table, text_of_cell

if TYPE_CHECKING:
    from rich.console import RenderableType


_LONGEST_TEXT = 500
"""Characters that are shown of one name, message or title."""

_TABLE, _TOTALS, _FINDINGS, _NOTES = 20_000, 10_000, 8_000, 3_000
"""Characters of the parts of a comment: together they stay below the longest that GitHub takes."""


def findings_markdown(findings: Sequence[Diagnostic]) -> str:
    """Return findings as a list."""
    return "\n\n".join([*finding_parts(findings)] or ["No findings."]) + "\n"


def finding_parts(findings: Sequence[Diagnostic]) -> Iterator[str]:
    """Yield errors and warnings, then the notes, folded."""
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
    lines = str(sentences(finding.detail, finding.advice)).split("\n")
    detail = "<br>".join(safe(line.strip()) for line in lines)
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
    """Write lines below a title that a reader opens."""
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


LONGEST_COMMENT = 65_536
"""Characters that GitHub takes."""


def plan_as(form: OutputFormat, plan: Plan, manifest: Manifest, *, verbose: bool) -> "RenderableType":
    """Give a plan that form: text to be laid out, or else the text itself.

    Args:
        form: SARIF, JUnit and GitHub have the plan's findings, Markdown is the comment of a pull request.
        verbose: show every attribute and reason in the text, too.
    """
    match form:
        case OutputFormat.TEXT:
            return plan_text(plan, sources=manifest.sources, verbose=verbose)
        case OutputFormat.JSON:
            return json_of(plan)
        case OutputFormat.MARKDOWN:
            return comment(plan)
        case _:
            return findings_as(form, plan.findings, manifest.sources, places=manifest.places, accepted=plan.accepted)


def is_for_findings(form: OutputFormat) -> bool:
    """Return whether the form is written without a plan; text and JSON say that on their own."""
    return form not in {OutputFormat.TEXT, OutputFormat.JSON}


def no_plan_as(form: OutputFormat, *, manifest: str, error: UseCaseError, places: Places) -> "RenderableType":
    """Give the reasons why there is no plan that form."""
    if form is OutputFormat.MARKDOWN:
        return failure_comment(manifest, error.findings)
    return findings_as(form, error.findings, error.sources, places=places)


def marker(manifest: str) -> str:
    """Return the hidden first line by which a later run finds the comment of this manifest, to update it."""
    return f"<!-- rarms plan: {plain_line(manifest).replace('--', '- -')} -->"


def comment(plan: Plan) -> str:
    """Return the whole comment, shorter than `LONGEST_COMMENT`, with a line end."""
    files = " with ".join(map(code, (plan.manifest, *plan.overlays)))
    parts = [
        marker(plan.manifest),
        f"### rarms plan: {safe(plan.application)}",
        *_changes(plan),
        f"**{safe(plan_summary(plan))}**",
        *finding_parts(in_repository(plan.findings)),
        f"<sub>Plan {plan.id} of {files}, by rarms {plan.rarms_version}. Nothing was applied.</sub>",
    ]
    text = "\n\n".join(parts) + "\n"
    assert len(text) < LONGEST_COMMENT, "every part has its share"
    return text


def failure_comment(manifest: str, findings: Sequence[Diagnostic]) -> str:
    """Return the comment without a plan: why."""
    errors = sum(finding.severity is Severity.ERROR for finding in findings)
    head = f"### rarms plan: not possible\n\n**{counted(errors, 'error')} to correct first.**"
    return "\n\n".join([marker(manifest), head, *finding_parts(in_repository(findings))]) + "\n"


def _changes(plan: Plan) -> Iterator[str]:
    tables = {part.host.name: plan_table(part) for part in plan.hosts}
    rows = [(name, *row) for name, table in tables.items() for row in table.rows]
    if rows:
        totals = [f"{name}: {line}" for name, table in tables.items() for line in table.totals]
        yield table_markdown(Table((Column("host"), *CHANGES), rows, totals=totals), "more changes", "more hosts")
