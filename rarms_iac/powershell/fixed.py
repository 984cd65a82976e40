"""What of a script is fixed: the runtime, which every script carries, and parts, which do single things for it.

A script carries the parts whose functions the runtime or its steps call, and those that these need
(docs/decisions/0010).
"""

import re
from collections.abc import Mapping
from functools import cache

from rarms_iac.powershell.environment import read
from rarms_iac.powershell.tokens import TokenKind, tokens

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
    """What is fixed in every script, with LF, from its first to its last line."""
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
    waiting = _called(runtime()) | _called(steps)
    while waiting:
        name = waiting.pop()
        if name not in needed:
            needed.add(name)
            waiting |= _needs(name)
    return tuple(name for name in PARTS if name in needed)


@cache
def _needs(name: str) -> frozenset[str]:
    return frozenset(_called(part_text(name)))


def _called(text: str) -> set[str]:
    """The parts whose functions a text calls; what stands in its strings and remarks is no call."""
    where = _where()
    return {where[token.text] for token in tokens(text) if token.kind is TokenKind.WORD and token.text in where}


@cache
def _where() -> Mapping[str, str]:
    """Of each function of a part the part."""
    return {function: name for name in PARTS for function in _FUNCTION.findall(part_text(name))}
