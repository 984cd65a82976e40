"""Files for tests, in ways that work everywhere the tests run."""

from pathlib import Path


def copy_files(source: Path, target: Path) -> Path:
    """A copy of the folder. `shutil` calls for it a function that wine 8 does not have."""
    target.mkdir(parents=True, exist_ok=True)
    for path in source.rglob("*"):
        if path.is_file():
            copy = target / path.relative_to(source)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(path.read_bytes())
    return target
