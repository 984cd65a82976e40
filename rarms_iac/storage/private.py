"""What rarms keeps for itself lies in `.rarms/`, out of git by a `.gitignore` of its own (DESIGN section 4)."""

from pathlib import Path

from rarms_iac.storage.disk import make_folders
from rarms_iac.storage.replace import replace

PRIVATE = ".rarms"


def make_room(path: Path) -> None:
    """Make the folder that the file is to lie in; if that is below a `.rarms`, have git ignore all of it."""
    make_folders(path.parent)
    private = next((folder for folder in path.parents if folder.name == PRIVATE), None)
    if private is not None and not (ignore := private / ".gitignore").exists():
        replace(ignore, b"*\n")
