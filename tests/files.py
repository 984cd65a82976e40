"""Files for tests, in ways that work everywhere the tests run."""

import json
from pathlib import Path
from typing import Any


def copy_files(source: Path, target: Path) -> Path:
    """A copy of the folder. `shutil` calls for it a function that wine 8 does not have."""
    target.mkdir(parents=True, exist_ok=True)
    for path in source.rglob("*"):
        if path.is_file():
            copy = target / path.relative_to(source)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(path.read_bytes())
    return target


def machines_on(folder: Path, host: str = "onboard") -> list[dict[str, Any]]:
    """Return the machines of a simulated host of a manifest in this folder, as its file has them."""
    file = folder / ".rarms" / "hosts" / f"{host}.json"
    return list(json.loads(file.read_text(encoding="utf-8"))["machines"].values())
