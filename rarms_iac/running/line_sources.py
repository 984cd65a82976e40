"""Reads a component's lines from a file that it appends to, or from a Unix socket that it writes to.

In: a `StartOrder` that names one. Out: events, as `LineCutter` makes them of a stream. Begin at `source_of`.
"""

import os
import selectors
import socket
import stat
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from rarms_iac.running.events import Event, LineCutter
from rarms_iac.running.orders import CannotStart, StartOrder
from rarms_iac.texts.messages import reason_of

PIECE = 64 * 1024
LOOK_S = 0.005
"""How often a file is looked at: its samples are known so much later."""

Take = Callable[[list[Event | dict[str, Any]]], None]


class LineSource(Protocol):
    """A place that lines come from."""

    def read(self, take: Take) -> None:
        """Hand over events until it is closed; runs in a thread."""

    def close(self) -> None:
        """Stop reading. May be called twice."""


def source_of(order: StartOrder) -> LineSource | None:
    """Return the place that an order's lines come from; None: the standard streams.

    Raises:
        CannotStart: the socket cannot be made.
    """
    if order.socket is not None:
        return SocketLines(order.name, order.socket)
    return None if order.file is None else FileLines(order.file)


class FileLines:
    """The lines that are appended to a file from now on; it need not be there yet, and may be replaced."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._closed = threading.Event()
        self._read_until = self._size()
        self._cutter = LineCutter()
        self._file: int | None = None

    def read(self, take: Take) -> None:
        try:
            while not self._closed.wait(LOOK_S):
                while piece := self._next():
                    if events := self._cutter.cut(piece, time.perf_counter()):
                        take(events)
        finally:
            if self._file is not None:
                os.close(self._file)

    def close(self) -> None:
        self._closed.set()

    def _next(self) -> bytes:
        """Return what was written since; a file that is new, or shorter than before, from its beginning."""
        try:
            if self._file is not None and not self._is_same(self._file):
                os.close(self._file)
                self._file, self._read_until, self._cutter = None, 0, LineCutter()
            if self._file is None:
                self._file = os.open(
                    self._path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0)
                )
            if os.fstat(self._file).st_size < self._read_until:
                self._read_until = 0
            os.lseek(self._file, self._read_until, os.SEEK_SET)
            piece = os.read(self._file, PIECE)
        except OSError:
            return b""
        self._read_until += len(piece)
        return piece

    def _is_same(self, file: int) -> bool:
        try:
            return os.path.samestat(os.fstat(file), self._path.stat())
        except FileNotFoundError:
            return True  # it was removed, and has no successor yet

    def _size(self) -> int:
        try:
            return self._path.stat().st_size
        except OSError:
            return 0


class SocketLines:
    """The lines that are written to a Unix socket (a stream), by any number of connections."""

    def __init__(self, component: str, path: Path) -> None:
        self._path = path
        self._closed = threading.Event()
        self._listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            if path.exists() and stat.S_ISSOCK(path.stat().st_mode):
                path.unlink()  # a killed run left it behind
            mask = os.umask(0o111)  # the component may be another user; a later chmod would follow a link of that user
            try:
                self._listening.bind(str(path))
            finally:
                os.umask(mask)
            self._listening.listen()
            self._listening.setblocking(False)
        except OSError as problem:
            self._listening.close()
            advice = "Its folder must exist, and its path can have at most about 100 characters."
            raise CannotStart(component, f"its socket {path}: {reason_of(problem)}", advice) from problem

    def read(self, take: Take) -> None:
        cutters: dict[socket.socket, LineCutter] = {}
        with selectors.DefaultSelector() as ready, self._listening:
            ready.register(self._listening, selectors.EVENT_READ)
            while not self._closed.is_set():
                for key, _ in ready.select(timeout=0.1):
                    if key.fileobj is self._listening:
                        connection, _ = self._listening.accept()
                        ready.register(connection, selectors.EVENT_READ)
                        cutters[connection] = LineCutter()
                        continue
                    assert isinstance(key.fileobj, socket.socket)
                    if not (piece := _received(key.fileobj)):
                        ready.unregister(key.fileobj)
                        cutters.pop(key.fileobj)
                        key.fileobj.close()
                    elif events := cutters[key.fileobj].cut(piece, time.perf_counter()):
                        take(events)
            for connection in cutters:
                connection.close()

    def close(self) -> None:
        self._closed.set()
        self._path.unlink(missing_ok=True)


def _received(connection: socket.socket) -> bytes:
    try:
        return connection.recv(PIECE)
    except OSError:
        return b""
