"""`rarms studio` as a process in trouble: strangers that take connections, and signals while it measures."""

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from tests.needs import CHECKOUT
from tests.unit.cli.running import rarms
from tests.unit.studio.studio_client import Client

pytestmark = pytest.mark.needs("posix")

LONGEST = 120.0
DESCRIPTORS = 128
MANIFEST = """\
schema: rarms/v1
application: { name: cell }
hosts:
  onboard: { logical_processors: 2, memory: 4 GiB }
policy: { interference: [busy-loop] }
components:
  control:
    criticality: 20
    apt: { mean_response_time: { at_most: 60 ms } }
    run: { command: [control], until: { samples: 2000 }, samples: { from: per_run } }
    cpu: { reserve: 30 % }
    memory: 512 MiB
    simulation: { work: 20 ms, varies: 10 % }
"""
"""A component whose settings take a second each."""
MEASURE = {"components": ["control"], "first": 10, "last": 80, "step": 1, "stop_partitions": True}
LIMITED = (
    f"import resource, sys; resource.setrlimit(resource.RLIMIT_NOFILE, ({DESCRIPTORS}, {DESCRIPTORS})); "
    "from rarms_iac.cli.main import main; sys.exit(main(['studio', '--no-open']))"
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    assert rarms("apply", "--auto-approve", "-f", str(tmp_path)).code == 0
    return tmp_path


@contextmanager
def studio(folder: Path) -> Iterator[tuple["subprocess.Popen[str]", Client]]:
    """In a process with few descriptors; its client has the cookie."""
    words = [sys.executable, "-c", LIMITED]
    environment = {**os.environ, "PYTHONPATH": str(CHECKOUT)}
    server = subprocess.Popen(
        words, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert server.stdout is not None
        client = Client(address=server.stdout.readline().strip())
        client.enter()
        yield server, client
    finally:
        server.kill()
        server.communicate(timeout=LONGEST)


def setting(state: Mapping[str, Any]) -> str:
    """The setting that is measured; empty: none is."""
    return str(state["current"][1]) if "samples" in str(state["current"]) else ""


def partitions(folder: Path) -> dict[str, bool]:
    """Whether each runs."""
    status = json.loads(rarms("status", "--json", "-f", str(folder)).out)
    return {partition["name"]: partition["running"] for host in status["hosts"] for partition in host["partitions"]}


def test_mere_connections_end_no_measurement(folder: Path) -> None:
    import resource

    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    with studio(folder) as (server, client), ExitStack() as strangers:
        assert client.post("do/measure", MEASURE).status == 200
        first = setting(client.first(setting))
        for _ in range(1000):
            stranger = strangers.enter_context(socket.socket())
            stranger.setblocking(False)
            stranger.connect_ex(("127.0.0.1", client.port))
        assert client.first(lambda state: setting(state) not in {"", first})["ending"] == "", "it goes on"
        assert len(list(Path(f"/proc/{server.pid}/fd").iterdir())) < DESCRIPTORS
        assert client.get().status == 200
        server.send_signal(signal.SIGINT)
        _, talk = server.communicate(timeout=LONGEST)
    assert server.returncode == 0
    assert "A second Ctrl-C stops at once" in talk
    assert not [word for word in ("Traceback", "Invalid", "Too many open files") if word in talk]
    assert partitions(folder) == {"control": True}, "test partitions are gone, and what was stopped runs again"


def test_second_ctrl_c_ends_measurement_at_once(folder: Path) -> None:
    with studio(folder) as (server, client):
        assert client.post("do/measure", MEASURE).status == 200
        client.first(setting)
        server.send_signal(signal.SIGINT)
        assert server.stderr is not None
        said = next(line for line in server.stderr if "Ctrl-C" in line)
        server.send_signal(signal.SIGINT)
        _, talk = server.communicate(timeout=LONGEST)
    assert "A second Ctrl-C stops at once" in said
    assert "Traceback" not in talk
    assert server.returncode in {0, 130}
    rarms("start", "--auto-approve", "-f", str(folder))  # what a second Ctrl-C may have left
    assert partitions(folder) == {"control": True}


def test_silent_and_half_connections_end(folder: Path) -> None:
    with studio(folder) as (server, client):
        head = (
            f"POST {client.path}do/plan HTTP/1.1\r\nHost: 127.0.0.1:{client.port}\r\nCookie: {client.cookie}\r\n"
            f"Origin: {client.origin}\r\nContent-Type: application/json\r\nContent-Length: 50\r\n\r\n{{"
        ).encode()
        address = ("127.0.0.1", client.port)
        with socket.create_connection(address) as leaving:
            leaving.sendall(head)
        with socket.create_connection(address) as silent, socket.create_connection(address) as trickling:
            for connection in (silent, trickling):
                connection.settimeout(LONGEST)
            silent.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n")  # a head without an end
            trickling.sendall(head)
            with suppress(ConnectionResetError):
                assert silent.recv(1) == b""
            assert trickling.recv(4096).startswith(b"HTTP/1.1 408")
            while trickling.recv(4096):
                pass  # until the server ends it
        assert client.get().status == 200
        server.send_signal(signal.SIGINT)
        _, talk = server.communicate(timeout=LONGEST)
    assert server.returncode == 0
    assert "The studio is closed." in talk
    assert not [words for words in ("Traceback", "running step") if words in talk], "no step runs"
