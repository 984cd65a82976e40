"""Words in a row, and small numbers, as a person writes them."""

from collections.abc import Sequence

_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


def in_a_row(words: Sequence[object], last: str = "and") -> str:
    """`a`, `a and b`, `a, b and c`; or with another word before the last."""
    *others, end = map(str, words)
    return f"{', '.join(others)} {last} {end}" if others else end


def number(many: int) -> str:
    """A small number as a word."""
    return _NUMBERS[many] if many < len(_NUMBERS) else str(many)
