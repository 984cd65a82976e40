"""Findings, emitted once and rendered in every form (DESIGN section 9). Each renderer is one small pure function."""

from collections.abc import Sequence
from typing import assert_never

from rarms_iac.model.diagnostics import Diagnostic, Sources
from rarms_iac.views.diagnostics.outputs import BadOutput, Output, OutputFormat, parse_outputs

__all__ = ["BadOutput", "Output", "OutputFormat", "Sources", "parse_outputs", "render"]


def render(
    form: OutputFormat,
    diagnostics: Sequence[Diagnostic],
    sources: Sources,
    *,
    accepted: Sequence[Diagnostic] = (),
    width: int = 80,
) -> str:
    """The findings in that form, in the order given, complete without colour.

    Args:
        form: which renderer.
        diagnostics: what is told, in order (`model.diagnostics.in_order`).
        sources: the text of each file, or its lines, by the name that places use; it may lack some.
        accepted: findings that the policy silences; each form tells them apart or counts them.
        width: columns that text is wrapped to; no other form is.
    """
    match form:
        case OutputFormat.TEXT:
            from rarms_iac.views.diagnostics.text import as_text

            return as_text(diagnostics, sources, accepted=accepted, width=width)
        case OutputFormat.JSON:
            from rarms_iac.views.diagnostics.as_json import as_json

            return as_json(diagnostics, accepted=accepted)
        case OutputFormat.SARIF:
            from rarms_iac.storage.finding_pages import finding_page
            from rarms_iac.views.diagnostics.sarif import as_sarif

            return as_sarif(diagnostics, page=finding_page, accepted=accepted)
        case OutputFormat.JUNIT:
            from rarms_iac.views.diagnostics.junit import as_junit

            return as_junit(diagnostics, accepted=accepted)
        case OutputFormat.GITHUB:
            from rarms_iac.views.diagnostics.github import as_github

            return as_github(diagnostics)
        case _:
            assert_never(form)
