"""The names that a manifest may give, those that Windows keeps, those of task classes, and the new names of `moved`."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
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
    """Return whether an application, host, partition, component or interference may have this name."""
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


TASK_PATTERN = r"^[A-Za-z][A-Za-z0-9 ]{0,62}$"
"""Task classes, compared without case: they are registry keys."""


SHIPPED_TASKS = (
    "Audio",
    "Capture",
    "DisplayPostProcessing",
    "Distribution",
    "Games",
    "Playback",
    "Pro Audio",
    "Window Manager",
)
"""The multimedia task classes that come with Windows (windows.md 6.5)."""


ROBOTIC_TASKS = ("SpeechRecognition", "ObjectIdentification", "MotionControl", "Localization", "ObstacleAvoidance")
"""The classes RC SS adds (the paper, RC SS)."""


_TASK = re.compile(TASK_PATTERN.removesuffix("$") + r"\Z")


def is_task(text: str) -> bool:
    """Return whether a task class may have this name."""
    return _TASK.match(text) is not None


def is_shipped_task(text: str) -> bool:
    """Return whether Windows ships a task class of this name, in any case."""
    return text.lower() in {name.lower() for name in SHIPPED_TASKS}


TASK_VALUES = (
    "Affinity",
    "Background Only",
    "BackgroundPriority",
    "Clock Rate",
    "GPU Priority",
    "Priority",
    "SFIO Priority",
    "Scheduling Category",
)
"""The values of a task class as Windows and rarms spell them; the registry does not tell their case apart."""


BETWEEN = ".moving"
"""Ends the name a mark bears while two partitions change places; a dot cannot occur in a manifest's name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Renaming:
    """The new name of every name that is there; the same where nothing moves."""

    new: Mapping[str, str]
    impossible: tuple[str, ...] = ()  # names that `moved` would give a name that another keeps


def renaming(there: Collection[str], wanted: Collection[str], moved: Mapping[str, str]) -> Renaming:
    """Return the wanted names of the partitions that are there.

    A move happens where the old name is on the host, the new one is wanted, and the new one is free or moves away
    itself. A name that stepped aside for an exchange goes on to where it was going.
    """
    new = {}
    for name in there:
        goal = name.removesuffix(BETWEEN) if name.endswith(BETWEEN) else moved.get(name, name)
        new[name] = goal if goal in wanted else name
    impossible: list[str] = []
    while clash := _clash(new):
        impossible += clash
        new.update({name: name for name in clash})
    return Renaming(new=new, impossible=tuple(impossible))


def _clash(new: Mapping[str, str]) -> list[str]:
    """Return names that would move onto a name that another one takes or keeps."""
    takers: dict[str, list[str]] = {}
    for name, goal in new.items():
        takers.setdefault(goal, []).append(name)
    return sorted(name for goal, names in takers.items() if len(names) > 1 for name in names if name != goal)
