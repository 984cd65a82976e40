"""The templates of scripts: loops and finished literals, nothing else."""

import re
from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING

from rarms_iac.powershell.tokens import TokenKind, tokens
from rarms_iac.storage.shipped import shipped, shipped_text

if TYPE_CHECKING:
    from jinja2 import Environment


FOLDER = "templates/powershell"


@cache
def _environment() -> "Environment":
    """Made when a script is; a name that a template does not get is an error."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(  # noqa: S701 - PowerShell is no HTML: what enters is a literal or a remark already
        loader=FileSystemLoader(str(shipped(FOLDER)), encoding="utf-8"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        newline_sequence="\n",
    )


def fill(template: str, values: Mapping[str, object]) -> bytes:
    """The template's text as the bytes of a script: ASCII, CRLF.

    Raises:
        UnicodeEncodeError: something entered that was no literal.
    """
    return as_script(_environment().get_template(template).render(**values))


def as_script(text: str) -> bytes:
    """Text with LF as the bytes of a script."""
    return text.replace("\n", "\r\n").encode("ascii")


def read(name: str) -> str:
    """A template's text as it lies in its file, with LF."""
    return shipped_text(f"{FOLDER}/{name}")


RUNTIME_BEGIN = "# --- runtime:"
RUNTIME_END = "# --- end of the runtime"

PARTS = ("lock", "journal", "host", "guest", "machines", "capacity", "stop", "disks", "tasks", "unseen")
"""Their names, in the order in which a script carries them."""

_FUNCTION = re.compile(r"^function ([A-Za-z-]+) \{$", re.MULTILINE)


def part_begin(name: str) -> str:
    """How the first line of a part begins."""
    return f"# --- part {name}:"


def part_end(name: str) -> str:
    """How its last line begins."""
    return f"# --- end of the part {name} "


@cache
def runtime() -> str:
    """The runtime, which is fixed in every script, with LF, from its first to its last line."""
    return read("runtime.ps1").rstrip("\n")


@cache
def part_text(name: str) -> str:
    """A part, with LF, from its first to its last line."""
    return read(f"parts/{name}.ps1").rstrip("\n")


def parts_for(steps: str) -> tuple[str, ...]:
    """The names of the parts that the runtime and these steps need, in their order.

    Raises:
        NotTokens: the text ends inside a string.
    """
    needed: set[str] = set()
    waiting = {*_needs(""), *_called(steps)}
    while waiting:
        name = waiting.pop()
        if name not in needed:
            needed.add(name)
            waiting |= _needs(name)
    return tuple(name for name in PARTS if name in needed)


@cache
def _needs(name: str) -> frozenset[str]:
    """The parts that a part calls; an empty name is the runtime."""
    return frozenset(_called(part_text(name) if name else runtime()))


def _called(text: str) -> set[str]:
    """The parts whose functions a text calls; what stands in its strings and remarks is no call."""
    part_of = _part_of_function()
    return {part_of[token.text] for token in tokens(text) if token.kind is TokenKind.WORD and token.text in part_of}


@cache
def _part_of_function() -> Mapping[str, str]:
    """By function: the part that defines it."""
    return {function: name for name in PARTS for function in _FUNCTION.findall(part_text(name))}


def remark(text: str) -> str:
    """The text on one line of printable ASCII; whatever else was in it is shown by its number, line ends as spaces."""
    return "".join(map(_character, " ".join(text.split())))


def _character(character: str) -> str:
    if character.isascii() and character.isprintable():
        return character
    return f"\\u{ord(character):04x}" if ord(character) < 0x10000 else f"\\U{ord(character):08x}"
