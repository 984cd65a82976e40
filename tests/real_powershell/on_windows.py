"""rarms on a Windows of the model: its own CPython and the real PowerShell that it starts, in one prefix of wine.

PowerShell's processes ask the model by the socket of the warm one; `wmi_server.py` answers what rarms asks of WMI.
"""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.fake_powershell.host import Entry, WindowsHost
from tests.fake_powershell.observing import document_of
from tests.fake_powershell.run import put
from tests.real_powershell.bridge import Conversation, Line
from tests.real_powershell.engines import SECONDS, Engine, finish, processes, windows_python
from tests.real_powershell.runner import RealPowerShell
from tests.real_powershell.wmi_server import wmi_of
from tests.remote import Ended

ENGINE_KEY = "HKLM:\\SOFTWARE\\Microsoft\\PowerShell\\3\\PowerShellEngine"
HYPERV_MODULE = "windows/system32/WindowsPowerShell/v1.0/Modules/Hyper-V/2.0.0.0/Hyper-V.psd1"
NOTHING = "nothing.ps1"


@dataclass(slots=True)
class Watched(Conversation):
    """A conversation that has something done as soon as so many effects were begun; the model is locked meanwhile."""

    at: int = -1
    do: Callable[[], None] = lambda: None
    begun: int = 0
    done: threading.Event = field(default_factory=threading.Event)

    def answer(self, asked: Line, connection: int) -> Line | None:
        before = len(self.host.effects)
        found = Conversation.answer(self, asked, connection)
        self.begun += len(self.host.effects) - before
        if 0 <= self.at < self.begun and not self.done.is_set():
            self.done.set()
            self.do()
        return found


class RarmsOnWindows:
    """`rarms` on a host of the model, in a folder with its manifest."""

    def __init__(self, real: RealPowerShell, folder: Path, talk: Watched, environment: Mapping[str, str]) -> None:
        self.engine, self.folder, self.talk = real.engine, folder, talk
        self._environment = environment

    def start(self, *words: str) -> subprocess.Popen[bytes]:
        """Start a command."""
        return self.python("-m", "rarms_iac.cli.main", *words)

    def python(self, *words: str) -> subprocess.Popen[bytes]:
        """Start the Windows CPython, which finds the package."""
        return self.engine.start(
            *words,
            program=windows_python(self.engine),
            folder=self.folder,
            environment=self._environment,
        )

    def rarms(self, *words: str) -> Ended:
        """Run a command to its end."""
        return finish(self.start(*words))

    def left_behind(self) -> list[str]:
        """Return what no run may leave: folders of scripts, and files of the lock or of a journal that never began."""
        scripts = self.engine.drive_c.glob("users/*/Temp/rarms-*")
        records = (self.engine.drive_c / "ProgramData" / "rarms").glob("*")
        kept = {"journal.jsonl", "journal.jsonl.old"}
        return sorted([*(path.name for path in scripts), *({path.name for path in records} - kept)])

    def watch(self, at: int, do: Callable[[], None]) -> threading.Event:
        """Have something done once `at` more effects were begun; the event says that it was."""
        self.talk.at, self.talk.begun, self.talk.do, self.talk.done = at, 0, do, threading.Event()
        return self.talk.done

    def kill(self, *names: str, word: str = "") -> None:
        """End all programs of these names by SIGKILL, such as `pwsh.exe`, that were started with a word."""
        for name in names:
            for number in self.running(name, word):
                with suppress(ProcessLookupError):
                    os.kill(number, signal.SIGKILL)

    def running(self, name: str, word: str = "") -> list[int]:
        """Return the programs of a name that rarms started, or a test for it; the warm PowerShell is none of them."""
        return [number for number in processes(self.engine, name) if _is_ours(number, word)]

    def wait_until(self, happened: Callable[[], bool]) -> None:
        """Wait for what programs do that no test has a hand on."""
        until = time.monotonic() + SECONDS
        while not happened():
            assert time.monotonic() < until, "it did not happen"
            time.sleep(0.1)


def _is_ours(number: int, word: str) -> bool:
    with suppress(FileNotFoundError, ProcessLookupError):
        folder = Path(f"/proc/{number}")
        is_asking = b"\0RARMS_TEST_WMI=" in (folder / "environ").read_bytes()
        return is_asking and word.encode() in (folder / "cmdline").read_bytes()
    return False


@contextmanager
def rarms_on(real: RealPowerShell, host: WindowsHost, folder: Path) -> Iterator[RarmsOnWindows]:
    """Lay out the files and the registry of a host, and let programs of rarms ask it while the context lasts."""
    furnish(real.engine, host)
    put(host, {NOTHING: b"exit 0\r\n"})
    laid = real.run(host, NOTHING)
    assert laid.code == 0, laid.says
    talk = Watched(host, real.disks)
    with real.answering(talk) as (port, turn):

        def look() -> Mapping[str, Any]:
            with turn:
                real.disks.read_back(host)
                return document_of(host)

        def owner(path: str) -> str:
            with turn:
                real.disks.read_back(host)
                file = host.file(path)
            assert file is not None, path
            return file.owner

        with wmi_of(real.engine, look, owner) as asks_wmi:
            yield RarmsOnWindows(real, folder, talk, {**by_environment(real, port), **asks_wmi})
    if talk.failed is not None:
        raise talk.failed


def furnish(engine: Engine, host: WindowsHost) -> None:
    """Give a host what rarms finds in every Windows: the name that wine has, and the Windows PowerShell in it."""
    for left in engine.drive_c.glob("users/*/Temp/rarms-*"):  # by a rarms that a test killed
        shutil.rmtree(left, ignore_errors=True)
    host.computer = socket.gethostname().upper()[:15]
    host.numa = host.numa or [{"memory": host.memory // 2**20, "memory_available": host.memory // 2**20}]
    version = Entry(name="PowerShellVersion", kind="String", data="5.1.26100.1")
    host.add_key(ENGINE_KEY).values[version.name.lower()] = version
    module = engine.drive_c / HYPERV_MODULE
    module.parent.mkdir(parents=True, exist_ok=True)
    module.touch()


def by_environment(real: RealPowerShell, port: int) -> Mapping[str, str]:
    """Return the variables by which every PowerShell that is started anywhere asks the model."""
    home, modules = Path(real.engine.program).parent, real.engine.path(real.modules)
    return {
        "RARMS_TEST_MODEL": str(port),
        "PSModulePath": f"{modules};{real.engine.path(home)}\\Modules",  # ours are found before PowerShell's own
        "DOTNET_STARTUP_HOOKS": f"{modules}\\RarmsModel\\RarmsModel.dll",
        "WINEPATH": real.engine.path(home),
    }
