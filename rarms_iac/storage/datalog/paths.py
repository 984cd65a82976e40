"""Where measurements lie: `measurements/` beside the manifest, in git (DESIGN section 2)."""

from collections.abc import Iterable
from pathlib import Path

FOLDER = "measurements"


def log_path(folder: Path, platform: str, components: Iterable[str], interference: str) -> Path:
    """The data log of components that are in one partition, below the manifest's folder."""
    return folder / FOLDER / platform / joined(components) / f"{interference}.jsonl"


def configuration_path(folder: Path, platform: str, component: str) -> Path:
    """The configuration log of a component on a platform; no name has a dot, so it is nobody's folder."""
    return folder / FOLDER / platform / f"{component}.configuration.jsonl"


def joined(components: Iterable[str]) -> str:
    """Components of one partition as one name: `path-planning+video-streaming`, in name order."""
    return "+".join(sorted(components))
