"""Containers by a small `docker` of files, and a daemon that makes them: their variables and their end."""

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.model.run import Container, Run, Stop
from rarms_iac.running import supervisor, supervisor_process
from rarms_iac.running.orders import CannotStart, StartContext
from rarms_iac.running.start import order_of
from tests.unit.running.programs import JSON_LINES, a_run, component, ms

pytestmark = pytest.mark.needs("linux")

DOCKER = f"""#!{sys.executable} -IS
import json, os, sys, time
from pathlib import Path
here, words = Path(__file__).parent, sys.argv[1:]
option = lambda name: next(word.partition("=")[2] for word in words if word.startswith(name + "="))
with open(here / "said", "a") as said:
    said.write(json.dumps(words) + chr(10))
if words[0] != "run":
    (here / "containers" / words[-1]).unlink(missing_ok=True)
    sys.exit()
file, container = Path(option("--env-file")), here / "containers" / option("--name")
seen = [os.getpid(), str(file), file.stat().st_mode & 0o777, file.read_text(), *os.environ]
(here / "client").write_text(json.dumps(seen))
(here / "requests" / option("--name")).touch()
while not container.exists():
    time.sleep(0.01)
while container.exists():
    print('{{"ms": 5}}', flush=True)
    time.sleep(0.02)
sys.exit(137)
"""
"""It ends with its container, as docker's own does; a container is a file."""


@pytest.fixture
def engine(tmp_path: Path) -> Path:
    """The folder of the program, which is on the PATH of rarms."""
    for name in ("containers", "requests"):
        (tmp_path / name).mkdir()
    (tmp_path / "docker").write_text(DOCKER, encoding="utf-8")
    (tmp_path / "docker").chmod(0o755)
    return tmp_path


@contextmanager
def daemon(engine: Path, delay_s: float) -> Iterator[None]:
    """Make the container of each request, so long after it."""
    ended = threading.Event()

    def work() -> None:
        while not ended.wait(0.01):
            for request in sorted((engine / "requests").iterdir()):
                request.unlink()
                ended.wait(delay_s)
                (engine / "containers" / request.name).touch()

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def in_docker(*, stop: Stop | None = None, until: int = 3, failures: int = 0) -> Run:
    run = a_run((), samples=JSON_LINES, until=until, stop=stop, failures=failures)
    return replace(run, container=Container(engine="docker", image="vision"))


def own_environment(engine: Path) -> dict[str, str]:
    return {"PATH": f"{engine}:{os.environ['PATH']}"}


def client(engine: Path) -> list[object]:
    until = time.monotonic() + 20
    while not (engine / "client").exists() and time.monotonic() < until:
        time.sleep(0.01)
    time.sleep(0.05)
    found: list[object] = json.loads((engine / "client").read_text(encoding="utf-8"))
    return found


def test_variables_of_a_container_are_in_a_file(engine: Path) -> None:
    run = replace(in_docker(), environment={"LD_PRELOAD": "/x.so", "PATH": "/image/bin", "LEVEL": 'a "3" $b'})

    with daemon(engine, 0.0), component(run, engine, own_environment(engine)) as running:
        assert len(list(running)) == 3
        _, file, mode, text, *names = client(engine)

    assert text == 'LD_PRELOAD=/x.so\nLEVEL=a "3" $b\nPATH=/image/bin\n'
    assert mode == 0o600
    assert not {"LD_PRELOAD", "LEVEL"} & {*names}
    assert not Path(str(file)).exists()


def test_a_line_break_in_a_variable_is_refused(engine: Path) -> None:
    run = replace(in_docker(), environment={"KEY": "a\nb"})

    with pytest.raises(CannotStart, match="the variable KEY of its container has a line break"):
        order_of("vision", run, StartContext(base=engine, environment=own_environment(engine)))


def test_death_of_a_client_removes_its_container(engine: Path) -> None:
    run = in_docker(until=10_000, failures=1)

    with daemon(engine, 0.0), component(run, engine, own_environment(engine)) as running:
        next(running)
        (left,) = (engine / "containers").iterdir()
        process, *_ = client(engine)
        assert isinstance(process, int)
        os.kill(process, signal.SIGKILL)
        failed = next(sample for sample in running if sample.failure)
        assert "signal 9" in failed.failure or "SIGKILL" in failed.failure
        next(running)
        assert not left.exists()

    assert [*(engine / "containers").iterdir()] == []


def test_a_container_made_after_the_kill_is_removed(engine: Path) -> None:
    run = in_docker(stop=Stop(signal="KILL", grace=ms(0)))

    with daemon(engine, 0.5):
        with component(run, engine, own_environment(engine)) as running:

            def interrupt() -> None:
                client(engine)
                running.interrupt()

            threading.Thread(target=interrupt).start()
            assert list(running) == []
        time.sleep(1)

    assert [*(engine / "containers").iterdir()] == []


def test_rarms_waits_for_the_removal_of_containers() -> None:
    engines = supervisor_process.ENGINE_S + supervisor_process.CLIENT_S + 2 * supervisor_process.REMOVING_S

    assert engines + supervisor_process.KILLING_S < supervisor.ENGINE_GOING_S
