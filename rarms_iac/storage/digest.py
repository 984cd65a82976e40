"""Digests of any value that can be written."""

import hashlib
from collections.abc import Iterable

from rarms_iac.storage.json_text import canonical


def digest(value: object) -> str:
    """SHA-256 of the canonical JSON, in 64 hex digits.

    Args:
        value: as of `canonical`.

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

    Args:
        text: a digest.

    Returns:
        The beginning of the digest.
    """
    return text[:digits]
