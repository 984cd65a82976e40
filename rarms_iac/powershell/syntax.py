"""Whether the bytes of a script are printable ASCII in CRLF lines that PowerShell's grammar can read. Pure."""

from functools import cache
from typing import TYPE_CHECKING

from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, Finding, Place
from rarms_iac.model.wording import quoted

if TYPE_CHECKING:
    from tree_sitter import Node, Parser

UNREADABLE = Finding.error("RARMS201", "A script cannot be read as PowerShell")


@cache
def parser() -> "Parser":
    """Return the parser of PowerShell, which is made only when a script is looked at."""
    from tree_sitter import Language, Parser
    from tree_sitter_powershell import language

    return Parser(Language(language()))


def unreadable(script: bytes, name: str) -> tuple[Diagnostic, ...]:
    """Return a finding for the first line that not every PowerShell reads alike, or cannot read; none otherwise.

    Windows PowerShell 5.1 reads a script in the code page of its Windows, so that only ASCII is the same everywhere.
    """
    line, problem = _problem_in_bytes(script) or _problem_in_grammar(script) or (0, "")
    if not problem:
        return ()
    again = command("show", script=True, out="FOLDER")
    advice = prose("Change the manifest instead of the script, and write it again: ", again, ".")
    place = Place(file=name, line=line, column=1)
    return (UNREADABLE.at(place, "{reason}.", advice, script=name, reason=problem),)


def _problem_in_bytes(script: bytes) -> tuple[int, str] | None:
    *lines, rest = script.split(b"\n")
    for number, line in enumerate(lines, start=1):
        if bad := [byte for byte in line.removesuffix(b"\r") if not 0x20 <= byte <= 0x7E]:
            return number, f"the byte 0x{bad[0]:02x} is not printable ASCII"
        if not line.endswith(b"\r"):
            return number, "the line does not end with CR LF"
    return (len(lines) + 1, "the last line does not end with CR LF") if rest or not lines else None


def _problem_in_grammar(script: bytes) -> tuple[int, str] | None:
    wrong = error_in(parser().parse(script).root_node)
    if wrong is None:
        return None
    text = (wrong.text or b"").decode("ascii")
    return wrong.start_point.row + 1, f"PowerShell's grammar cannot read {quoted(text, 40)}" if text else _LACKS


_LACKS = "PowerShell's grammar wants more here"


def error_in(node: "Node") -> "Node | None":
    """Return the first innermost node that the grammar could not place or had to invent.

    What it invents may hang below a node without being among its children: then that node is the innermost.
    """
    while node.has_error:
        below = next((child for child in node.children if child.has_error), None)
        if below is None:
            return node
        node = below
    return None
