"""The signature of a script: a remark at its end, over its text, so that a host's journal carries it with the script.

A script holds the digest of the undo script beside it, so that one is signed first.
"""

import hashlib
import hmac
import re
from collections.abc import Mapping

_REMARK = re.compile(r"# rarms key signature ([0-9a-f]{64})\r\n\Z")
_UNDO = ".undo.ps1"


def signed_scripts(scripts: Mapping[str, str], key: bytes) -> dict[str, str]:
    """Sign the scripts of a host.

    Args:
        scripts: by file name, each unsigned ASCII with CRLF.
        key: of those who may write plans that are applied.

    Returns:
        The same names; each script names the digest of its signed undo script.
    """
    undo = {name: _signed(text, key) for name, text in scripts.items() if name.endswith(_UNDO)}
    rest = {name: _naming(name, text, scripts, undo) for name, text in scripts.items() if name not in undo}
    return {name: undo[name] if name in undo else _signed(rest[name], key) for name in scripts}


def is_signed_script(text: str, key: bytes) -> bool:
    """Tell whether a script has a signature that fits the key.

    Args:
        text: of the script, without what Windows adds to sign it.
        key: as of `signed_scripts`.
    """
    found = _REMARK.search(text)
    return found is not None and hmac.compare_digest(found[1], _signature(text[: found.start()], key))


def _naming(name: str, text: str, before: Mapping[str, str], after: Mapping[str, str]) -> str:
    """Return the script with the digest of its undo script as that is now."""
    undo = f"{name.removesuffix('.ps1')}{_UNDO}"
    return text.replace(_digest(before[undo]), _digest(after[undo])) if undo in before and undo in after else text


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _signed(text: str, key: bytes) -> str:
    return f"{text}# rarms key signature {_signature(text, key)}\r\n"


def _signature(text: str, key: bytes) -> str:
    return hmac.new(key, b"script\0" + text.encode("utf-8", "surrogatepass"), hashlib.sha256).hexdigest()
