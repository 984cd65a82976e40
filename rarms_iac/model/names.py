"""The names that a manifest may give, and those that Windows keeps for itself."""

import re
from collections.abc import Sequence
from pathlib import Path
from unicodedata import combining, normalize

NAME_PATTERN = r"^[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?$"
"""Applications, hosts, partitions, components, interference: also good as folder, VM and control-group names."""

_LONGEST = 63

POWERSHELL_MEMBERS = frozenset({"psobject", "psbase", "psadapted", "psextended", "pstypenames"})
"""Names, in lower case, that every object of PowerShell has already: none of its properties can be called so."""

WINDOWS_DEVICES = frozenset(
    ["con", "prn", "aux", "nul", *(f"com{n}" for n in range(1, 10)), *(f"lpt{n}" for n in range(1, 10))]
)
"""Names that Windows keeps for devices, in any folder: no file, and so no machine's folder, can be called so."""


_NAME = re.compile(NAME_PATTERN.removesuffix("$") + r"\Z")


def is_name(text: str) -> bool:
    """Whether an application, host, partition, component or interference may be called so."""
    return _NAME.match(text) is not None


def nearest_name(text: str) -> str:
    """Return the name that is most like a text: `Käfer Bot (2)` -> `kafer-bot-2`; empty where nothing of it is left."""
    letters = "".join(letter for letter in normalize("NFKD", text.lower()) if not combining(letter))
    return re.sub(r"[^a-z0-9]+", "-", letters).strip("-")[:_LONGEST].strip("-")


def robot_of(overlays: Sequence[str]) -> str:
    """Return the name of the robot that overlays describe: that of the last one's file without its ending.

    Args:
        overlays: paths of files; empty: the manifest describes no robot in particular, and has none.
    """
    return Path(overlays[-1]).stem if overlays else ""
