"""JSON as text: one canonical form to write, its digest, and a strict reading of what came from outside."""

import hashlib
import json
from collections.abc import Iterable
from math import isfinite
from typing import Any

from rarms_iac.storage.codec import Json, NotDecodable, encode
from rarms_iac.texts.messages import HIDDEN, quoted

_SHAPE = bytes.maketrans(b"123456789E", b"000000000e")
_HUGE = (b"e000", b"e+000", b"0" * 300)
"""What a number has that may be too large, when all its digits are 0."""


def canonical(value: object) -> str:
    """Return the value as JSON with sorted keys and no spaces, in ASCII.

    What `storage.codec` can write, and plain JSON. The same value gives the same text on every system, in any
    order of its mappings.

    Args:
        value: a frozen value, or JSON.

    Returns:
        One line of ASCII.
    """
    return json.dumps(value, default=encode, sort_keys=True, separators=(",", ":"), allow_nan=False)


def readable_json(document: Json) -> bytes:
    """Return the document as JSON that a person can read and git can compare.

    Returns:
        UTF-8 with LF, keys in their order; what a reader would not see, or no encoding has, is escaped.
    """
    text = json.dumps(document, indent=1, ensure_ascii=False) + "\n"
    return HIDDEN.sub(lambda sign: f"\\u{ord(sign[0]):04x}", text).encode("utf-8")


def parse_json(text: str) -> Json:
    """Return the JSON of a text that came from outside.

    Args:
        text: of a file that was read up to its limit.

    Returns:
        Dictionaries, lists, texts, finite numbers, booleans and None.

    Raises:
        NotDecodable: it is not JSON, says a key twice, is nested too deeply, or holds NaN or an overlong number.
    """
    # A callback for every number would double the time of a long log: it is set where a number may be too large.
    # NOTE: a regular expression for this takes longer than the JSON.
    shape = text.encode("utf-8", "surrogatepass").translate(_SHAPE)
    parse_float = _finite if any(huge in shape for huge in _HUGE) else None
    del shape
    try:
        data: Json = json.loads(
            text, object_pairs_hook=_without_duplicates, parse_constant=_refuse_constant, parse_float=parse_float
        )
    except RecursionError:
        raise NotDecodable("", "it is nested too deeply") from None
    except NotDecodable:
        raise
    except ValueError as problem:
        raise NotDecodable("", f"it is not JSON ({problem})") from None
    return data


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        raise NotDecodable("", f"the key {quoted(next(name for name in names if names.count(name) > 1))} occurs twice")
    return found


def _finite(digits: str) -> float:
    number = float(digits)
    if not isfinite(number):
        raise NotDecodable("", f"the number {digits[:20]} is too large")
    return number


def _refuse_constant(name: str) -> Json:
    raise NotDecodable("", f"{name} is not a number")


def digest(value: object) -> str:
    """Return the SHA-256 of the canonical JSON, in 64 hex digits.

    Returns:
        Lower case.
    """
    return hashlib.sha256(canonical(value).encode("ascii")).hexdigest()


def digest_of_texts(texts: Iterable[str]) -> str:
    """Return the SHA-256 of texts in their order, in 64 hex digits in lower case."""
    whole = hashlib.sha256()
    for text in texts:
        whole.update(hashlib.sha256(text.encode("utf-8", "surrogatepass")).digest())
    return whole.hexdigest()


def short(text: str, digits: int = 12) -> str:
    """Return the first hex digits of a digest: enough to tell things apart that are not forged.

    Returns:
        The beginning of the digest.
    """
    return text[:digits]
