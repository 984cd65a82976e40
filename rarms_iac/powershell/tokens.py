"""A small reader of PowerShell's tokens that knows all its quote characters (windows.md 10).

It finds string literals, comments and structure, and nothing else: it stands beside tree-sitter's grammar, which
takes four of the five single-quote characters for ordinary ones. What it cannot read is `NotTokens`, never a guess.
"""

import re
from dataclasses import dataclass
from enum import StrEnum

SINGLE_QUOTES = "'\u2018\u2019\u201a\u201b"
DOUBLE_QUOTES = '"\u201c\u201d\u201e'
NEWLINES = "\r\n"

_SPACES = " \t\v\f\u0085\u00a0\u1680\u2000\u2001\u2002\u2003\u2004\u2005\u2006\u2007\u2008\u2009\u200a"
_SPACES += "\u2028\u2029\u202f\u205f\u3000"
_STRUCTURE = "(){}[];,|&"
_ENDS_WORD = re.escape(_SPACES + NEWLINES + _STRUCTURE + SINGLE_QUOTES + DOUBLE_QUOTES)

# NOTE: patterns and no loops over characters: every script is read so whenever it is shown or run.
_GAP = re.compile(rf"(?:[{_SPACES}]++|`(?:\r\n|[\r\n]))*+")
_LINE = re.compile(r"[^\r\n]*+")
_VERBATIM = re.compile(rf"[{SINGLE_QUOTES}]((?:[^{SINGLE_QUOTES}]++|[{SINGLE_QUOTES}]{{2}})*+)[{SINGLE_QUOTES}]")
_DOUBLED = re.compile(rf"[{SINGLE_QUOTES}]([{SINGLE_QUOTES}])")
_EXPANDABLE = re.compile(rf"(?:[^`${DOUBLE_QUOTES}]++|`.|\$(?!\()|[{DOUBLE_QUOTES}]{{2}})*+", re.DOTALL)
_WORD = re.compile(rf"(?:[^`${_ENDS_WORD}]++|`.|\$\{{[^}}]*+\}}|\$(?!\{{))*+`?", re.DOTALL)


class NotTokens(ValueError):
    """The text ends inside a string or a comment."""

    def __init__(self, subject: str, offset: int) -> None:
        super().__init__(f"{subject} that begins at character {offset} does not end")
        self.subject = subject
        self.offset = offset


class TokenKind(StrEnum):
    """Kinds of tokens; a word is anything between the others, e.g. a name, a number, an operator."""

    STRING = "string"
    EXPANDABLE = "expandable string"
    COMMENT = "comment"
    WORD = "word"
    STRUCTURE = "structure"
    NEWLINE = "newline"


@dataclass(frozen=True, slots=True, kw_only=True)
class Token:
    """A token where it stands; of a single-quoted string `text` is what PowerShell makes of it."""

    kind: TokenKind
    offset: int
    end: int
    text: str


def tokens(script: str) -> tuple[Token, ...]:
    """All tokens but white space.

    Raises:
        NotTokens: a string or a comment does not end.
    """
    result: list[Token] = []
    at = _end_of(_GAP, script, 0)
    while at < len(script):
        result.append(_token(script, at))
        at = _end_of(_GAP, script, result[-1].end)
    return tuple(result)


def _end_of(pattern: re.Pattern[str], script: str, at: int) -> int:
    """Behind what the pattern matches from there on, which may be nothing."""
    match = pattern.match(script, at)
    return match.end() if match else at


def _token(script: str, at: int) -> Token:
    character, two = script[at], script[at : at + 2]
    if character in NEWLINES:
        return _made(script, TokenKind.NEWLINE, at, at + (2 if two == "\r\n" else 1))
    if character == "#":
        return _made(script, TokenKind.COMMENT, at, _end_of(_LINE, script, at))
    if two == "<#":
        return _made(script, TokenKind.COMMENT, at, _after(script, "#>", at, "a comment"))
    if character == "@" and (here := _here_string(script, at)):
        return here
    if character in SINGLE_QUOTES:
        return _verbatim(script, at)
    if character in DOUBLE_QUOTES:
        return _made(script, TokenKind.EXPANDABLE, at, _expandable_end(script, at))
    if character in _STRUCTURE:
        return _made(script, TokenKind.STRUCTURE, at, at + 1)
    return _made(script, TokenKind.WORD, at, _word_end(script, at))


def _made(script: str, kind: TokenKind, offset: int, end: int) -> Token:
    return Token(kind=kind, offset=offset, end=end, text=script[offset:end])


def _after(script: str, closing: str, at: int, subject: str) -> int:
    offset = script.find(closing, at + 2)
    if offset < 0:
        raise NotTokens(subject, at)
    return offset + len(closing)


def _verbatim(script: str, start: int) -> Token:
    """A single-quoted string: any of the five closes it, two in a row are the second of them."""
    match = _VERBATIM.match(script, start)
    if match is None:
        raise NotTokens("a string", start)
    return Token(kind=TokenKind.STRING, offset=start, end=match.end(), text=_DOUBLED.sub(r"\1", match[1]))


def _expandable_end(script: str, start: int) -> int:
    """Behind a double-quoted string, with the `$( )` inside, which may hold strings of their own."""
    at = _end_of(_EXPANDABLE, script, start + 1)
    while script.startswith("$(", at):
        at = _end_of(_EXPANDABLE, script, _closing(script, at + 2, start))
    if at >= len(script) or script[at] not in DOUBLE_QUOTES:
        raise NotTokens("a string", start)
    return at + 1


def _closing(script: str, at: int, start: int) -> int:
    """Behind the `)` that belongs to a `$(` whose inside begins at `at`."""
    depth = 1
    while at < len(script):
        if script[at] in _SPACES or script[at] == "`":
            at += 2 if script[at] == "`" else 1
            continue
        token = _token(script, at)
        at = token.end
        if token.kind is TokenKind.STRUCTURE:
            depth += {"(": 1, ")": -1}.get(token.text, 0)
        if depth == 0:
            return at
    raise NotTokens("a string", start)


def _here_string(script: str, start: int) -> Token | None:
    """A here-string: its head ends the line, its foot begins one, and nothing inside is special."""
    quotes = next((kind for kind in (SINGLE_QUOTES, DOUBLE_QUOTES) if script[start + 1 : start + 2] in tuple(kind)), "")
    head = _end_of(_LINE, script, start)
    if not quotes or script[start + 2 : head].strip(_SPACES):
        return None
    body = head + (2 if script[head : head + 2] == "\r\n" else 1)
    line = body
    while line < len(script):
        if script[line] in quotes and script[line + 1 : line + 2] == "@":
            kind = TokenKind.STRING if quotes == SINGLE_QUOTES else TokenKind.EXPANDABLE
            return Token(kind=kind, offset=start, end=line + 2, text=_without_last_newline(script[body:line]))
        line = _end_of(_LINE, script, line)
        line += 2 if script[line : line + 2] == "\r\n" else 1
    raise NotTokens("a here-string", start)


def _without_last_newline(text: str) -> str:
    return text.removesuffix("\n").removesuffix("\r") if text.endswith("\n") else text.removesuffix("\r")


def _word_end(script: str, start: int) -> int:
    end = _end_of(_WORD, script, start)
    if script.startswith("${", end):
        raise NotTokens("a variable's name", end)
    return max(end, start + 1)
