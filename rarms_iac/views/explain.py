"""A finding's page, for `rarms explain RARMS014` and for the forms that carry help."""

import re

from rarms_iac.storage.finding_pages import finding_page, known_codes
from rarms_iac.views.diagnostics.layout import columns, wrap

WIDTH = 80

_LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")


def explain_finding(code: str, width: int = WIDTH) -> str | None:
    """The finding's page for a terminal; the code may be written small. None where there is no such code."""
    page = finding_page(code.upper())
    return None if page is None else for_a_terminal(page, width)


def unknown_code(code: str) -> str:
    """What to say of a code that has no page; NOTE: a number that is near says nothing of what was meant."""
    first, *_, last = known_codes()
    return f"There is no finding {code}: they lie between {first} and {last}, and docs/diagnostics.md lists them all."


def for_a_terminal(page: str, width: int = WIDTH) -> str:
    """Markdown as plain text: headings underlined, paragraphs wrapped, code indented as it is."""
    lines: list[str] = []
    paragraph: list[str] = []
    in_code = False
    for line in [*page.splitlines(), ""]:
        fence = line.startswith("```")
        if paragraph and (not line or fence or line.startswith(("#", "- ", "* "))):
            lines += _paragraph(paragraph, width)
            paragraph = []
        if fence:
            in_code = not in_code
        elif in_code:
            lines.append(f"    {line}".rstrip())
        elif line.startswith("#"):
            lines += _heading(line)
        elif line:
            paragraph.append(line)
        elif lines and lines[-1]:
            lines.append("")
    return "\n".join(lines).strip("\n") + "\n"


def _heading(line: str) -> list[str]:
    title = line.lstrip("#").strip()
    return [title, ("=" if line.startswith("# ") else "-") * columns(title)]


def _paragraph(lines: list[str], width: int) -> list[str]:
    text = _LINK.sub(r"\1", " ".join(line.strip() for line in lines))
    if text.startswith(("- ", "* ")):
        wrapped = list(wrap(text[2:], width, "  "))
        return [f"- {wrapped[0].lstrip()}", *wrapped[1:]]
    return list(wrap(text, width, ""))
