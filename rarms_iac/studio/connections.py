"""How many connections the server keeps, and for how long: the loopback interface is open to all users of a machine.

Each connection takes a descriptor of the process that measures. So there are few of them; those that sent no request
yet end first, and none waits for its first request for long. What the guard refuses ends with its answer.
"""

import asyncio
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.model.wording import reason_of

LOOPBACK = "127.0.0.1"
MOST_CONNECTIONS = 32
"""A browser opens at most six to a server."""
MOST_ACCEPTED = 8
"""At once, before they are counted: the rest waits in the kernel, where it takes no descriptor."""
REQUEST_SECONDS = 10.0
"""For the head of the first request."""


class BoundedProtocol(H11Protocol):
    """HTTP/1.1 with a bound of connections, and a deadline for the first request of each."""

    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override] # as uvicorn has it
        """Take it; where there are too many, the one that has said nothing for longest ends."""
        super().connection_made(transport)
        self._deadline = self.loop.call_later(REQUEST_SECONDS, self._end_silence)
        living = [each for each in self.connections if not each.transport.is_closing()]
        if len(living) > MOST_CONNECTIONS:
            silent = [each for each in living if isinstance(each, BoundedProtocol) and each.is_silent]
            min(silent, key=lambda each: each.deadline).transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        super().connection_lost(exc)
        if self._deadline is not None:
            self._deadline.cancel()

    @property
    def is_silent(self) -> bool:
        """Whether no request came yet."""
        return self.cycle is None

    @property
    def deadline(self) -> float:
        """When its first request must have come, by the loop's clock."""
        return self._deadline.when() if self._deadline else 0.0

    def _end_silence(self) -> None:
        if self.is_silent:
            self.transport.abort()


class StudioServer(uvicorn.Server):
    """uvicorn without signals of its own: the command line has them, and hands them over as a `StopSignal`."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Take none over.

        Yields:
            Once, with nothing.
        """
        yield


def bind(port: int) -> socket.socket:
    """Take a port of the loopback interface.

    Args:
        port: 0: any that is free.

    Returns:
        A socket that listens.

    Raises:
        RequestError: it is taken.
    """
    bound = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if sys.platform == "win32":  # without it another process could take the same port
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
    else:  # without it a port stays taken for a minute after its last connection; on Windows it means something else
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        bound.bind((LOOPBACK, port))
        bound.listen(MOST_ACCEPTED)  # now: two sockets may be bound to a port as long as neither listens
    except OSError as error:
        bound.close()
        raise RequestError(f"Port {port} cannot be taken: {reason_of(error)}. Choose another with --port.") from error
    return bound
