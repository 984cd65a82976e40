"""YAML 1.2 core scalars: what a plain word means (`no` is a text, `0640` is 640)."""

import math
import re
from functools import lru_cache

MAX_DIGITS = 15
"""Digits of a whole number: every program that reads JSON keeps so many."""

PlainValue = bool | int | float | str | None

_WORDS: dict[str, bool | None] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
MAY_BE_MORE = frozenset(("", *"0123456789+-.~nNtTfF"))
"""How words begin that may mean more than their text."""

_DECIMAL = re.compile(r"[-+]?[0-9]+")
_OCTAL = re.compile(r"0o[0-7]+")
_HEXADECIMAL = re.compile(r"0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")


class NotRepresentable(ValueError):
    """Not a YAML text that rarms reads; the message says why."""


@lru_cache(maxsize=4096)
def plain_scalar(text: str) -> PlainValue:
    """Return the value of a word without quotes.

    Raises:
        NotRepresentable: a number of more than 15 digits, an infinite one, or none at all (`.nan`).
    """
    if text in _WORDS:
        return _WORDS[text]
    if _DECIMAL.fullmatch(text):
        return _whole(text, 10)
    if _OCTAL.fullmatch(text):
        return _whole(text[2:], 8)
    if _HEXADECIMAL.fullmatch(text):
        return _whole(text[2:], 16)
    if _FLOAT.fullmatch(text):
        return _finite(text)
    if _NOT_FINITE.fullmatch(text):
        raise NotRepresentable(f"{text} cannot be compared with other numbers")
    return text


def _whole(digits: str, base: int) -> int:
    if len(digits.lstrip("+-0")) > MAX_DIGITS:
        raise NotRepresentable(
            f"a whole number has at most {MAX_DIGITS} digits, this one has {len(digits.lstrip('+-'))}"
        )
    return int(digits, base)


def _finite(text: str) -> int | float:
    value = float(text)
    if not math.isfinite(value):
        raise NotRepresentable("it is too large")
    # 2.0 is the whole number 2, as JSON Schema has it.
    return int(value) if value.is_integer() and abs(value) < 10**MAX_DIGITS else value
