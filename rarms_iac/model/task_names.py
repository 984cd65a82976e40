"""The names of MMCSS task classes: what Windows brings, what RC SS adds, and how their values are spelled."""

import re

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
    """Whether a task class may be called so."""
    return _TASK.match(text) is not None


def is_shipped_task(text: str) -> bool:
    """Whether Windows brings a task class of this name, in any case."""
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
