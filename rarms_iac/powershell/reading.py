"""Literals read back out of a script: the other direction of `literals`."""

import re

from rarms_iac.powershell.literals import Scalar
from rarms_iac.powershell.tokens import Token, TokenKind, tokens

_CHARACTER = re.compile(r"0x([0-9A-Fa-f]{4})")
_BOOLEANS = {"$true": True, "$false": False}


class NotALiteral(ValueError):
    """The text is none of the four forms of a literal."""

    def __init__(self, text: str) -> None:
        super().__init__(f"{text[:60]!r} is no literal that rarms writes")
        self.text = text


def read_literal(text: str) -> Scalar:
    """The value of a text that is one literal and nothing beside it.

    Raises:
        NotALiteral: it is not.
        NotTokens: it ends inside a string.
    """
    found = tokens(text)
    match found:
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
        case (Token(text="["), Token(text="char"), Token(text="]"), Token(text=word)) if one := _CHARACTER.fullmatch(
            word
        ):
            return chr(int(one[1], 16)), 4
        case _:
            raise NotALiteral(text)
