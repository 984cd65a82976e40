"""A plan as the comment of a pull request: its table and its findings.

Everything in it may come from an untrusted manifest: each piece of text is escaped for Markdown and HTML.
"""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from rarms_iac.app.manifests import Manifest
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.model.diagnostics import Diagnostic, Places, Severity
from rarms_iac.model.plan import Plan
from rarms_iac.model.wording import counted
from rarms_iac.views.finding_forms import OutputFormat, findings_as, in_repository
from rarms_iac.views.json_output import json_of
from rarms_iac.views.markdown import code, finding_parts, plain_line, safe, table_markdown
from rarms_iac.views.plan import CHANGES, plan_summary, plan_table, plan_text
from rarms_iac.views.table import Column, Table

if TYPE_CHECKING:
    from rich.console import RenderableType

LONGEST_COMMENT = 65_536
"""Characters that GitHub takes."""


def plan_as(form: OutputFormat, plan: Plan, manifest: Manifest, *, verbose: bool) -> "RenderableType":
    """Give a plan that form: text to be laid out, or else the text itself.

    Args:
        form: SARIF, JUnit and GitHub have the plan's findings, Markdown is the comment of a pull request.
        plan: as it was made.
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
    """Whether the form has something to say where there is no plan; text and JSON say that on their own."""
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
    assert len(text) < LONGEST_COMMENT, "each part has its share of it"
    return text


def failure_comment(manifest: str, findings: Sequence[Diagnostic]) -> str:
    """Return the comment where there is no plan: why."""
    errors = sum(finding.severity is Severity.ERROR for finding in findings)
    head = f"### rarms plan: not possible\n\n**{counted(errors, 'error')} to correct first.**"
    return "\n\n".join([marker(manifest), head, *finding_parts(in_repository(findings))]) + "\n"


def _changes(plan: Plan) -> Iterator[str]:
    tables = {part.host.name: plan_table(part) for part in plan.hosts}
    rows = [(name, *row) for name, table in tables.items() for row in table.rows]
    if rows:
        totals = [f"{name}: {line}" for name, table in tables.items() for line in table.totals]
        yield table_markdown(Table((Column("host"), *CHANGES), rows, totals=totals), "more changes", "more hosts")
