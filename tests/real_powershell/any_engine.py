"""The PowerShell of the system that runs the tests: 7 on Linux; on Windows 7 or 5.1, whichever is named."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from tests.needs import ON_WINDOWS
from tests.real_powershell.engines import Engine
from tests.remote import Ended

SYSTEM = "windows" if ON_WINDOWS else "linux"
"""The fixture's name, and with `powershell-` that of the need."""


def run_on_files(engine: Engine, folder: Path, script: str, files: Mapping[str, bytes]) -> Ended:
    """Run a script that takes -Folder, on a folder with these files."""
    for name, data in files.items():
        path = folder / "files" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    path = folder / "script.ps1"
    path.write_text(script, encoding="ascii")
    words = ("-NoProfile", "-NonInteractive", "-ExecutionPolicy", "Bypass", "-File", engine.path(path))
    return engine.run(*words, "-Folder", engine.path(folder / "files"))
