"""`rarms studio` as a process in trouble: strangers that take connections, and signals while it measures."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest

from tests.needs import CHECKOUT
from tests.unit.studio.studio_client import Client

pytestmark = pytest.mark.needs("posix")

LONGEST = 120.0
RARMS = (sys.executable, "-m", "rarms_iac.cli.main")
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
    rarms(tmp_path, "apply", "--auto-approve")
    return tmp_path


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(CHECKOUT)}


def rarms(folder: Path, *words: str) -> str:
    done = subprocess.run([*RARMS, *words], cwd=folder, env=environment(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@contextmanager
def studio(folder: Path) -> Iterator[tuple["subprocess.Popen[str]", Client]]:
    """In a process with few descriptors; its client has the cookie."""
    words = [sys.executable, "-c", LIMITED]
    server = subprocess.Popen(
        words, cwd=folder, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert server.stdout is not None
        client = Client(address=server.stdout.readline().strip())
        client.enter()
        yield server, client
    finally:
        server.kill()
        server.communicate(timeout=LONGEST)


def settings_in(folder: Path) -> int:
    logs = (folder / "measurements").glob("*/*/*.jsonl")
    return sum(path.read_text(encoding="utf-8").count('","reserve":') for path in logs)


def waits_for_settings(folder: Path, number: int) -> None:
    until = time.monotonic() + LONGEST
    while settings_in(folder) < number:
        assert time.monotonic() < until
        time.sleep(0.05)


def partitions(folder: Path) -> dict[str, bool]:
    """Whether each runs."""
    status = json.loads(rarms(folder, "status", "--json"))
    return {partition["name"]: partition["running"] for host in status["hosts"] for partition in host["partitions"]}


def test_strangers_that_only_connect_end_no_measurement_and_lock_its_user_not_out(folder: Path) -> None:
    import resource

    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    with studio(folder) as (server, client), ExitStack() as strangers:
        assert client.post("do/measure", MEASURE).status == 200
        waits_for_settings(folder, 1)
        assert server.stderr is not None
        for _ in range(2000):
            stranger = strangers.enter_context(socket.socket())
            stranger.setblocking(False)
            stranger.connect_ex(("127.0.0.1", client.port))
        recorded = settings_in(folder)
        waits_for_settings(folder, recorded + 2)
        assert len(list(Path(f"/proc/{server.pid}/fd").iterdir())) < DESCRIPTORS
        assert client.get().status == 200
        assert client.work()["ending"] == "", "it goes on"
        server.send_signal(signal.SIGINT)
        _, talk = server.communicate(timeout=LONGEST)
        assert server.returncode == 0
        assert "Invalid" not in talk
        assert "Too many open files" not in talk


def test_a_connection_that_says_nothing_ends(folder: Path) -> None:
    with studio(folder) as (_server, client), socket.create_connection(("127.0.0.1", client.port)) as silent:
        silent.settimeout(LONGEST)
        silent.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n")  # a head without an end
        began = time.monotonic()
        with suppress(ConnectionResetError):
            assert silent.recv(1) == b""
        assert time.monotonic() - began < 30


@pytest.mark.parametrize("signals", [1, 2])
def test_ctrl_c_ends_a_measurement_as_in_a_terminal(folder: Path, signals: int) -> None:
    with studio(folder) as (server, client):
        assert client.post("do/measure", MEASURE).status == 200
        waits_for_settings(folder, 1)
        for _ in range(signals):
            server.send_signal(signal.SIGINT)
            time.sleep(0.1)
        _, talk = server.communicate(timeout=LONGEST)
        assert "A second Ctrl-C stops at once" in talk
        assert "Traceback" not in talk
        assert server.returncode in ({0} if signals == 1 else {0, 130})
    if signals == 2:
        rarms(folder, "start", "--auto-approve")  # what a second Ctrl-C may have left
    assert partitions(folder) == {"control": True}, "test partitions are gone, and what was stopped runs again"


def test_ctrl_c_with_nothing_running_closes_at_once_and_promises_no_step(folder: Path) -> None:
    with studio(folder) as (server, client):
        assert client.get().status == 200
        server.send_signal(signal.SIGINT)
        _, talk = server.communicate(timeout=LONGEST)
        assert server.returncode == 0
        assert "The studio is closed." in talk
        assert "running step" not in talk


def test_a_body_that_never_ends_is_refused_and_one_that_is_broken_off_is_no_news(folder: Path) -> None:
    with studio(folder) as (server, client):
        head = (
            f"POST {client.path}do/plan HTTP/1.1\r\nHost: 127.0.0.1:{client.port}\r\nCookie: {client.cookie}\r\n"
            f"Origin: {client.origin}\r\nContent-Type: application/json\r\nContent-Length: 50\r\n\r\n{{"
        ).encode()
        with socket.create_connection(("127.0.0.1", client.port)) as leaving:
            leaving.sendall(head)
            time.sleep(0.5)
        with socket.create_connection(("127.0.0.1", client.port)) as trickling:
            trickling.settimeout(LONGEST)
            trickling.sendall(head)
            assert trickling.recv(4096).startswith(b"HTTP/1.1 408")
            while trickling.recv(4096):
                pass  # until the server ends it
        server.send_signal(signal.SIGINT)
        _, talk = server.communicate(timeout=LONGEST)
        assert "Traceback" not in talk
