"""What rarms keeps for itself lies in `.rarms/`, out of git by a `.gitignore` of its own (DESIGN section 4)."""

from pathlib import Path

from rarms_iac.storage.disk import current, make_folders

PRIVATE = ".rarms"


def make_room(path: Path) -> None:
    """Make the folder that the file is to lie in; if that is below a `.rarms`, have git ignore all of it."""
    make_folders(path.parent)
    private = next((folder for folder in path.parents if folder.name == PRIVATE), None)
    if private is not None and not _says_something(ignore := private / ".gitignore"):
        effects = current()
        # NOTE: not replaced but written: half of it says the same, and a kill leaves no other file behind.
        effects.write(ignore, b"*\n")
        effects.flush(ignore)
        effects.flush_folder(private)


def _says_something(file: Path) -> bool:
    return file.exists() and file.stat().st_size > 0
