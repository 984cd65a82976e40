"""The way to a Hyper-V host over WinRM: the command that ssh starts there too, through the shell of pypsrp.

One thread sends and polls, since a connection of WinRM asks and is answered in turn. When rarms ends, the host is not
told: a script that changes something goes on to its end, and measuring, whose test partitions would stay, is refused.
"""

import os
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import replace
from queue import Empty, SimpleQueue
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

from rarms_iac.model.host import WinRmConnect
from rarms_iac.model.wording import reason_of
from rarms_iac.providers.channel import (
    KEPT_LINES,
    LAST_SECONDS,
    LONGEST_LINE,
    SSH_FAILED,
    CommandResult,
    SilenceTimeout,
    next_of,
)
from rarms_iac.providers.hyperv.bootstrap import WINDOWS_POWERSHELL, RemotePowerShell
from rarms_iac.providers.hyperv.script_session import Listener, ScriptSession, await_bootstrap, send_and_follow
from rarms_iac.providers.interface import HostFailed, HostUnreachable, ScriptBundle, ScriptExited, ScriptLost

if TYPE_CHECKING:
    from collections.abc import Callable

PORT = 5986
CONNECT_SECONDS = 15
POLL_SECONDS = 2
"""How long the host holds a question back that it has no answer to; what is sent waits so long at most."""
LARGEST_SEND = 64 * 2**10
"""Bytes of one message: WinRM takes 150 KiB of XML unless its host is told otherwise."""
UTF_8 = 65001

WAY = "WinRM"


class WinRmTransport:
    """Runs scripts through the shell of WinRM."""

    def __init__(self, host: str, connect: WinRmConnect) -> None:
        self._host = host
        self._connect = connect
        self._there = RemotePowerShell(connect.shell, connect.receiver)

    def run(
        self, script: ScriptBundle, arguments: Sequence[str], silence_s: float, listener: Listener
    ) -> ScriptExited | ScriptLost:
        """Nothing is sent before the other end says that it is ready."""
        with self._ready() as program:
            return send_and_follow(program, self._host, self._there.frame(script, arguments), silence_s, listener)

    def session(
        self,
        script: ScriptBundle,  # noqa: ARG002 - as the protocol has it
        arguments: Sequence[str],  # noqa: ARG002
    ) -> AbstractContextManager[ScriptSession]:
        raise HostFailed(
            self._host,
            "it cannot be measured over WinRM, which does not tell a host when rarms ends: test partitions would stay",
            "Reach it by ssh to measure (`connect: {ssh: user@host}`), or run rarms on the host itself.",
        )

    def in_windows_powershell(self) -> "WinRmTransport":
        return WinRmTransport(self._host, replace(self._connect, shell=WINDOWS_POWERSHELL))

    @contextmanager
    def _ready(self) -> "Iterator[RemoteProgram]":
        connect = self._connect
        target = connect.winrm
        with _program(self._host, target, lambda: _service(self._host, connect), self._there.words()) as program:
            await_bootstrap(program, self._host, target, self._there, WAY)
            yield program


class ServiceChannel:
    """A `CommandChannel` through a WinRM service that an engine reached with pypsrp, as Ansible's `psrp` does.

    Its commands are those of rarms, which end their input by a byte of their own: the service does not close it.
    """

    def __init__(self, host: str, target: str, reach: "Callable[[], Any]") -> None:
        """Prepare; `reach` returns pypsrp's `WSMan`, and is called for each command.

        Args:
            reach: raises what pypsrp does where the service is out of reach.
        """
        self._host = host
        self._target = target
        self._reach = reach

    @property
    def target(self) -> str:
        return self._target

    def run(self, command: str, data: bytes, silence_s: float) -> CommandResult:
        lines: list[str] = []
        with _program(self._host, self._target, self._reach, command.split(" ")) as program:
            program.send(data)
            try:
                while (line := program.next_line(silence_s, lambda: None)) is not None:
                    lines.append(line)
            except SilenceTimeout:
                message = f"{self._target} said nothing for {silence_s:.0f} s"
                raise HostFailed(self._host, message, "Look what runs there, then run it again.") from None
            code = program.code()
            return CommandResult(
                code=SSH_FAILED if code is None else code,
                output="\n".join([*lines, ""]),
                error="\n".join(program.error_lines),
            )


@contextmanager
def _program(host: str, target: str, reach: "Callable[[], Any]", words: Sequence[str]) -> "Iterator[RemoteProgram]":
    """Start a program in a shell of the service.

    Raises:
        HostFailed: pypsrp or the password is missing here, or the program cannot be started.
        HostUnreachable: the host is not reached, or does not let this user in.
    """
    try:
        from pypsrp.exceptions import WinRMError
        from pypsrp.shell import Process, WinRS
        from spnego.exceptions import SpnegoError
    except ImportError:
        message = "WinRM needs the Python package pypsrp, which is not installed here"
        raise HostFailed(
            host,
            message,
            "Install it from the clone: `pipx install --force '.[winrm]'`, or in its .venv: "
            "`.venv/bin/pip install -e '.[winrm]'`.",
        ) from None
    with ExitStack() as opened:
        try:
            shell = WinRS(reach(), codepage=UTF_8)
            shell.__enter__()
        except (WinRMError, SpnegoError, OSError) as error:
            advice = f"Try it by hand: `Test-WSMan -UseSSL -ComputerName {target}`; its certificate is checked."
            raise HostUnreachable(host, f"{WAY} does not reach {target}: {reason_of(error)}", advice) from None
        opened.callback(_close, shell)
        process = Process(shell, words[0], list(words[1:]))
        try:
            process.begin_invoke()
        except (WinRMError, OSError) as error:
            message = f"{words[0]} cannot be started on {target}: {reason_of(error)}"
            raise HostFailed(host, message, "Look into the host's log of WinRM, then run it again.") from None
        yield opened.enter_context(RemoteProgram(process))


def _close(shell: Any) -> None:
    """Close a shell, as far as the service still answers."""
    from pypsrp.exceptions import WinRMError

    with suppress(WinRMError, OSError):
        shell.__exit__(None, None, None)


def _service(host: str, connect: WinRmConnect) -> Any:
    """Return pypsrp's way to the service; nothing was sent.

    Raises:
        HostFailed: the password is missing here.
    """
    from pypsrp.wsman import WSMan

    return WSMan(
        connect.winrm,
        port=connect.port or PORT,
        username=connect.user,
        password=_password(host, connect),
        ssl=True,
        auth="negotiate" if connect.user else "kerberos",
        cert_validation=True,
        connection_timeout=CONNECT_SECONDS,
    )


def _password(host: str, connect: WinRmConnect) -> str | None:
    """Return the password.

    Raises:
        HostFailed: its variable is not set here.
    """
    if connect.password is None:
        return None
    name = connect.password.name
    if (value := os.environ.get(name)) is None:
        message = f"the variable {name}, which holds the password of {connect.user}, is not set here"
        raise HostFailed(host, message, f"Set {name} where rarms runs.")
    return value


class RemoteProgram:
    """A `Conversation` with a program that WinRM started. Use it as a context: when that ends, so does the program."""

    def __init__(self, process: Any) -> None:
        """Begin to ask for its output; `process` is pypsrp's, and was started."""
        self._process = process
        self._lines: SimpleQueue[bytes | None] = SimpleQueue()
        self._sending: SimpleQueue[bytes] = SimpleQueue()
        self._errors: deque[str] = deque(maxlen=KEPT_LINES)
        self._rest = b""
        self._broke = False
        self._leaving = Event()
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def __enter__(self) -> "RemoteProgram":
        return self

    def __exit__(self, *error: object) -> None:
        self._leaving.set()
        self._thread.join(LAST_SECONDS)

    @property
    def error_lines(self) -> tuple[str, ...]:
        return tuple(self._errors)

    def send(self, data: bytes) -> None:
        for at in range(0, len(data), LARGEST_SEND):
            self._sending.put(data[at : at + LARGEST_SEND])

    def next_line(self, silence_s: float, look: "Callable[[], None]") -> str | None:
        return next_of(self._lines, silence_s, look)

    def code(self) -> int | None:
        self._thread.join(LAST_SECONDS)
        if self._broke:
            return SSH_FAILED
        return None if self._thread.is_alive() else int(self._process.rc or 0)

    def _run(self) -> None:
        from pypsrp.exceptions import WinRMError
        from pypsrp.shell import CommandState, SignalCode

        try:
            while self._process.state != CommandState.DONE:
                if self._leaving.is_set():
                    self._process.signal(SignalCode.TERMINATE)
                    break
                with suppress(Empty):
                    while True:
                        self._process.send(self._sending.get_nowait(), end=False)
                self._process.poll_invoke(timeout=POLL_SECONDS)
                self._take()
        except (WinRMError, OSError) as error:
            self._broke = True
            self._errors.append(reason_of(error))
        finally:
            if self._rest:
                self._lines.put(self._rest)
            self._lines.put(None)

    def _take(self) -> None:
        """Take what came since the last question, line by line."""
        *lines, self._rest = (self._rest + self._process.stdout).split(b"\n")
        if len(self._rest) > LONGEST_LINE:
            lines, self._rest = [*lines, self._rest], b""
        for line in lines:
            self._lines.put(line)
        self._errors.extend(filter(None, map(str.strip, self._process.stderr.decode("utf-8", "replace").splitlines())))
        self._process.stdout = self._process.stderr = b""
