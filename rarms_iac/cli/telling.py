"""Findings on standard error, for every command but `validate`, whose data they are."""

from collections.abc import Sequence

from rarms_iac.cli.terminal import Terminal
from rarms_iac.model.diagnostics import Diagnostic, Sources, in_order
from rarms_iac.views.findings import findings_text


def tell(terminal: Terminal, diagnostics: Sequence[Diagnostic], sources: Sources | None = None) -> None:
    """Say these findings in text, in order; nothing where there are none."""
    if not diagnostics:
        return
    terminal.talk(findings_text(in_order(tuple(diagnostics)), sources or {}))
