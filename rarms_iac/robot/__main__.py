"""Answers one request: `python -I -m rarms_iac.robot`, as root, from folders that only root can write to."""

import os
import signal
import stat
import sys
import threading
import traceback
from collections.abc import Iterable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from queue import SimpleQueue
from typing import BinaryIO

from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError, bug_finding, system_finding
from rarms_iac.applying import refusals
from rarms_iac.cli.ending import ExitCode, Interrupted, Interrupts
from rarms_iac.model.commands import Wording
from rarms_iac.model.version import __version__
from rarms_iac.providers.interface import HostRefused
from rarms_iac.providers.robot import (
    ALL_SENT,
    LINE_LIMIT,
    LOST_S,
    NO,
    READY,
    STOP,
    YES,
    Answer,
    Failure,
    Request,
    Result,
    line_of,
)
from rarms_iac.robot.caller import Caller
from rarms_iac.storage.codec import NotDecodable, decode
from rarms_iac.storage.json_text import parse_json
from rarms_iac.storage.reading import read_file
from rarms_iac.storage.writing import act_for

SETTINGS_FILE = Path("/etc/rarms/environment")
"""Variables of the robot, `NAME=VALUE` a line: what `from_env` reads there, and the key of plans."""

USUAL_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
_SETTINGS_BYTES = 2**20

PACKAGE = Path(__file__).parents[1]
"""The folder of rarms' own code."""

UNKNOWN_HOST = "the robot"
"""The name of this machine before a request gave its name in the manifest."""


MODULES = {"look": "look", "apply": "runs", "finish": "runs", "abandon": "runs", "undo": "runs"} | dict.fromkeys(
    ("measure", "tune", "prove", "run"), "experiments"
)
"""The module that has each command in its `COMMANDS`. A module is imported only if its command is requested."""


def main() -> int:
    """Answer one request. Return 0 if a result was sent."""
    output = os.dup(1)
    os.dup2(2, 1)  # other output must not come between the lines of the answer

    def send(answer: Answer) -> None:
        _write(output, line_of(answer))

    _write(output, f"{READY}\n".encode("ascii"))
    host, interrupts, ended = UNKNOWN_HOST, Interrupts(), threading.Event()
    signal.signal(signal.SIGHUP, lambda _number, frame: interrupts.receive(signal.SIGTERM, frame))
    try:
        with interrupts.listening():
            refuse_writable_code()
            set_environment(SETTINGS_FILE)
            request = read_request(sys.stdin.buffer)
            host = request.host.name
            act_for(request.by)
            # NOTE: Import before listening: Python ignores a signal's exception in some callbacks of an import.
            module = import_module(f"rarms_iac.robot.{MODULES[request.command]}")
            caller = Caller(send, interrupts, request.listens, SimpleQueue())
            threading.Thread(target=listen, args=(sys.stdin.buffer, caller, ended), daemon=True).start()
            result = module.COMMANDS[request.command](request.host, request.job, caller)
            ended.set()
        send(Result(value=result))
    except BaseException as error:  # noqa: BLE001 - the answer has each error
        ended.set()
        send(_failure_of(error, host))
        return 1
    return 0


def read_request(lines: BinaryIO) -> Request:
    """Read the line of a request.

    Raises:
        UseCaseError: it is not a request to this version (failed).
    """
    data = lines.readline(LINE_LIMIT + 1)
    if not data.endswith(b"\n"):
        raise _unreadable(f"it is not one line of at most {LINE_LIMIT:,} bytes")
    try:
        request = decode(Request, parse_json(data.decode("utf-8")))
    except (NotDecodable, UnicodeDecodeError) as problem:
        raise _unreadable(str(problem)) from None
    if request.version != __version__ or request.command not in MODULES:
        message = f"the request {request.command[:20]} is for rarms {request.version[:20]}; this is rarms {__version__}"
        raise _refused(message, "Install the same version on this computer and on the robot.")
    return request


def refuse_writable_code(package: Path = PACKAGE, paths: Iterable[str] = (sys.executable, *sys.path)) -> None:
    """Refuse to run code that users other than root can change: each file of the package, and where Python looks.

    Raises:
        UseCaseError: this is not root, or others can write to a file or to a folder above it (failed).
    """
    refuse_writable((str(package), *(path for path in paths if path and Path(path).exists())))
    for folder, folders, names in os.walk(package.resolve()):
        _refuse_writable(Path(folder, name) for name in (*folders, *names))


def refuse_writable(paths: Iterable[str]) -> None:
    """Refuse files and folders that users other than root can change.

    Args:
        paths: each counts with all folders above it, where links lead to, too.

    Raises:
        UseCaseError: this is not root, or others can write to one of them (failed).
    """
    if os.geteuid() != 0:
        raise _refused("this user is not root", "Connect as root, or by sudo (docs/linux.md).")
    resolved = [Path(path).resolve() for path in paths]
    _refuse_writable(dict.fromkeys(part for path in resolved for part in (path, *path.parents)))


def _refuse_writable(parts: Iterable[Path]) -> None:
    for part in parts:
        try:
            status = part.stat()
        except FileNotFoundError:  # Python writes bytecode under another name first
            continue
        others = stat.S_IWOTH if status.st_gid == 0 else stat.S_IWOTH | stat.S_IWGRP
        if status.st_uid != 0 or status.st_mode & others:
            raise _refused(
                f"users other than root may write to {part}, so rarms does not run as root there",
                f"Allow only root to write: `chown root:root {part}` and `chmod go-w {part}`.",
            )


def set_environment(file: Path) -> None:
    """Set the variables of the robot's file. Without a file, only PATH is set.

    Raises:
        UseCaseError: the file is not root's alone to write, or has a line that is not `NAME=VALUE` (failed).
    """
    os.environ.setdefault("PATH", USUAL_PATH)
    if not file.exists():
        return
    refuse_writable([str(file)])
    for number, line in enumerate(read_file(file, _SETTINGS_BYTES).decode("utf-8", "surrogateescape").splitlines(), 1):
        name, equals, value = line.strip().partition("=")
        if not name or name.startswith("#"):
            continue
        if not equals:
            raise _refused(f"line {number} of {file} is not NAME=VALUE", "Correct that line.")
        os.environ[name] = value


def listen(lines: BinaryIO, caller: Caller, ended: threading.Event, lost_s: float = LOST_S) -> None:
    """Read the lines of the other side until its input or the command ends.

    The end of its input, or a long time without a line, stops the command as SIGTERM does. This does not happen after
    the line `ALL_SENT` or `STOP`.

    Args:
        lines: its input behind the request.
        caller: gets the answers to questions.
        ended: set once the command has ended.
        lost_s: seconds of silence after which a side that listens is gone.
    """
    heard, complete = threading.Event(), threading.Event()
    if caller.listens:
        threading.Thread(target=_end_when_lost, args=(heard, complete, ended, lost_s), daemon=True).start()
    while (line := lines.readline(64)) and not ended.is_set():
        heard.set()
        match line.decode("ascii", "replace").strip():
            case text if text == STOP:
                os.kill(os.getpid(), signal.SIGINT)
                complete.set()  # a connection that is closed after that asks for nothing more
            case text if text == ALL_SENT:
                complete.set()
            case text if text in {YES, NO}:
                caller.answers.put(text == YES)
    caller.answers.put(False)
    _end_once(complete, ended)


def _end_when_lost(heard: threading.Event, complete: threading.Event, ended: threading.Event, lost_s: float) -> None:
    while heard.wait(lost_s):
        heard.clear()
    _end_once(complete, ended)


def _end_once(complete: threading.Event, ended: threading.Event) -> None:
    """Stop the command after the running step; a second signal would end that step, too."""
    if not complete.is_set() and not ended.is_set():
        complete.set()
        os.kill(os.getpid(), signal.SIGTERM)


def _write(output: int, line: bytes) -> None:
    """Write a line, and ignore a closed connection: `listen` detects it at the end of the input."""
    data = memoryview(line)
    with suppress(OSError):
        while data:
            data = data[os.write(output, data) :]


def _failure_of(error: BaseException, host: str) -> Failure:
    if isinstance(error, UseCaseError):
        return Failure(outcome=error.outcome.value, findings=tuple(error.findings))
    if isinstance(error, RequestError):
        return _failure_of(_refused(error.message, error.advice, host), host)
    if isinstance(error, Interrupted) and error.code is ExitCode.INTERRUPTED:  # the other side asked for it
        return Failure(outcome=Outcome.INTERRUPTED.value, findings=())
    if isinstance(error, Interrupted):
        stopped = HostRefused(host, "rarms was terminated on the host", "Run the same command again to continue.")
        return Failure(outcome=Outcome.INTERRUPTED.value, findings=(refusals.host_failed(stopped),))
    traceback.print_exception(error)
    finding = system_finding(error) if isinstance(error, OSError) else bug_finding(error)
    return Failure(outcome=Outcome.FAILED.value, findings=(finding,))


def _unreadable(why: str) -> UseCaseError:
    return _refused(f"the request cannot be read: {why}", "rarms starts this program. Do not start it by hand.")


def _refused(message: str, advice: Wording, host: str = UNKNOWN_HOST) -> UseCaseError:
    return UseCaseError(Outcome.FAILED, [refusals.host_failed(HostRefused(host, message, advice))])


if __name__ == "__main__":
    sys.exit(main())
