"""One holder at a time, in threads and processes, and none after its death."""

import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from rarms_iac.storage.lock import Locked, hold, read_holder, read_owner

HOLDER = """
import sys, time
from pathlib import Path
from rarms_iac.storage.lock import hold
with hold(Path(sys.argv[1]), "ann@lab, process 7, since noon, rarms apply"):
    print("held", flush=True)
    time.sleep(60)
"""


def start_holder(path: Path) -> "subprocess.Popen[str]":
    process = subprocess.Popen([sys.executable, "-c", HOLDER, str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline().strip() == "held"
    return process


def kill(process: "subprocess.Popen[str]") -> None:
    process.kill()
    process.communicate()


def test_second_holder_is_told_who_first_is(tmp_path: Path) -> None:
    path = tmp_path / "onboard.lock"
    with hold(path, "ann@lab"):
        with pytest.raises(Locked) as locked, hold(path, "bob@lab"):
            pytest.fail("two hold the lock")
        assert locked.value.owner == "ann@lab"
        assert read_owner(path) == read_holder(path) == "ann@lab"

    assert read_owner(path) == ""
    with hold(path, "bob@lab"):
        assert read_owner(path) == "bob@lab"


def test_death_frees_the_lock(tmp_path: Path) -> None:
    path = tmp_path / "onboard.lock"
    process = start_holder(path)
    try:
        with pytest.raises(Locked) as locked, hold(path, "bob@lab", timeout_ms=50):
            pytest.fail("two hold the lock")
    finally:
        kill(process)

    assert locked.value.owner == "ann@lab, process 7, since noon, rarms apply"
    assert read_owner(path) == locked.value.owner
    assert read_holder(path) == "", "its name is there, and the process is not"
    with hold(path, "bob@lab", timeout_ms=2000):
        assert read_owner(path) == "bob@lab"


def test_waiting_ends_when_the_lock_is_given_back(tmp_path: Path) -> None:
    path = tmp_path / "onboard.lock"
    order: list[str] = []

    def wait() -> None:
        with hold(path, "second", timeout_ms=5000):
            order.append("second")

    with hold(path, "first"):
        thread = threading.Thread(target=wait)
        thread.start()
        time.sleep(0.1)
        order.append("first")
    thread.join()

    assert order == ["first", "second"]


def test_the_lock_is_given_back_after_an_error(tmp_path: Path) -> None:
    path = tmp_path / "onboard.lock"
    with pytest.raises(RuntimeError), hold(path, "first"):
        raise RuntimeError

    with hold(path, "second"):
        assert read_owner(path) == "second"
