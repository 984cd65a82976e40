"""Findings on standard error, for every command but `validate`, whose data they are."""

from collections.abc import Sequence

from rarms_iac.cli.terminal import Terminal
from rarms_iac.model.diagnostics import Diagnostic, in_order
from rarms_iac.views.diagnostics import OutputFormat, Sources, render


def tell(terminal: Terminal, diagnostics: Sequence[Diagnostic], sources: Sources | None = None) -> None:
    """Say these findings in text, in order; nothing where there are none."""
    if not diagnostics:
        return
    ordered = in_order(tuple(diagnostics))
    text = render(OutputFormat.TEXT, ordered, sources or {}, width=terminal.text_width).rstrip("\n")
    if terminal.talk_colour:
        from rarms_iac.views.diagnostics.colour import coloured

        text = coloured(text)
    terminal.talk(text)
