"""How a component comes to what its partition gets, as `rarms explain COMPONENT` shows it."""

from typing import TYPE_CHECKING

from rarms_iac.app.explain import Explanation
from rarms_iac.model.commands import prose
from rarms_iac.views.console import paragraph, stack
from rarms_iac.views.table import Column, Table

if TYPE_CHECKING:
    from rich.console import RenderableType


ROWS = tuple(Column(title, wraps=True) for title in ("name", "value", "source"))


def explanation_text(explanation: Explanation) -> "RenderableType":
    """Show a row a value, with where it comes from."""
    rows = [(row.name, row.value, row.source) for row in explanation.rows]
    return stack(
        f"{explanation.component} (criticality {explanation.criticality})",
        Table(ROWS, rows),
        *(paragraph(prose("Next: ", command)) for command in explanation.commands),
    )
