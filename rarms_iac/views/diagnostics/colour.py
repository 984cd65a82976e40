"""Colour for the text form: a pass of its own that adds escape sequences and changes nothing else."""

import re
from collections.abc import Callable

RESET = "\x1b[0m"
BOLD = "\x1b[1m"
DIM = "\x1b[2m"
SEVERITY = {"error": "\x1b[1;31m", "warning": "\x1b[1;33m", "note": "\x1b[1;36m"}

_HEAD = re.compile(r"^(?P<head>(?P<severity>error|warning|note)\[[A-Z]+[0-9]+\])(?P<summary> .*)$")
_CARETS = re.compile(r"^(?P<gutter> +\| )(?P<carets> *\^+)$")
_SOURCE = re.compile(r"^(?P<gutter> +[0-9]+ \| )")
_ESCAPES = re.compile(r"\x1b\[[0-9;]*m")


def coloured(text: str) -> str:
    """The text of `as_text` with colour; `without_colour` gives exactly the text back."""
    return "\n".join(map(_line, text.split("\n")))


def without_colour(text: str) -> str:
    """The text without the escape sequences that `coloured` adds."""
    return _ESCAPES.sub("", text)


def _line(line: str) -> str:
    for pattern, paint in _PAINTS:
        found = pattern.match(line)
        if found:
            return paint(found, line)
    return line


def _head(found: re.Match[str], _line: str) -> str:
    return f"{SEVERITY[found['severity']]}{found['head']}{RESET}{BOLD}{found['summary']}{RESET}"


def _carets(found: re.Match[str], _line: str) -> str:
    return f"{DIM}{found['gutter']}{RESET}{SEVERITY['error']}{found['carets']}{RESET}"


def _source(found: re.Match[str], line: str) -> str:
    return f"{DIM}{found['gutter']}{RESET}{line[found.end() :]}"


_PAINTS: tuple[tuple[re.Pattern[str], Callable[[re.Match[str], str], str]], ...] = (
    (_HEAD, _head),
    (_CARETS, _carets),
    (_SOURCE, _source),
)
