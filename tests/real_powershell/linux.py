"""A host of the model for processes of PowerShell for Linux, which `csharp/linux/` makes think they are on Windows.

Each is a process of its own, as a user starts it: with a console, a profile, over ssh, and it can be killed. Begin with
`a_host`.
"""

from __future__ import annotations

import itertools
import os
import re
import shlex
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from rarms_iac.storage.writing import hold
from tests.fake_powershell.host import Entry, Key, Opened, WindowsHost
from tests.fake_powershell.run import FOLDER
from tests.fake_powershell.values import ScriptError
from tests.real_powershell.bridge import Bridge, Conversation, Line
from tests.real_powershell.disks import Disks
from tests.real_powershell.engines import DRIVES, Engine
from tests.real_powershell.runner import HERE, made_modules
from tests.remote import Ended, Remote, a_server, write_script

if sys.platform != "win32":
    import pty


@dataclass(slots=True)
class LinuxConversation(Conversation):
    """Answers what processes on Linux ask the model for, since they have no Windows: registry, open files, account."""

    handles: dict[str, tuple[int, Opened]] = field(default_factory=dict)  # with the connection of who opened it
    numbers: Iterator[int] = field(default_factory=lambda: itertools.count(1))

    def answer(self, asked: Line, connection: int) -> Line | None:
        match next(iter(asked)):
            case "effect":
                return Conversation.answer(self, {"effect": self._as_on_windows(asked["effect"])}, connection)
            case "key":
                return read_key(self.host, asked["key"])
            case "registry":
                return self._may_fail(lambda: change_registry(self.host, asked))
            case "open":
                return self._may_fail(lambda: self._open(asked["open"], asked["rights"], connection))
            case "close":
                self.host.close(self.handles.pop(asked["close"])[1])
                return {}
            case _:
                return Conversation.answer(self, asked, connection)

    def _as_on_windows(self, says: str) -> str:
        """An effect with the path that Windows has: here it has slashes, or begins with the drive's folder."""
        plain = re.sub(f"{re.escape(str(self.disks.prefix))}/drive_([a-z])", lambda found: found[1].upper() + ":", says)
        return plain.replace("/", "\\")

    def gone(self, connection: int) -> None:
        """A process has ended: what it had open is closed."""
        for number in [number for number, (owner, _) in self.handles.items() if owner == connection]:
            self.host.close(self.handles.pop(number)[1])

    def _open(self, path: str, rights: list[str], connection: int) -> Line:
        access, share = (frozenset(re.findall("read|write|delete", words.lower())) for words in rights)
        if not access:
            self.host.require_unheld(path)
            return {"handle": None}  # it is gone at once
        number = str(next(self.numbers))
        self.handles[number] = connection, self.host.open(path, access, share)
        return {"handle": number}


def read_key(host: WindowsHost, path: str) -> Line:
    """A key with the names of those below it; nothing where it is not there. The root is always there."""
    key = host.key(path)
    if key is None and not path.endswith(":"):
        return {}
    values = key.values.values() if key else ()
    return {
        "values": [[one.name, one.kind, str(one.data)] for one in values],
        "below": [one.path.rpartition("\\")[2] for one in host.below(path)],
    }


def change_registry(host: WindowsHost, asked: Line) -> Line:
    """What a cmdlet writes; its effect was announced by the cmdlet."""
    cmdlet, path, name = asked["registry"], asked["path"], asked.get("name", "")
    if not host.elevated and path.upper().startswith("HKLM:"):
        says = f"Requested registry access to {path} is not allowed."
        raise ScriptError(says, error_id="PermissionDenied", category="PermissionDenied")
    key = host.key(path) or Key(path=path)
    match cmdlet:
        case "New-Item":
            host.add_key(path)
        case "Remove-Item":
            del host.registry[path.lower()]
        case "New-ItemProperty":
            kept, kind = key.values.get(name.lower()), asked["kind"]
            data = int(asked["data"]) if kind in ("DWord", "QWord") else asked["data"]
            key.values[name.lower()] = Entry(name=kept.name if kept else name, kind=kind, data=data)
        case "Remove-ItemProperty":
            del key.values[name.lower()]
        case _:
            raise AssertionError(cmdlet)
    return {}


class LinuxBridge(Bridge):
    """Hears when a process is gone."""

    def _serve(self, connection: socket.socket) -> None:
        number = connection.fileno()
        super()._serve(connection)
        with self.turn:
            if isinstance(self.talk, LinuxConversation):
                self.talk.gone(number)
        connection.close()


@dataclass(frozen=True, slots=True)
class LinuxHost:
    """A host that processes of PowerShell find around them."""

    engine: Engine
    folder: Path
    bridge: LinuxBridge
    talk: LinuxConversation
    environment: Mapping[str, str]  # of each process on this host

    @property
    def host(self) -> WindowsHost:
        """The model as it is now, with the files that scripts wrote."""
        with self.bridge.turn:
            self.talk.disks.read_back(self.talk.host)
            if self.talk.failed is not None:
                raise self.talk.failed
            return self.talk.host.copy(effects=list(self.talk.host.effects), watch=None)

    def watch(self, look: Callable[[WindowsHost], None] | None) -> None:
        """Have this called after each effect, while the process that made it waits."""
        with self.bridge.turn:
            self.talk.host.watch = look

    def here(self, path: str) -> Path:
        """Where a file of the host lies on this machine."""
        return self.talk.disks.place(path)

    def run(self, name: str, *arguments: str, profile: str = "") -> Ended:
        """Run a script of the host as a user does: `-NonInteractive -File`; a profile is that of all hosts."""
        script = str(self.here(f"{FOLDER}\\{name}"))
        words = ("-NonInteractive", "-File", script, *arguments)
        if not profile:
            return self.engine.run("-NoProfile", *words, folder=self.folder, environment=self.environment)
        file = self.folder / "powershell" / "profile.ps1"
        file.parent.mkdir(exist_ok=True)
        file.write_text(profile, encoding="ascii")
        environment = {**self.environment, "XDG_CONFIG_HOME": str(self.folder)}
        return self.engine.run(*words, folder=self.folder, environment=environment)

    def answer(self, name: str, *arguments: str, answers: str) -> Ended:
        """Run a script in a terminal, where a person types these letters, one at each prompt."""
        ours, theirs = pty.openpty()
        words = (self.engine.program, "-NoProfile", "-File", str(self.here(f"{FOLDER}\\{name}")), *arguments)
        environment = {**os.environ, **self.environment, "TERM": "dumb"}
        with subprocess.Popen(words, stdin=theirs, stdout=theirs, stderr=theirs, env=environment) as process:
            os.close(theirs)
            said = b""
            left = list(answers)
            try:
                while more := _read(ours):
                    if WHERE in more:
                        os.write(ours, more.count(WHERE) * b"\x1b[24;1R")
                    said += more.replace(WHERE, b"")
                    if left and said.rstrip().endswith(PROMPT):
                        os.write(ours, left.pop(0).encode() + b"\n")
                        said += b"\n"
            finally:
                os.close(ours)
        assert not left, f"{left} were not asked for: {said.decode()}"
        return Ended(process.returncode, said.decode("utf-8", "replace"), "")


PROMPT = b'(default is "Y"):'
WHERE = b"\x1b[6n"
"""What a console asks its terminal: where the cursor is."""


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 65536)
    except OSError:  # EIO: nobody has the other end any more
        return b""


@contextmanager
def over_ssh(there: LinuxHost) -> Iterator[Remote]:
    """Have an sshd in front of this host."""
    lines = [f"export {name}={shlex.quote(value)}" for name, value in there.environment.items()]
    write_script(there.folder / "there" / "pwsh", "\n".join([*lines, f'exec {there.engine.program} "$@"']))
    with a_server(there.folder) as remote:
        yield remote


@contextmanager
def a_host(engine: Engine, host: WindowsHost, folder: Path) -> Iterator[LinuxHost]:
    """Have this host on drives in a folder."""
    modules = _compiled(engine)
    drives = folder / "drives"
    for letter in ("c", *DRIVES):
        (drives / f"drive_{letter}").mkdir(parents=True)
    disks = Disks(drives)
    disks.begin(host)
    (drives / "drive_c" / "Temp").mkdir()
    bridge = LinuxBridge()
    talk = LinuxConversation(host, disks)
    bridge.talk = talk
    environment = {
        **engine.settings,
        **dict.fromkeys(("DOTNET_TieredPGO", "DOTNET_gcConcurrent"), "0"),  # a fifth less processor time
        "DOTNET_STARTUP_HOOKS": str(modules / "RarmsModel" / "RarmsModel.dll"),
        "PSModulePath": str(modules),
        "RARMS_TEST_MODEL": str(bridge.port),
        "RARMS_TEST_DRIVES": str(drives),
        "OS": "Windows_NT",
        "ProgramData": "C:\\ProgramData",
        "NO_COLOR": "1",
        "POWERSHELL_TELEMETRY_OPTOUT": "1",
    }
    try:
        yield LinuxHost(engine, folder, bridge, talk, environment)
    finally:
        bridge.close()


def _compiled(engine: Engine) -> Path:
    """The folder of the compiled modules; the first process of tests compiles them."""
    modules = made_modules(linux=True)
    with hold(modules.with_name("lock"), "a test", 120_000):
        ended = engine.run(
            *("-NoProfile", "-NonInteractive", "-File", str(HERE / "csharp" / "compile.ps1")),
            *("-Sources", str(modules.with_name("sources")), "-Modules", str(modules)),
        )
    assert ended.code == 0, ended
    return modules
