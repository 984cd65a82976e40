"""The files of the model and those of a wine prefix, kept alike: laid out for scripts, and read back after them."""

from __future__ import annotations

import shutil
from pathlib import Path

from tests.fake_powershell.host import File, WindowsHost
from tests.real_powershell.engines import DRIVES

OURS_ON_C = (
    "run",
    "Temp",
    "ProgramData/rarms",
    "ProgramData/Microsoft/Windows/Hyper-V",
    "users/Public/Documents/Hyper-V",
)
"""Folders of drive C: that are the model's alone; of another drive all is."""
CONFIGURATION = ".vmcx"
"""Ends the names of Hyper-V's own files, of which the model knows no more than the folder that they lie in."""


class Disks:
    """The drives of one prefix."""

    def __init__(self, prefix: Path) -> None:
        self.prefix = prefix
        self._laid: dict[str, bytes | None] = {}  # by lower-case path: what lies there, as the model knows it
        self._above: set[str] = set()  # folders that are there because of what lies in them; the model has none

    def begin(self, host: WindowsHost) -> None:
        """Remove what another run left, and lay out this host."""
        for letter in DRIVES:
            for place in (self.prefix / f"drive_{letter}").iterdir():
                shutil.rmtree(place) if place.is_dir() else place.unlink()
        for folder in OURS_ON_C:
            shutil.rmtree(_seen(self.prefix / "drive_c", folder), ignore_errors=True)
        self._laid, self._above = {}, set()
        self.lay_out(host)

    def lay_out(self, host: WindowsHost) -> None:
        """Write what the model has and the disk has not, and remove what is gone."""
        files = host.files | _configurations(host)
        for low, file in files.items():
            if low in self._laid and self._laid[low] == file.data:
                continue
            place = self.place(file.path)
            if file.data is None:
                place.mkdir(parents=True, exist_ok=True)
            else:
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(file.data)
            self._laid[low] = file.data
        for low in self._laid.keys() - files.keys():
            place = self.place(low)
            if place.is_dir():
                shutil.rmtree(place)
            else:
                place.unlink(missing_ok=True)
            del self._laid[low]

    def read_back(self, host: WindowsHost) -> None:
        """Give the model what scripts made of its files."""
        found = self._found()
        for low in self._laid.keys() - found.keys():
            assert not low.endswith(CONFIGURATION), f"{low} is Hyper-V's"
            host.files.pop(low, None)
            del self._laid[low]
        for low, (path, data) in found.items():
            if low in self._laid and self._laid[low] == data:
                continue
            if data is None and low not in self._laid:
                if any(other.startswith(low + "\\") for other in found):
                    self._above.add(low)
                if low in self._above:
                    continue
            assert not low.endswith(CONFIGURATION), f"{path} is Hyper-V's"
            host.write_file(path, data)
            self._laid[low] = data

    def _found(self) -> dict[str, tuple[str, bytes | None]]:
        roots = [("C:", _seen(self.prefix / "drive_c", folder)) for folder in OURS_ON_C]
        roots += [(f"{letter.upper()}:", self.prefix / f"drive_{letter}") for letter in DRIVES]
        found: dict[str, tuple[str, bytes | None]] = {}
        for name, root in roots:
            top = self.prefix / f"drive_{name[0].lower()}"
            for place in [root, *root.rglob("*")] if root.exists() else ():
                if place == top:
                    continue
                path = f"{name}\\" + str(place.relative_to(top)).replace("/", "\\")
                try:
                    found[path.lower()] = (path, None if place.is_dir() else place.read_bytes())
                except FileNotFoundError:  # it went just now
                    continue
        return found

    def place(self, path: str) -> Path:
        """Where a path of Windows lies here."""
        return _seen(self.prefix / f"drive_{path[0].lower()}", path[3:].replace("\\", "/"))


def _configurations(host: WindowsHost) -> dict[str, File]:
    paths = [f"{vm.folder}\\{vm.id}{CONFIGURATION}" for vm in host.vms.values() if vm.folder]
    return {path.lower(): File(path=path, data=b"") for path in paths}


def _seen(top: Path, path: str) -> Path:
    """The path below a folder, in the case in which it lies there."""
    place = top
    for name in path.split("/"):
        alike = [one for one in place.iterdir() if one.name.lower() == name.lower()] if place.is_dir() else []
        place = alike[0] if alike and not (place / name).exists() else place / name
    return place
