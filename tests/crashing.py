"""A disk that counts the effects on files and crashes at one of them; also the launcher of a whole command on it.

`python -m tests.crashing 7 half apply --auto-approve` runs `rarms apply --auto-approve` and ends the process with
exit code 137, without any clean-up, at the seventh effect: `before` it, `half` way through what it writes (the same as
before where nothing is written), or `after` it. With 0 nothing crashes, and the number of effects is the last line on
standard error: `effects: 23`.
"""

import os
import sys
from collections.abc import Callable
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from rarms_iac.storage import disk

KILLED = 137


class When(StrEnum):
    BEFORE = "before"
    HALF = "half"
    AFTER = "after"


class Crash(BaseException):
    """Stands for the end of the process in tests that go on in the same one."""


def end_process() -> NoReturn:
    os._exit(KILLED)


def crash() -> NoReturn:
    raise Crash


def _nothing() -> None:
    """Not done here."""


class UnflushedDisk(disk.FileEffects):
    """The real disk without flushes, which take long: a process that goes on reads what was written without them."""

    def flush(self, path: Path) -> None:
        pass

    def flush_folder(self, folder: Path) -> None:
        pass


class CrashingDisk(disk.FileEffects):
    """The real disk, up to the effect of this number (from 1; 0: never).

    Flushes are counted and not done: what a killed process wrote is there without them, and they take long.
    """

    def __init__(self, at: int, when: When = When.BEFORE, end: Callable[[], NoReturn] = crash) -> None:
        self.at = at
        self.when = when
        self.end = end
        self.effects: list[str] = []
        self._busy = False
        self._crashed = False
        self._real = disk.FileEffects()

    def make_folder(self, folder: Path) -> None:
        self._effect(f"make_folder {folder.name}", lambda: self._real.make_folder(folder))

    def write(self, path: Path, data: bytes) -> None:
        half = data[: len(data) // 2]
        self._effect(f"write {path.name}", lambda: self._real.write(path, data), lambda: self._real.write(path, half))

    def append(self, path: Path, data: bytes) -> None:
        half = data[: len(data) // 2]
        self._effect(
            f"append {path.name}", lambda: self._real.append(path, data), lambda: self._real.append(path, half)
        )

    def cut(self, path: Path, size: int) -> None:
        self._effect(f"cut {path.name}", lambda: self._real.cut(path, size))

    def flush(self, path: Path) -> None:
        self._effect(f"flush {path.name}", _nothing)

    def rename(self, source: Path, target: Path) -> None:
        self._effect(f"rename {target.name}", lambda: self._real.rename(source, target))

    def flush_folder(self, folder: Path) -> None:
        self._effect(f"flush_folder {folder.name}", _nothing)

    def remove(self, path: Path) -> None:
        self._effect(f"remove {path.name}", lambda: self._real.remove(path))

    def meet(self, name: str, do: Callable[[], None] = _nothing) -> None:
        """Do something that happens outside of this disk, and count it as an effect of it unless it is part of one."""
        if self._busy:
            do()
        else:
            self._effect(name, do)

    def _effect(self, name: str, do: Callable[[], None], half: Callable[[], None] = _nothing) -> None:
        if self._crashed:
            raise Crash  # clean-up of a process that has ended
        self.effects.append(name)
        self._busy = True
        try:
            if len(self.effects) != self.at:
                do()
                return
            if self.when is not When.BEFORE:
                (half if self.when is When.HALF else do)()
            self._crashed = self.end is crash
            self.end()
        finally:
            self._busy = False


def run_command(at: int, when: When, arguments: list[str]) -> int:
    """Run `rarms` with these arguments on a crashing disk; its exit code, unless it crashed."""
    failing = CrashingDisk(at, when, end_process)
    sys.argv = ["rarms", *arguments]
    try:
        with disk.use(failing):
            import_module("rarms_iac.cli.main").main()
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    finally:
        sys.stderr.write(f"effects: {len(failing.effects)}\n")
    return 0


if __name__ == "__main__":
    sys.exit(run_command(int(sys.argv[1]), When(sys.argv[2]), sys.argv[3:]))
