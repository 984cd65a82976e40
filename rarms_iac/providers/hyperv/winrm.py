"""The channel to a Hyper-V host over WinRM: the command that ssh starts there too, through the shell of pypsrp.

One thread sends and polls, since a connection of WinRM asks and is answered in turn. When rarms ends, the host gets
no message: a script that changes something runs to its end. Measuring is refused, as its test partitions would stay.
"""

import os
import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

from rarms_iac.model.host import WinRmConnect
from rarms_iac.providers.channel import (
    LAST_SECONDS,
    LONGEST_LINE,
    SSH_FAILED,
    LiveChannel,
    QueuedConversation,
    as_text,
    not_reached,
)
from rarms_iac.providers.interface import HostFailed
from rarms_iac.texts.messages import reason_of

if TYPE_CHECKING:
    from collections.abc import Callable

PORT = 5986
CONNECT_SECONDS = 15
POLL_SECONDS = 2
"""How long the host holds a question back that it has no answer to; what is sent waits so long at most."""
LARGEST_SEND = 64 * 2**10
"""Bytes of one message: WinRM takes 150 KiB of XML unless its host is configured otherwise."""
UTF_8 = 65001
_WORDS = re.compile(r'"[^"]*"|\S+')


@dataclass(frozen=True, slots=True, kw_only=True)
class ServiceChannel(LiveChannel):
    """A channel through a WinRM service: rarms' own way to it, or that of an engine, as Ansible's `psrp` has it.

    What is called through it ends its input by a byte of its own: the service does not close it.
    """

    reach: "Callable[[], Any]"
    """Returns pypsrp's `WSMan`; is called for each command, and raises what pypsrp does where it is out of reach."""

    @property
    def way(self) -> str:
        return "WinRM"

    @property
    def refusal_to_measure(self) -> HostFailed:
        return HostFailed(
            self.host,
            (
                "rarms cannot measure over WinRM: the host cannot detect the end of rarms, so test partitions "
                "could remain"
            ),
            "To measure, connect with ssh (`connect: {ssh: user@host}`), or run rarms on the host itself.",
        )

    @contextmanager
    def open(self, command: str) -> "Iterator[RemoteProgram]":
        """Start a command in a shell of the service.

        Raises:
            HostFailed: pypsrp or the password is missing here, or the command cannot be started.
            HostUnreachable: the host is not reached, or does not let this user in.
        """
        try:
            from pypsrp.exceptions import WinRMError
            from pypsrp.shell import Process, WinRS
            from spnego.exceptions import SpnegoError
        except ImportError:
            message = "WinRM needs the Python package pypsrp, which is not installed here"
            raise HostFailed(
                self.host,
                message,
                "Install it from the clone: `pipx install --force '.[winrm]'`. In the clone's .venv: "
                "`.venv/bin/pip install -e '.[winrm]'`.",
            ) from None
        with ExitStack() as opened:
            try:
                shell = WinRS(self.reach(), codepage=UTF_8)
                shell.__enter__()
            except (WinRMError, SpnegoError, OSError) as error:
                raise not_reached(self.host, self.target, reason_of(error), self.way) from None
            opened.callback(_close, shell)
            program, *arguments = _WORDS.findall(command)
            process = Process(shell, program, arguments)
            try:
                process.begin_invoke()
            except (WinRMError, OSError) as error:
                message = f"{program} cannot be started on {self.target}: {reason_of(error)}"
                raise HostFailed(
                    self.host, message, "Check the WinRM log of the host, then run the same command again."
                ) from None
            yield opened.enter_context(RemoteProgram(process))


def winrm_channel(host: str, connect: WinRmConnect) -> ServiceChannel:
    """Return rarms' own way to the service of a host (its name in the manifest)."""
    return ServiceChannel(host=host, target=connect.winrm, reach=lambda: _service(host, connect))


def _close(shell: Any) -> None:
    """Close a shell, as far as the service still answers."""
    from pypsrp.exceptions import WinRMError

    with suppress(WinRMError, OSError):
        shell.__exit__(None, None, None)


def _service(host: str, connect: WinRmConnect) -> Any:
    """Return pypsrp's way to the service; nothing was sent.

    Raises:
        HostFailed: the variable with the password is not set here.
    """
    from pypsrp.wsman import WSMan

    name = connect.password.name if connect.password else ""
    if name and name not in os.environ:
        message = f"the variable {name} for the password of {connect.user} is not set here"
        raise HostFailed(host, message, f"Set {name} in the environment of rarms.")
    return WSMan(
        connect.winrm,
        port=connect.port or PORT,
        username=connect.user,
        password=os.environ[name] if name else None,
        ssl=True,
        auth="negotiate" if connect.user else "kerberos",
        cert_validation=True,
        connection_timeout=CONNECT_SECONDS,
    )


class RemoteProgram(QueuedConversation):
    """A `Conversation` with a program that WinRM started. Use it as a context: when that ends, so does the program."""

    def __init__(self, process: Any) -> None:
        """Begin to ask for its output; `process` is pypsrp's, and was started."""
        super().__init__()
        self._process = process
        self._sending: SimpleQueue[bytes] = SimpleQueue()
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

    def send(self, data: bytes) -> None:
        for at in range(0, len(data), LARGEST_SEND):
            self._sending.put(data[at : at + LARGEST_SEND])

    def close(self) -> None:
        """Do nothing: the service has no end of input."""

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
        self._errors.extend(filter(None, map(str.strip, as_text(self._process.stderr).splitlines())))
        self._process.stdout = self._process.stderr = b""
