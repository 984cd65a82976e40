"""The page of a finding in a terminal, as `rarms explain RARMS014` shows it."""

import re
from typing import TYPE_CHECKING

from rarms_iac.views.console import columns, paragraph, stack, styled

if TYPE_CHECKING:
    from rich.console import RenderableType

_LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")
_BLOCK_STARTS = ("#", "- ", "* ", "```")


def unknown_code(code: str) -> str:
    """Say that a code has no page. A similar number says nothing about what was meant."""
    return f"There is no finding {code}: docs/diagnostics.md lists them all."


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
