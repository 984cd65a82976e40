"""The one way by which a value enters a script: as a finished PowerShell literal.

Four forms, all of them pure ASCII on one line: `'text'` with its quotes doubled, a whole number, `$true` / `$false`,
and `('' + 'text' + [char]0x2019 + ...)` over UTF-16 units for what is not printable ASCII. In pure ASCII only U+0027
can end a single-quoted string: the four other characters that PowerShell takes for it (windows.md 10) never appear.
`unreadable` examines a whole script: ASCII, CRLF, and the grammar of PowerShell.
"""

from functools import cache
from itertools import groupby
from struct import iter_unpack
from typing import TYPE_CHECKING

from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.texts.findings import SCRIPT_REFUSED
from rarms_iac.texts.messages import quoted

Scalar = bool | int | str
Literal = str
"""PowerShell text that is one literal."""

LARGEST = 2**63 - 1
"""Above it PowerShell reads a number as a decimal or a double."""

MOST_PARTS = 1000
"""PowerShell's compiler descends once for each `+`: so many are safe on its stack."""


class NoLiteral(ValueError):
    """The value has no literal; the facts say which and why."""

    def __init__(self, value: object, why: str) -> None:
        super().__init__(f"{quoted(value, 60)} cannot be written into a script: {why}")
        self.value = value
        self.why = why


def literal(value: Scalar) -> Literal:
    """Return the literal that PowerShell reads as exactly this value.

    Raises:
        NoLiteral: a negative or too large number, a lone surrogate, or more than `MOST_PARTS` runs of text.
    """
    match value:
        case bool():
            return "$true" if value else "$false"
        case int():
            return _number(value)
        case str():
            return _quoted(value) if value.isascii() and value.isprintable() else _joined(value)


def _number(value: int) -> Literal:
    if value < 0:
        raise NoLiteral(value, "nothing that rarms writes is negative")
    if value > LARGEST:
        raise NoLiteral(value, f"PowerShell keeps whole numbers only up to {LARGEST}")
    return str(value)


def _quoted(text: str) -> Literal:
    return "'" + text.replace("'", "''") + "'"


def _joined(text: str) -> Literal:
    """Return a sum that begins with text, so that every `+` joins and none adds."""
    try:
        units = [unit for (unit,) in iter_unpack("<H", text.encode("utf-16-le"))]
    except UnicodeEncodeError as problem:
        raise NoLiteral(text, f"character {problem.start} is half a surrogate pair, which is not text") from None
    parts = ["''"]
    for plain, run in groupby(units, key=lambda unit: 0x20 <= unit <= 0x7E):
        parts.extend(_parts(plain, list(run)))
    if len(parts) > MOST_PARTS:
        raise NoLiteral(text, f"it has {len(parts)} parts outside or between plain ASCII; the limit is {MOST_PARTS}")
    return f"({' + '.join(parts)})"


def _parts(plain: bool, units: list[int]) -> list[str]:
    """Return a run of plain characters as one string, and of others each character."""
    return [_quoted("".join(map(chr, units)))] if plain else [f"[char]0x{unit:04X}" for unit in units]


if TYPE_CHECKING:
    from tree_sitter import Node, Parser


@cache
def parser() -> "Parser":
    """Return the parser of PowerShell, which is made only when a script is looked at."""
    from tree_sitter import Language, Parser
    from tree_sitter_powershell import language

    return Parser(Language(language()))


LINE_END = "the line does not end with CR LF"


def unreadable(script: bytes, name: str) -> tuple[Diagnostic, ...]:
    """Return a finding for the first line that not every PowerShell reads alike, or cannot read; none otherwise.

    Windows PowerShell 5.1 reads a script in the code page of its Windows, so that only ASCII is the same everywhere.
    """
    line, problem = _problem_in_bytes(script) or _problem_in_grammar(script) or (0, "")
    if not problem:
        return ()
    again = command("show", script=True, out="FOLDER")
    other = (
        "Save it with Windows line ends (CR LF)" if problem == LINE_END else "Change the manifest instead of the script"
    )
    advice = prose(f"{other}, or write the script again: ", again, ".")
    place = Place(file=name, line=line, column=1)
    return (SCRIPT_REFUSED.at(place, "{reason}.", advice, script=name, reason=problem),)


def _problem_in_bytes(script: bytes) -> tuple[int, str] | None:
    *lines, rest = script.split(b"\n")
    for number, line in enumerate(lines, start=1):
        if bad := [byte for byte in line.removesuffix(b"\r") if not 0x20 <= byte <= 0x7E]:
            return number, f"the byte 0x{bad[0]:02x} is not printable ASCII"
        if not line.endswith(b"\r"):
            return number, LINE_END
    return (len(lines) + 1, LINE_END) if rest or not lines else None


def _problem_in_grammar(script: bytes) -> tuple[int, str] | None:
    wrong = error_in(parser().parse(script).root_node)
    if wrong is None:
        return None
    text = (wrong.text or b"").decode("ascii")
    return wrong.start_point.row + 1, f"PowerShell's grammar cannot read {quoted(text, 40)}" if text else _LACKS


_LACKS = "PowerShell's grammar needs more text here"


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
