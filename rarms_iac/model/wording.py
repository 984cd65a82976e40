"""Lists, counts, quotes and order of names, as values of the model need them when they become text."""

import re
from collections.abc import Collection, Iterable, Sequence
from itertools import islice

HIDDEN = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f"  # control characters but tab and line ends
    "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"  # what turns the direction of the text around
    "\u2028\u2029"  # line ends for YAML, but not for editors: line numbers would be wrong
    "\ud800-\udfff\ufeff\ufffe\uffff]"  # halves of characters, byte order marks, no characters
)
"""Characters that a reviewer would not see."""

MOST_NAMES = 4
"""Names that a message lists before it says how many more there are."""


def in_a_row(words: Sequence[object], last: str = "and") -> str:
    """Return `a`, `a and b`, `a, b and c`; or with another word before the last."""
    *others, end = map(str, words)
    return f"{', '.join(others)} {last} {end}" if others else end


def list_names(names: Iterable[str], most: int = MOST_NAMES) -> str:
    """Return `a`, `a and b`, `a, b and c`; of more than one above `most` the first ones and how many more."""
    known = list(names)
    return list_others(known, (), most) if known else ""


def list_others(names: Sequence[str], without: Collection[str], most: int = MOST_NAMES) -> str:
    """List the names that are left without these; the cost does not grow with their number.

    Args:
        names: in the order in which they are shown, each once; at least one that is shown.
    """
    total = len(names) - len(without)
    shown = list(islice((name for name in names if name not in without), most + 1))
    return in_a_row(shown) if total == len(shown) else f"{', '.join(shown[:most])} and {total - most} more"


def counted(many: int, noun: str) -> str:
    """Write a number with its noun: `1 error`, `2 errors`."""
    return f"{many} {noun}" if many == 1 else f"{many} {noun}s"


def natural_order(name: str) -> tuple[tuple[tuple[str, int], ...], str]:
    """Return a key that sorts names as a reader expects: c1, c2, c10; c1 and c01 differ, too."""
    return tuple((text, int(digits or 0)) for text, digits in re.findall(r"(\D*)(\d*)", name)), name


def quoted(text: object, most: int | None = None) -> str:
    """Quote a foreign name or text for a message: `"vision"`.

    Args:
        text: from anywhere. A sign that is invisible, or that would break the line, is spelt out: `<U+000A>`.
        most: signs that are kept of it, with `...` for the rest; None: all.
    """
    whole = str(text)
    shown = whole[:most] + ("..." if most is not None and len(whole) > most else "")
    signs = (sign if sign.isprintable() else f"<U+{ord(sign):04X}>" for sign in shown)
    return f'"{"".join(signs)}"'


def remark(text: str) -> str:
    """Return the text on one line of printable ASCII.

    All else that was in it is shown by its number, line ends as spaces.
    """
    return "".join(map(_character, " ".join(text.split())))


def _character(character: str) -> str:
    if character.isascii() and character.isprintable():
        return character
    return f"\\u{ord(character):04x}" if ord(character) < 0x10000 else f"\\U{ord(character):08x}"
