"""The one way by which a value enters a script: as a finished PowerShell literal.

Four forms, all of them pure ASCII on one line: `'text'` with its quotes doubled, a whole number, `$true` / `$false`,
and `('' + 'text' + [char]0x2019 + ...)` over UTF-16 units for what is not printable ASCII. In pure ASCII only U+0027
can end a single-quoted string: the four other characters that PowerShell takes for it (windows.md 10) never appear.
"""

import re
from itertools import groupby
from struct import iter_unpack

from rarms_iac.model.wording import quoted
from rarms_iac.powershell.tokens import Token, TokenKind, tokens

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
    """The literal that PowerShell reads back as exactly this value.

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
    """A sum that begins with text, so that every `+` joins and none adds."""
    try:
        units = [unit for (unit,) in iter_unpack("<H", text.encode("utf-16-le"))]
    except UnicodeEncodeError as problem:
        raise NoLiteral(text, f"character {problem.start} is half a surrogate pair, which is no text") from None
    parts = ["''"]
    for plain, run in groupby(units, key=lambda unit: 0x20 <= unit <= 0x7E):
        parts.extend(_parts(plain, list(run)))
    if len(parts) > MOST_PARTS:
        raise NoLiteral(text, f"it has {len(parts)} parts that are not plain ASCII or lie between; {MOST_PARTS} may be")
    return f"({' + '.join(parts)})"


def _parts(plain: bool, units: list[int]) -> list[str]:
    """A run of plain characters as one string, others as characters each."""
    return [_quoted("".join(map(chr, units)))] if plain else [f"[char]0x{unit:04X}" for unit in units]


_CHARACTER = re.compile(r"0x[0-9A-Fa-f]{4}")
_BOOLEANS = {"$true": True, "$false": False}


class NotALiteral(ValueError):
    """The text is none of the four forms of a literal."""

    def __init__(self, text: str) -> None:
        super().__init__(f"{quoted(text, 60)} is no literal that rarms writes")
        self.text = text


def read_literal(text: str) -> Scalar:
    """The value of a text that is one literal and nothing beside it.

    Raises:
        NotALiteral: it is not.
        NotTokens: it ends inside a string.
    """
    read_tokens = tokens(text)
    match read_tokens:
        case (Token(kind=TokenKind.STRING, text=value),):
            return value
        case (Token(kind=TokenKind.WORD, text=word),) if word in _BOOLEANS:
            return _BOOLEANS[word]
        case (Token(kind=TokenKind.WORD, text=word),) if word.isascii() and word.isdigit():
            return int(word)
        case (Token(text="("), *inside, Token(text=")")):
            return _sum(tuple(inside), text)
        case _:
            raise NotALiteral(text)


def _sum(parts: tuple[Token, ...], text: str) -> str:
    """The text of `'' + 'text' + [char]0x2019 + ...`."""
    values: list[str] = []
    at = 0
    while at < len(parts):
        if at and parts[at].text != "+":
            raise NotALiteral(text)
        at += 1 if at else 0
        value, length = _part(parts[at : at + 4], text)
        values.append(value)
        at += length
    if not parts or parts[0].kind is not TokenKind.STRING:
        raise NotALiteral(text)
    joined = "".join(values).encode("utf-16-le", "surrogatepass")
    return joined.decode("utf-16-le", "surrogatepass")


def _part(ahead: tuple[Token, ...], text: str) -> tuple[str, int]:
    match ahead:
        case (Token(kind=TokenKind.STRING, text=value), *_):
            return value, 1
        case (Token(text="["), Token(text="char"), Token(text="]"), Token(text=unit)) if _CHARACTER.fullmatch(unit):
            return chr(int(unit, 16)), 4
        case _:
            raise NotALiteral(text)
