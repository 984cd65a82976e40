"""The words of messages: lists, counts, quotes, reasons, and what was probably meant by a misspelt name."""

import re
import unicodedata
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import islice

STOPPED = "Stopped. All complete results are saved. Run the same command to continue."
"""The message after a measurement that a person ended."""

STREAM_NAMES = {"stdout": "standard output", "stderr": "standard error"}

_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


def number(many: int) -> str:
    """Return a small number as a word."""
    return _NUMBERS[many] if many < len(_NUMBERS) else str(many)


def reason_of(error: BaseException) -> str:
    """Say why something failed, on one line that is never empty: the system's words, the error's own, or its kind."""
    said = getattr(error, "strerror", None) or error
    return " ".join(str(said).split()) or type(error).__name__


def last_words(said: str, code: int | None = None) -> str:
    """Repeat what a program said when it failed, on one line; if it said nothing, how it ended.

    Args:
        said: its last lines, possibly none.
        code: its exit code; negative: the number of the signal that ended it; None: not known.

    Returns:
        Text without a full stop at its end, never empty.
    """
    if text := " ".join(said.split()).rstrip("."):
        return text
    if code is None:
        return "without a reason"
    ended = f"signal {-code} ended it" if code < 0 else f"it ended with exit code {code}"
    return f"{ended} and gave no reason"


_IGNORED = frozenset("\u034f\u115f\u1160\u17b4\u17b5\u2800\u3164\uffa0")
"""Characters that are letters or signs for Unicode, and that a reader does not see."""


def is_invisible(character: str) -> bool:
    """Tell whether a reader does not see a character, or takes it for the space of the keyboard."""
    if character.isascii():
        return not character.isprintable()
    return (
        unicodedata.category(character) in {"Zs", "Zl", "Zp", "Cf", "Cc"}
        or character in _IGNORED
        or "\ufe00" <= character <= "\ufe0f"
    )


def name_character(character: str) -> str:
    """Return `a no-break space (U+00A0)`: a character in words, with its number."""
    name = unicodedata.name(character, {"\t": "tab", "\n": "line feed"}.get(character, "control character")).lower()
    return f"{'an' if name[0] in 'aeio' else 'a'} {name} (U+{ord(character):04X})"


MOST_CANDIDATES = 400
"""Names that are compared: more would make a file full of wrong names slow to refuse."""


MOST_SUGGESTIONS = 20
"""Unknown names for which a similar one is looked for: a file full of wrong names is refused at once all the same."""


def did_you_mean(word: str, candidates: Collection[str]) -> str | None:
    """Return the nearest of the candidates (ties by name), or None where none is near.

    Near means about one slip in three letters.
    """
    allowed = max(len(word) > 1, min(len(word), 32) // 3)
    near = (candidate for candidate in candidates if candidate != word and abs(len(candidate) - len(word)) <= allowed)
    compared = [candidate for candidate, _ in zip(near, range(MOST_CANDIDATES), strict=False)]
    distances = sorted((distance(_folded(word), _folded(candidate), allowed), candidate) for candidate in compared)
    return distances[0][1] if distances and distances[0][0] <= allowed else None


def suggestion(word: str, candidates: Collection[str]) -> str:
    """Return a sentence to put behind a message, with a space before it: ` Did you mean "vision"?`, or nothing."""
    return suggested(did_you_mean(word, candidates))


def suggested(meant: str | None) -> str:
    """Return the sentence of `suggestion` with a name that was found already."""
    return f' Did you mean "{meant}"?' if meant is not None else ""


@dataclass(slots=True)
class Suggestions:
    """Similar names for unknown ones of a file, which may be full of them: the first `MOST_SUGGESTIONS` get one."""

    asked: int = 0

    def find(self, word: str, candidates: Collection[str]) -> tuple[str, str]:
        """Look for the nearest of the candidates.

        Returns:
            The name, empty where none is near or it was not looked for, and a sentence as `suggestion` makes it.
        """
        self.asked += 1
        if self.asked > MOST_SUGGESTIONS:
            return "", f" After {MOST_SUGGESTIONS} names, rarms does not search for similar names."
        meant = did_you_mean(word, candidates)
        return meant or "", suggested(meant)


def question(meant: str | None) -> str:
    """Return a suggestion as advice of its own: `Did you mean 512 MiB?`, or nothing."""
    return f"Did you mean {meant}?" if meant else ""


def _folded(word: str) -> str:
    """Ignore case, hyphens and spaces, which are no slips: `Busy-Loop` is busy_loop."""
    return word.lower().replace("-", "_").replace(" ", "_")


def distance(word: str, other: str, limit: int) -> int:
    """Count letters changed, left out, added, or swapped with a neighbour; above the limit: limit + 1."""
    before: list[int] = []
    previous = list(range(len(other) + 1))
    for row, letter in enumerate(word, 1):
        current = [row]
        for column, against in enumerate(other, 1):
            cost = min(previous[column] + 1, current[-1] + 1, previous[column - 1] + (letter != against))
            if row > 1 and column > 1 and letter == other[column - 2] and word[row - 2] == against:
                cost = min(cost, before[column - 2] + 1)
            current.append(cost)
        if min(current) > limit:
            return limit + 1
        before, previous = previous, current
    return min(previous[-1], limit + 1)


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
