"""A studio that is served in this process, and a client that sends exactly what it is told."""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.client import HTTPConnection
from pathlib import Path
from queue import Queue
from threading import Event, Thread
from typing import Any
from urllib.parse import urlsplit

from rarms_iac.app.requests import ManifestSource
from rarms_iac.studio.page import StudioSettings
from rarms_iac.studio.server import serve
from tests.robots import a_measured, a_robot_of

LONGEST = 60.0

TIGHT = a_robot_of(
    a_measured("vision", criticality=30, at_most="24 ms", processors=1),
    a_measured("speech", criticality=10, at_most="27 ms", processors=1),
    a_measured("talk", criticality=5, at_most="30 ms", processors=1),
    name="tight",
)
"""Three components that do not fit together at these levels."""


class Closing:
    """A `StopSignal` that a test gives."""

    def __init__(self) -> None:
        self.asked = Event()

    def should_stop(self) -> bool:
        return self.asked.is_set()

    @contextmanager
    def gently(self) -> Iterator[None]:
        yield


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    status: int
    headers: Mapping[str, str]
    text: str

    @property
    def data(self) -> dict[str, object]:
        data = json.loads(self.text)
        assert isinstance(data, dict)
        return data


@dataclass(slots=True, kw_only=True)
class Client:
    """Keeps the cookie that it was given, as a browser does."""

    address: str
    cookie: str = ""
    path: str = field(init=False)
    port: int = field(init=False)

    def __post_init__(self) -> None:
        parts = urlsplit(self.address)
        self.port = parts.port or 0
        self.path = parts.path.removesuffix("enter")

    @property
    def origin(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def send(self, method: str, path: str, headers: Mapping[str, str], body: bytes = b"") -> Answer:
        """Only these headers, beside the length of the body and the host where none is named."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=LONGEST)
        try:
            connection.putrequest(method, path, skip_host="Host" in headers, skip_accept_encoding=True)
            for name, value in headers.items():
                connection.putheader(name, value)
            if body and "Content-Length" not in headers:
                connection.putheader("Content-Length", str(len(body)))
            connection.endheaders(body or None)
            answer = connection.getresponse()
            return Answer(status=answer.status, headers=dict(answer.getheaders()), text=answer.read().decode())
        finally:
            connection.close()

    def enter(self) -> Answer:
        parts = urlsplit(self.address)
        answer = self.send("GET", f"{parts.path}?{parts.query}", {})
        self.cookie = answer.headers.get("set-cookie", "").partition(";")[0]
        return answer

    def get(self, name: str = "", **headers: str) -> Answer:
        return self.send("GET", self.path + name, {"Cookie": self.cookie, **headers})

    def post(self, name: str, body: object) -> Answer:
        headers = {"Cookie": self.cookie, "Origin": self.origin, "Content-Type": "application/json"}
        return self.send("POST", self.path + name, headers, json.dumps(body).encode())

    def work(self, ending: str | None = None) -> dict[str, object]:
        """The work that the next events tell of; with `ending`: the first that ended so, or in any way (`*`)."""

        def is_wanted(state: Mapping[str, Any]) -> bool:
            return ending is None or state["ending"] == ending or (ending == "*" and bool(state["ending"]))

        return self.first(is_wanted)

    def first(self, is_wanted: Callable[[Mapping[str, Any]], object]) -> dict[str, Any]:
        """Wait for the first work of which the events tell that is as wanted."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=LONGEST)
        try:
            connection.request("GET", f"{self.path}events", headers={"Cookie": self.cookie})
            lines = connection.getresponse()
            while line := lines.readline():
                if line.startswith(b'data: {"number"'):
                    state = json.loads(line.removeprefix(b"data: "))
                    assert isinstance(state, dict)
                    if is_wanted(state):
                        return state
            raise AssertionError("the events ended")
        finally:
            connection.close()


@contextmanager
def studio(folder: Path, *, read_only: bool = False) -> Iterator[Client]:
    """A studio on the manifest of a folder, which no browser entered yet."""
    addresses: Queue[str] = Queue()
    closing = Closing()
    settings = StudioSettings(source=ManifestSource(manifest=str(folder)), read_only=read_only)
    thread = Thread(target=serve, args=(settings, closing, addresses.put))
    thread.start()
    try:
        yield Client(address=addresses.get(timeout=LONGEST))
    finally:
        closing.asked.set()
        thread.join()
