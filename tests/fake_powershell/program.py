"""A stand-in for `pwsh`, as a program: the fake of this folder behind PowerShell's command line, on a host in a file.

    python -m tests.fake_powershell.program FOLDER -NoProfile ... -File SCRIPT.ps1 [-AsJson] [-Force] ...
    python -m tests.fake_powershell.program FOLDER -NoProfile ... -EncodedCommand BASE64
    python -m tests.fake_powershell.program FOLDER -NoProfile ... -File ...\\Modules\\Rarms\\receive.ps1 -Version V

It says on standard error that it is no PowerShell. The second form takes only rarms' own bootstrap, and does in Python
what that says. `FOLDER/how.json` may ask for noise, slowness, or for an end in the middle.
"""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import select
import shutil
import sys
import tempfile
import time
import traceback
from base64 import b64decode
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rarms_iac.providers.hyperv.transport import (
    ANSWERS,
    FAILED,
    FAILED_CODE,
    INSTALLED_FILE,
    NO_MORE,
    READY,
    command,
    render_receiver,
)
from rarms_iac.storage.codec import decode
from rarms_iac.storage.writing import Locked, hold
from tests.fake_powershell.compiling import compiled
from tests.fake_powershell.guests import drop_sessions
from tests.fake_powershell.host import Killed, WindowsHost
from tests.fake_powershell.run import FOLDER, walk
from tests.fake_powershell.scopes import Session
from tests.fake_powershell.signing import why_unsigned
from tests.fake_powershell.values import ScriptError

STAND_IN = "This is a stand-in of rarms' tests and no PowerShell."
STATE, HOW, LOCK = "host.pickle", "how.json", "lock"


@dataclass(frozen=True, slots=True)
class How:
    """What a test asks of it beside running scripts."""

    noise: tuple[str, ...] = ()  # on standard output, before anything else
    warnings: tuple[str, ...] = ()  # on standard error, before anything else
    step_ms: int = 0  # after every event
    silent_ms: int = 0  # before the script runs
    refuses: str = ""  # what PowerShell says instead of running a script
    installed: tuple[str, ...] = ()  # versions of the module Rarms that are there
    garbles: bool = False  # loses a byte of what it is sent
    meddles_with: str = ""  # the host or a machine, which another person changes between rarms' look and its script


def save(folder: Path, host: WindowsHost) -> None:
    """Keep the host, wholly or not at all."""
    fresh = folder / f"{STATE}.{os.getpid()}"
    fresh.write_bytes(host.as_bytes())
    fresh.replace(folder / STATE)


def load(folder: Path) -> WindowsHost:
    """The host as the last effect left it."""
    host = pickle.loads((folder / STATE).read_bytes())  # our own bytes, written by `save`
    assert isinstance(host, WindowsHost)
    return host


def ask(folder: Path, **how: object) -> None:
    """Have the stand-in behave so from now on."""
    (folder / HOW).write_text(json.dumps(how), encoding="utf-8")


def _asked(folder: Path) -> How:
    path = folder / HOW
    if not path.exists():
        return How()
    return decode(How, json.loads(path.read_text(encoding="utf-8")))


class Predictions(list[str]):
    """Lines that are on their way as soon as they are said."""

    def __init__(self, delay_ms: int) -> None:
        super().__init__()
        self.delay_ms = delay_ms

    def append(self, line: str) -> None:
        super().append(line)
        try:
            print(line, flush=True)
        except BrokenPipeError:  # who listened is gone; taken for an error of the script, whose `finally` then runs
            raise ScriptError("The pipe is being closed.", error_id="IOException") from None
        if self.delay_ms and '"rarms-event/1"' in line:
            time.sleep(self.delay_ms / 1000)


def main(arguments: Sequence[str]) -> int:
    """Run the script, or the bootstrap."""
    folder, *options = arguments
    how = _asked(Path(folder))
    print(STAND_IN, file=sys.stderr, flush=True)
    if "-EncodedCommand" in options:
        return bootstrap(Path(folder), how, options[options.index("-EncodedCommand") + 1])
    if INSTALLED_FILE in options:
        return installed(Path(folder), how, options[options.index("-Version") + 1])
    for line in how.noise:
        print(line, flush=True)
    for line in how.warnings:
        print(line, file=sys.stderr, flush=True)
    at = options.index("-File") + 1
    if how.refuses:
        print(how.refuses, file=sys.stderr)
        return 1
    time.sleep(how.silent_ms / 1000)
    return run_file(Path(folder), how, Path(options[at]), options[at + 1 :])


def run_file(folder: Path, how: How, script: Path, given: Sequence[str]) -> int:
    """The script on the fake: every effect is kept at once, so that an end at any time leaves what was done."""
    with lock(folder) as free:
        host = load(folder)
        host.lock = "" if free else "held"
        if not script.name.startswith("observe"):
            _meddle(host, how.meddles_with)
        for path in (*script.parent.glob("*.ps1"), *script.parent.glob("Rarms/*")):
            name = path.relative_to(script.parent).as_posix().replace("/", "\\")
            host.write_file(f"{FOLDER}\\{name}", path.read_bytes())

        def watch(changed: WindowsHost) -> None:
            if script.with_name(f"{script.name}.stop").exists():
                changed.write_file(f"{FOLDER}\\{script.name}.stop", b"")
            if free:
                save(folder, changed)

        def slept(waiting: WindowsHost) -> None:
            time.sleep(0.002)
            for suffix in (".stop", ".next"):
                if (sign := script.with_name(f"{script.name}{suffix}")).exists():
                    waiting.write_file(f"{FOLDER}\\{sign.name}", sign.read_bytes())

        host.watch, host.slept = watch, slept
        session = Session(host, windows_powershell=False, path=f"{FOLDER}\\{script.name}")
        session.unanswered = True
        session.output = Predictions(how.step_ms)
        file = host.file(session.path)
        assert file is not None
        assert file.data is not None
        if host.all_signed and (refusal := why_unsigned(file.data)):
            print(f"File {file.path} cannot be loaded. {refusal}", file=sys.stderr)
            return 1
        try:
            switches = ("asjson", "abandon", "force", "whatif")
            code = walk(
                session,
                compiled(file.data),
                {
                    **{switch: f"-{switch}" in map(str.lower, given) for switch in switches},
                    "locktimeout": _lock_timeout(given),
                },
            )
        except Killed:
            drop_sessions(session)
            save(folder, host)
            return 137
        for line in session.talk:
            print(line, file=sys.stderr)
        _tidy(host)
        if free:
            save(folder, host)
        return code


def _meddle(host: WindowsHost, name: str) -> None:
    """A person takes processors out of the host, or changes a machine's weight."""
    if name == "host":
        host.logical_processors -= 1
    for vm in host.vms.values():
        if vm.name == name:
            vm.weight += 1


def _lock_timeout(given: Sequence[str]) -> int:
    return int(given[given.index("-LockTimeout") + 1]) if "-LockTimeout" in given else 0


def _tidy(host: WindowsHost) -> None:
    """Scripts are no longer there once they ran."""
    for path in [path for path in host.files if path.startswith(FOLDER.lower() + "\\")]:
        del host.files[path]


@contextmanager
def lock(folder: Path) -> Iterator[bool]:
    """Whether this process alone runs a script on the host; let go of by its end, however it comes."""
    try:
        with hold(folder / LOCK, "the stand-in"):
            yield True
    except Locked:
        yield False


def bootstrap(folder: Path, how: How, encoded: str) -> int:
    """What the loader and bootstrap.ps1 say, in Python; nothing else is taken for them."""
    if b64decode(encoded).decode("utf-16-le") != command():
        print("only the loader of rarms is known here", file=sys.stderr)
        return 1
    print(READY, flush=True)
    if take(int(take(8))) != render_receiver():
        print(f"{FAILED} the receiver was damaged on its way: run the command again", flush=True)
        return FAILED_CODE
    return take_scripts(folder, how)


def installed(folder: Path, how: How, version: str) -> int:
    """What receive.ps1 says and the module of that version does, in Python."""
    if not how.installed:
        print(f"The argument '{INSTALLED_FILE}' is not recognized as the name of a script file.", file=sys.stderr)
        return 64
    if version not in how.installed:
        print(f"{ANSWERS}has {' '.join(how.installed)}", flush=True)
        return FAILED_CODE
    print(f"{ANSWERS}ready {version}", flush=True)
    return take_scripts(folder, how)


def take_scripts(folder: Path, how: How) -> int:
    """Receive them in a folder of their own, and run the first."""
    place = Path(tempfile.mkdtemp(prefix="rarms-"))
    try:
        arguments, script = receive(place, garbles=how.garbles)
    except ValueError as error:
        print(f"{FAILED} {error}", flush=True)
        shutil.rmtree(place)
        return FAILED_CODE
    try:
        return start(folder, script, arguments)
    finally:
        shutil.rmtree(place)


def start(folder: Path, script: Path, arguments: Sequence[str]) -> int:
    """Run it as a process of its own, and pass on a wish to stop."""
    (folder / "received").write_text(str(script.parent), encoding="utf-8")
    fixed = ["-NoProfile", "-NonInteractive", "-ExecutionPolicy", "RemoteSigned", "-File", str(script)]
    child = fork([str(folder), *fixed, *arguments])
    more = True
    while not (ended := os.waitpid(child, os.WNOHANG))[0]:
        if more and select.select([sys.stdin.buffer], [], [], 0.05)[0]:
            line = os.read(0, 4096).decode("ascii")
            if line == NO_MORE.decode("ascii"):
                more = False
                continue
            suffix = ".next" if line.endswith(".") else ".stop"
            script.with_name(f"{script.name}{suffix}").write_text(line, encoding="utf-8")
            more = bool(line)
        elif not more:
            time.sleep(0.05)
    return os.waitstatus_to_exitcode(ended[1])


def fork(arguments: Sequence[str]) -> int:
    """The id of a process that has these arguments, without what a second interpreter would import again."""
    child = os.fork()
    if child:
        return child
    code = 1
    try:
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        code = main(arguments)
    except Exception:  # noqa: BLE001  # any of them ends this process and does not reach the one it began as
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def receive(place: Path, *, garbles: bool = False) -> tuple[list[str], Path]:
    """The frame of standard input as files.

    Raises:
        ValueError: it is not as it was sent.
    """
    table = take(int(take(8))).decode("ascii").split("\n")
    paths: list[Path] = []
    for row in table[1:]:
        name, length, digest = row.split(" ")
        data = take(int(length))
        data = data[1:] if garbles else data
        if hashlib.sha256(data).hexdigest() != digest:
            raise ValueError(f"{name} is not what was sent")
        paths.append(place / name)
        paths[-1].parent.mkdir(exist_ok=True)
        paths[-1].write_bytes(data)
    return table[0].split(), paths[0]


def take(count: int) -> bytes:
    """So many bytes of standard input, unbuffered: what follows them is for later."""
    found = b""
    while len(found) < count:
        more = os.read(0, count - len(found))
        if not more:
            raise ValueError("the input ended too early")
        found += more
    return found


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
