"""Ways to a host: a program that was started, line by line, and a channel that runs one command.

`Conversation` is with a program that runs: what it writes, what it is sent, and whether it still lives; `Channel` is
one with a program of this computer. `CommandChannel` runs one command with standard input and returns its output, so
that any engine that reaches hosts can be one. Through a `LiveChannel` a command can also be talked with while it runs.

Threads read and write, so that neither side can block the other and the caller may look up now and then. The program
gets a process group of its own: Ctrl-C is for rarms, which then asks for an end after the running step. The system's
ssh is such a program, with the user's own configuration, keys and known hosts.
"""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from subprocess import PIPE
from types import TracebackType
from typing import Protocol

from rarms_iac.model.host import Connect
from rarms_iac.providers.interface import HostFailed, HostUnreachable
from rarms_iac.storage.reading import STATE_LIMIT
from rarms_iac.texts.messages import last_words, reason_of

CONTROL_PERSIST = "60s"
"""How long a shared connection outlives the last one that used it."""
SSH_FAILED = 255  # ssh's own exit code: it never got through, or the connection broke
CONNECT_SECONDS = 60.0
LOOK_AT_OUTPUT = "Check the login scripts of this user on the host: they must not print text."
LOOK_SECONDS = 0.1
LAST_SECONDS = 10.0  # for a program that has closed its output to end
ERROR_SECONDS = 1.0  # for what it said last to be read; a program that it started may keep the pipe open for ever
KEPT_LINES = 20
LONGEST_LINE = 64 * 2**20  # bytes: an observation is one line
_NOISE_LINES = 1_000  # of a login, before the answer of what was started


class SilenceTimeout(Exception):
    """Nothing came for so long."""


class Conversation(Protocol):
    """A program that was started, here or elsewhere."""

    @property
    def error_lines(self) -> tuple[str, ...]:
        """The last lines of its standard error."""

    def send(self, data: bytes) -> None:
        """Write to its standard input, after everything sent before. A program that does not read is not an error."""

    def close(self) -> None:
        """End its standard input, where the way can."""

    def next_line(self, silence_s: float, look: Callable[[], None]) -> str | None:
        """Return its next line without its end, None when there are no more; `look` is called while waiting.

        Raises:
            SilenceTimeout: nothing came for so long.
        """

    def code(self) -> int | None:
        """Return its exit code, once its output has ended: None where it lives on, `SSH_FAILED` where the way broke."""


def as_text(line: bytes) -> str:
    """Return a line in UTF-8, or else in the code page of a console of Windows, which most of its programs use.

    On Windows that is this computer's own code page; elsewhere 850, since the host's is not known.
    """
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("oem" if sys.platform == "win32" else "cp850", "replace")


class QueuedConversation:
    """The part of a `Conversation` whose lines another thread puts into a queue."""

    def __init__(self) -> None:
        self._lines: SimpleQueue[bytes | None] = SimpleQueue()  # with their ends; None: there are no more
        self._errors: deque[str] = deque(maxlen=KEPT_LINES)

    @property
    def error_lines(self) -> tuple[str, ...]:
        return tuple(self._errors)

    def next_line(self, silence_s: float, look: Callable[[], None]) -> str | None:
        until = time.monotonic() + silence_s
        while True:
            look()
            try:
                line = self._lines.get(timeout=LOOK_SECONDS)
            except Empty:
                if time.monotonic() >= until:
                    raise SilenceTimeout from None
                continue
            if line is None:
                self._lines.put(None)  # for whoever asks again
                return None
            return as_text(line).rstrip("\r\n")


class Channel(QueuedConversation):
    """A `Conversation` with a program of this computer. Use it as a context: when that ends, the program has ended too.

    Raises:
        OSError: it cannot be started.
    """

    def __init__(self, words: Sequence[str]) -> None:
        super().__init__()
        self._process, self._kill = _start(words)
        self._sending: SimpleQueue[bytes | None] = SimpleQueue()
        targets = (self._read, self._read_errors, self._write)
        self._threads = [threading.Thread(target=target, daemon=True) for target in targets]
        self._error_reader = self._threads[1]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> "Channel":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process.poll() is None:
            self._kill()  # and all that it started: what lives on would hold the pipes
        self.close()
        self._process.wait()
        # NOTE: a program that it started may live on and hold the pipes. Do not close them here: `close` would wait for
        # the thread that reads; each thread closes its own.
        for thread in self._threads:
            thread.join(ERROR_SECONDS)

    def send(self, data: bytes) -> None:
        self._sending.put(data)

    def close(self) -> None:
        self._sending.put(None)

    def code(self) -> int | None:
        try:
            code = self._process.wait(LAST_SECONDS)
        except subprocess.TimeoutExpired:
            return None
        self._error_reader.join(ERROR_SECONDS)
        return code

    def _read(self) -> None:
        assert self._process.stdout is not None, "it was started with a pipe"
        with self._process.stdout as pipe:
            while line := pipe.readline(LONGEST_LINE):
                self._lines.put(line)
        self._lines.put(None)

    def _read_errors(self) -> None:
        assert self._process.stderr is not None, "it was started with a pipe"
        with self._process.stderr as pipe:
            while line := pipe.readline(LONGEST_LINE):
                if text := as_text(line).strip():
                    self._errors.append(text)

    def _write(self) -> None:
        pipe = self._process.stdin
        assert pipe is not None, "it was started with a pipe"
        with contextlib.suppress(OSError):  # it ended without listening: its exit code says more
            while (data := self._sending.get()) is not None:
                pipe.write(data)
                pipe.flush()
        with contextlib.suppress(OSError):
            pipe.close()


if sys.platform == "win32":

    def _start(words: Sequence[str]) -> "tuple[subprocess.Popen[bytes], Callable[[], None]]":
        """Start the process in a job object, which ends all that it started; a script must outlive rarms."""
        import win32job

        group = subprocess.CREATE_NEW_PROCESS_GROUP
        process = subprocess.Popen(words, stdin=PIPE, stdout=PIPE, stderr=PIPE, creationflags=group)
        job = win32job.CreateJobObject(None, "")
        win32job.AssignProcessToJobObject(job, int(process._handle))  # noqa: SLF001 - no other object has it
        return process, lambda: win32job.TerminateJobObject(job, 1)

else:

    def _start(words: Sequence[str]) -> "tuple[subprocess.Popen[bytes], Callable[[], None]]":
        process = subprocess.Popen(words, stdin=PIPE, stdout=PIPE, stderr=PIPE, process_group=0)

        def kill() -> None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)

        return process, kill


def ssh_words(connect: Connect) -> tuple[str, ...]:
    """Return the argument list of ssh on this side, without the command; no shell reads it here."""
    options: dict[str, str | int | None] = {
        "BatchMode": "yes",
        "ConnectTimeout": 15,
        "ServerAliveInterval": 15,
        "ServerAliveCountMax": 4,
        "Port": connect.port,
        "IdentityFile": connect.key,
        "ProxyJump": connect.jump,
        "ControlPath": connect.control_path,
        "ControlMaster": "auto" if connect.control_path else None,
        "ControlPersist": CONTROL_PERSIST if connect.control_path else None,
    }
    words = [
        word for name, value in options.items() if value is not None for word in ("-o", f"{name}={_quoted(value)}")
    ]
    return ("ssh", "-T", *words, "--", connect.ssh)


def _quoted(value: str | int) -> str:
    """Return the value of an option as ssh reads a line of its configuration: a blank would end it."""
    return f'"{value}"' if " " in str(value) else str(value)


class WayChannel(Channel):
    """A `Channel` with a program, such as ssh, that leads elsewhere. Where a signal ends it, the way broke."""

    def code(self) -> int | None:
        code = super().code()
        return SSH_FAILED if code is not None and code < 0 else code


def open_channel(host: str, words: Sequence[str], kind: type[Channel] = Channel) -> Channel:
    """Start a program that leads to a host.

    Raises:
        HostUnreachable: it cannot be started.
    """
    try:
        return kind(words)
    except OSError as error:
        message = f"{words[0]} cannot be started: {reason_of(error)}"
        raise HostUnreachable(host, message, f"Install {words[0]}, or correct its rights.") from None


def no_look() -> None:
    """Do nothing while a line is waited for."""


def look_for_stop(should_stop: Callable[[], bool], stop: Callable[[], None]) -> Callable[[], None]:
    """Return a function to call while a line is waited for: it stops once, when it should."""
    has_stopped = False

    def look() -> None:
        nonlocal has_stopped
        if not has_stopped and should_stop():
            has_stopped = True
            stop()

    return look


def not_reached(host: str, target: str, error: str, way: str = "ssh") -> HostUnreachable:
    """Return the error of a host (its name in the manifest) to which a way, ssh or WinRM, does not lead."""
    by_hand = f"ssh -o BatchMode=yes {target}" if way == "ssh" else f"Test-WSMan -UseSSL -ComputerName {target}"
    advice = f"Test the connection: `{by_hand}`."
    return HostUnreachable(host, f"{way} does not reach {target}: {error}", advice)


def await_line(
    conversation: Conversation,
    host: str,
    channel: "CommandChannel",
    is_wanted: Callable[[str], bool],
    look: Callable[[], None] = no_look,
) -> str | None:
    """Wait for the line by which the other end says that it is ready; pass over what a login prints before.

    Args:
        is_wanted: whether a line is that line.

    Returns:
        The line; None: what was started there ended before.

    Raises:
        HostUnreachable: the way does not get through, or nothing came for `CONNECT_SECONDS`.
        HostFailed: it prints other lines without an end.
    """
    way = channel.way if isinstance(channel, LiveChannel) else "ssh"
    try:
        for _ in range(_NOISE_LINES):
            line = conversation.next_line(CONNECT_SECONDS, look)
            if line is None:
                break
            if is_wanted(line):
                return line
        else:
            message = f"{channel.target} printed {_NOISE_LINES:,} lines and did not start the command"
            raise HostFailed(host, message, LOOK_AT_OUTPUT)
    except SilenceTimeout:
        raise not_reached(host, channel.target, f"no answer within {CONNECT_SECONDS:.0f} s", way) from None
    if conversation.code() == SSH_FAILED:
        raise not_reached(host, channel.target, last_of(conversation.error_lines), way)
    return None


def last_of(lines: Sequence[str], code: int | None = None) -> str:
    """Return the last line; if there is none, how the program ended, as of `last_words`."""
    return last_words(lines[-1] if lines else "", code)


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandResult:
    """The end of a command on a host."""

    code: int
    output: str
    error: str  # the last lines of its standard error


class CommandChannel(Protocol):
    """Runs commands on a host, one after the other; nothing of one is left for the next."""

    @property
    def target(self) -> str:
        """The host as messages name it, such as `user@host`."""

    def run(self, command: str, data: bytes, silence_s: float) -> CommandResult:
        """Run one command, and return when it has ended.

        Args:
            command: for the shell that the host gives to this user; of Hyper-V cmd.exe or PowerShell.
            data: its whole standard input, which then ends.
            silence_s: seconds without output after which it is given up.

        Returns:
            Its exit code and output. `SSH_FAILED`: the connection was not made, or broke.

        Raises:
            HostUnreachable: the host cannot be asked; the command did not run.
            HostFailed: it did not answer in time; whether the command ran is not known.
        """


def one_command_only(host: str) -> HostFailed:
    """Return the refusal to talk with what runs on a host, through a channel that runs one command."""
    return HostFailed(
        host,
        "measuring needs a continuous connection to the host, but this connection runs one command at a time",
        "Run rarms on the host itself, or connect to it with ssh.",
    )


class EndedConversation:
    """A `Conversation` with a command that has ended."""

    def __init__(self, result: CommandResult) -> None:
        self._lines = iter(result.output.splitlines())
        self._code = result.code
        self.error_lines = tuple(filter(None, map(str.strip, result.error.splitlines())))

    def send(self, data: bytes) -> None:
        """Drop the data: it has ended."""

    def close(self) -> None:
        """Do nothing: it has ended."""

    def next_line(self, silence_s: float, look: Callable[[], None]) -> str | None:  # noqa: ARG002 - the protocol's
        return next(self._lines, None)

    def code(self) -> int | None:
        return self._code


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveChannel(ABC):
    """A `CommandChannel` through which a command can also be talked with while it runs."""

    host: str  # its name in the manifest
    target: str

    @property
    def way(self) -> str:
        """What messages call it."""
        return "ssh"

    @abstractmethod
    def open(self, command: str) -> AbstractContextManager[Conversation]:
        """Start a command, which ends with the context.

        Raises:
            HostUnreachable: the host cannot be asked.
        """

    @property
    def refusal_to_measure(self) -> HostFailed | None:
        """Why it cannot be measured through it: the host does not notice that rarms ends."""
        return None

    def run(self, command: str, data: bytes, silence_s: float) -> CommandResult:
        lines: list[str] = []
        size = 0
        with self.open(command) as program:
            program.send(data)
            program.close()
            try:
                while (line := program.next_line(silence_s, no_look)) is not None:
                    lines.append(line)
                    size += len(line)
                    if size > STATE_LIMIT:
                        message = (
                            f"the answer of {self.target} is not from rarms: it has more than {STATE_LIMIT:,} bytes"
                        )
                        raise HostFailed(self.host, message, LOOK_AT_OUTPUT)
            except SilenceTimeout:
                raise self._broken(f"no output for {silence_s:.0f} s") from None
            code = program.code()
            if code is None:
                raise self._broken("it does not end")
            return CommandResult(code=code, output="\n".join([*lines, ""]), error="\n".join(program.error_lines))

    def _broken(self, message: str) -> HostFailed:
        advice = "Run the same command again when the host is up."
        return HostFailed(self.host, f"the connection to {self.target} broke: {message}", advice)


@dataclass(frozen=True, slots=True, kw_only=True)
class ProgramChannel(LiveChannel):
    """A channel through a program, such as ssh, that takes the command as its last argument."""

    words: tuple[str, ...]

    def open(self, command: str) -> Channel:
        return open_channel(self.host, (*self.words, command), WayChannel)


def ssh_channel(host: str, connect: Connect) -> ProgramChannel:
    """Return the system's ssh as a channel."""
    return ProgramChannel(host=host, target=connect.ssh, words=ssh_words(connect))
