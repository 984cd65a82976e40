"""Finds the real PowerShell and starts it: that for Windows (under wine, or on Windows itself) and that for Linux.

$RARMS_PWSH names the program of PowerShell for Linux, $RARMS_PWSH_WINDOWS that for Windows (`pwsh.exe`). Where a
variable is not set, `pwsh` on the PATH is the engine of the system that runs the tests. `scripts/make-powershell` makes
both. Under wine each process of tests has a prefix of its own: a registry and a drive C: that nobody else uses.
"""

import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from tests.effort import LONG
from tests.needs import CHECKOUT, LINUX_ENGINE, WINDOWS_ENGINE, WINDOWS_PYTHON, named_engine
from tests.remote import Ended

if sys.platform != "win32":
    import fcntl
    import pty

CACHE = CHECKOUT / ".cache" / "powershell"
MACHINE_GUID = "6f9619ff-8b86-4d01-b42d-00c04fc964ff"
SECONDS = 1800 if LONG else 120
"""What a program may take; the long run may have the processors beside others."""
SERVED_S = 1800
"""How long a Windows under wine stays up when nothing runs in it."""
STARTS = 3
DRIVES = "de"
"""Letters of the drives beside C: and Z: of a Windows under wine; empty folders beside that of drive C:."""
_PLAIN = {"POWERSHELL_TELEMETRY_OPTOUT": "1", "POWERSHELL_UPDATECHECK": "Off", "NO_COLOR": "1"}
_UNDER_WINE = {
    "WINEARCH": "win64",
    "WINEDEBUG": "-all",
    "TERM": "xterm",
    "PSExecutionPolicyPreference": "RemoteSigned",
    **dict.fromkeys(("DOTNET_TieredPGO", "DOTNET_gcConcurrent"), "0"),  # less processor time
    "DOTNET_EnableWriteXorExecute": "0",  # else the runtime dies at a collection of garbage
    "DOTNET_SYSTEM_GLOBALIZATION_INVARIANT": "1",  # else comparing by culture takes minutes
    "DOTNET_SYSTEM_GLOBALIZATION_PREDEFINED_CULTURES_ONLY": "0",
}
_NOISE = "wine: Read access denied for device"  # said when a program asks for the label of drive Z:


@dataclass(frozen=True, slots=True, kw_only=True)
class Engine:
    """A PowerShell that can be started."""

    program: str
    is_windows: bool
    prefix: Path | None = None
    """The folder of wine's registry and drive C:, if wine runs it."""
    settings: Mapping[str, str] = field(default_factory=dict)
    """Environment variables that it needs."""

    @property
    def drive_c(self) -> Path:
        """Return the folder that is drive C: of a Windows under wine."""
        assert self.prefix is not None, "only wine has its drive C: in a folder"
        return self.prefix / "drive_c"

    def path(self, path: Path) -> str:
        """Return the path as a program of this engine reads it."""
        return "Z:" + str(path.absolute()).replace("/", "\\") if self.prefix else str(path.absolute())

    def start(
        self,
        *words: str,
        program: str = "",
        folder: Path | None = None,
        environment: Mapping[str, str] | None = None,
        with_input: bool = False,
    ) -> subprocess.Popen[bytes]:
        """Start a PowerShell with pipes for its output, in a group of processes of its own.

        Under wine one of its three streams is a terminal: PowerShell ends silently where it has no console, and the
        Windows CPython takes neither a file nor a terminal for its output. Programs that it starts share this console.

        Args:
            words: its arguments.
            program: another program of its system that is started instead, such as that of `windows_python`.
            environment: variables beside those of this process and of the engine.
            with_input: its standard input is a pipe; standard error is then the terminal, and nobody reads it.
        """
        command = [program or self.program, *words]
        surroundings = {**os.environ, **_PLAIN, **self.settings, **(environment or {})}
        pipe = subprocess.PIPE
        if not self.prefix:
            given = pipe if with_input else subprocess.DEVNULL
            return subprocess.Popen(
                command, stdin=given, stdout=pipe, stderr=pipe, cwd=folder, env=surroundings, start_new_session=True
            )
        with _a_terminal() as terminal:
            return subprocess.Popen(
                ["wine", *command],
                stdin=pipe if with_input else terminal,
                stdout=pipe,
                stderr=terminal if with_input else pipe,
                cwd=folder,
                env=surroundings,
                start_new_session=True,
            )

    def run(
        self, *words: str, program: str = "", folder: Path | None = None, environment: Mapping[str, str] | None = None
    ) -> Ended:
        """Start a PowerShell as `start` does, and return how it ended."""
        return finish(self.start(*words, program=program, folder=folder, environment=environment))

    def answer(self, command: str) -> str:
        """Return what a command of PowerShell says.

        A PowerShell that loses its console while it starts, which wine does now and then, ends without a word; it is
        started again. That is nothing for what a test is about: a script that ends so is a fault.
        """
        words, starts = ("-NoProfile", "-NonInteractive", "-Command", command), 1
        ended = self.run(*words)
        while not (ended.out + ended.err).strip() and starts < STARTS:
            ended, starts = self.run(*words), starts + 1
        assert (ended.code, bool(ended.out.strip())) == (0, True), ended
        return ended.out.strip()


def finish(process: subprocess.Popen[bytes], seconds: float = SECONDS) -> Ended:
    """Wait for a program that an engine started. One that does not end in time is killed, which fails the test."""
    try:
        out, err = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        raise AssertionError(f"it did not end within {seconds} s: {process.communicate()}") from None
    lines = (err or b"").decode("utf-8", "replace").splitlines()
    return Ended(process.returncode, out.decode("utf-8", "replace"), "\n".join(x for x in lines if _NOISE not in x))


def kill(process: subprocess.Popen[bytes]) -> None:
    """End a program that an engine started, with all its group, by SIGKILL."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    with suppress(subprocess.TimeoutExpired):  # wine's server keeps the pipes of a process whose end it missed
        process.communicate(timeout=10)


@contextmanager
def _a_terminal() -> Iterator[int]:
    """Make a terminal for a program: what is written there is dropped, until the last program has closed it."""
    ours, theirs = pty.openpty()
    threading.Thread(target=_drain, args=(ours,), daemon=True).start()
    try:
        yield theirs
    finally:
        os.close(theirs)


def _drain(terminal: int) -> None:
    with suppress(OSError):  # EIO: nobody has the other end any more
        while os.read(terminal, 65536):
            pass
    os.close(terminal)


def linux_engine() -> Engine:
    """Return PowerShell for Linux; the test needs `powershell-linux`."""
    return Engine(
        program=named_engine(LINUX_ENGINE), is_windows=False, settings={"DOTNET_SYSTEM_GLOBALIZATION_INVARIANT": "1"}
    )


@contextmanager
def windows_engine() -> Iterator[Engine]:
    """Return PowerShell for Windows, under wine with a prefix that is removed afterwards.

    The test needs `powershell-windows`.
    """
    program = named_engine(WINDOWS_ENGINE)
    if sys.platform == "win32":
        yield Engine(program=program, is_windows=True)
        return
    with _a_prefix() as prefix:
        settings = {**_UNDER_WINE, "WINEPREFIX": str(prefix)}
        yield Engine(program=program, is_windows=True, prefix=prefix, settings=settings)


def windows_python(engine: Engine) -> str:
    """Return the CPython for Windows, for `Engine.start`; the test needs `windows-python`."""
    return str(WINDOWS_PYTHON) if engine.prefix else sys.executable


def _wine(prefix: Path, *words: str) -> None:
    """Run a program of wine that shows nothing; no pipe, because wine's own services would keep it open."""
    null = subprocess.DEVNULL
    surroundings = {**os.environ, **_UNDER_WINE, "WINEPREFIX": str(prefix)}
    subprocess.run(words, stdin=null, stdout=null, stderr=null, env=surroundings, timeout=SECONDS)


@contextmanager
def _a_prefix() -> Iterator[Path]:
    """Make a prefix as new, and keep its services running; the files of Windows are links, which takes no time."""
    fresh = _fresh_prefix()
    _remove_left_prefixes()
    prefix = CACHE / f"prefix-{os.getpid()}"
    shutil.copytree(fresh, prefix, symlinks=True, copy_function=_link_or_copy)
    for letter in DRIVES:  # no program of wine sees a drive that comes later
        (prefix / f"drive_{letter}").mkdir()
        (prefix / "dosdevices" / f"{letter}:").symlink_to(f"../drive_{letter}")
    # Else each start boots the prefix. After less, the first start behind other tests would boot it again, and have the
    # services of Windows in the group of processes that its test may kill.
    _wine(prefix, "wineserver", f"-p{SERVED_S}")
    _wine(prefix, "wine", "cmd", "/c", "exit")
    try:
        yield prefix
    finally:
        _remove_prefix(prefix)


def _link_or_copy(source: str, target: str) -> None:
    if "/drive_c/windows/" in source:
        os.link(source, target)
    else:
        shutil.copy2(source, target)


def _fresh_prefix() -> Path:
    """Return a prefix that no test uses, made at the first call: it takes ten seconds."""
    CACHE.mkdir(parents=True, exist_ok=True)
    fresh, begun = CACHE / "prefix", CACHE / "prefix.begun"
    with (CACHE / "prefix.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not fresh.is_dir():
            shutil.rmtree(begun, ignore_errors=True)
            _wine(begun, "wine", "wineboot", "-i")
            _wine(begun, "wine", "reg", "add", r"HKCU\Software\Wine", "/v", "Version", "/d", "win10", "/f")
            guid = ("/v", "MachineGuid", "/d", MACHINE_GUID, "/f")
            _wine(begun, "wine", "reg", "add", r"HKLM\SOFTWARE\Microsoft\Cryptography", *guid)
            _wine(begun, "wineserver", "-k")
            _wine(begun, "wineserver", "-w")  # it writes the registry when it ends
            begun.rename(fresh)
    return fresh


def _remove_left_prefixes() -> None:
    """Remove the prefixes of tests that were killed."""
    for prefix in CACHE.glob("prefix-*"):
        try:
            os.kill(int(prefix.name.removeprefix("prefix-")), 0)
        except ProcessLookupError:
            _remove_prefix(prefix)


def _remove_prefix(prefix: Path) -> None:
    _wine(prefix, "wineserver", "-k")
    _wine(prefix, "wineserver", "-w")
    shutil.rmtree(prefix, ignore_errors=True)


def processes(engine: Engine, name: str) -> Sequence[int]:
    """Return the programs of an engine's prefix with this file name, such as `pwsh.exe`, oldest first."""
    assert engine.prefix is not None, "a prefix tells its programs from others"
    mark = f"WINEPREFIX={engine.prefix}\0".encode()
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes().split(b"\0")
            is_ours = mark in (folder / "environ").read_bytes()
        except (FileNotFoundError, PermissionError, ProcessLookupError):
            continue  # it ended meanwhile, or belongs to another user
        if is_ours and any(word.replace(b"\\", b"/").rpartition(b"/")[2] == name.encode() for word in words[:2]):
            found.append(int(folder.name))
    return sorted(found)
