"""`rarms measure --interactive` as a person does it: a whole session through a pseudo-terminal."""

import os
import re
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.needs import CHECKOUT
from tests.robots import a_measured, a_robot_of

pytestmark = pytest.mark.needs("posix")

MANIFEST = a_robot_of(
    a_measured().replace("50 ms } }", "50 ms } }  # the line is not too late"),
    a_measured("speech", criticality=10, at_most="90 ms"),
)
LONGEST = 120
"""Seconds to wait for words; a machine may be busy."""


class Person:
    """Sits at a terminal of 100 columns: waits for words, and types."""

    def __init__(self, folder: Path, *words: str) -> None:
        import pty

        self.seen = ""
        self._read = 0
        self._screen, keyboard = pty.openpty()
        environment = {**os.environ, "COLUMNS": "100", "TERM": "xterm", "NO_COLOR": "1"}
        command = [sys.executable, "-m", "rarms_iac.cli.main", *words, "-f", str(folder)]
        self.process = subprocess.Popen(
            command, cwd=CHECKOUT, env=environment, stdin=keyboard, stdout=keyboard, stderr=keyboard, close_fds=True
        )
        os.close(keyboard)

    def waits_for(self, *words: str) -> str:
        """Read until any of these words were shown after those that were waited for before; the first that were."""
        until = time.monotonic() + LONGEST
        while not (found := [(at, each) for each in words if (at := self._plain().find(each, self._read)) >= 0]):
            assert self._more(until), f"no {words!r} in {self._plain()[self._read :]}"
        at, first = min(found)
        self._read = at + len(first)
        return first

    def types(self, line: str) -> None:
        """Type a line."""
        os.write(self._screen, f"{line}\n".encode())

    def leaves(self) -> int:
        """Read to the end; the exit code."""
        while self._more(time.monotonic() + LONGEST):
            pass
        return self.process.wait(timeout=LONGEST)

    def interrupts(self) -> None:
        """Press Ctrl-C."""
        self.process.send_signal(signal.SIGINT)

    def close(self) -> None:
        """Take the terminal away."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait(timeout=LONGEST)
        os.close(self._screen)

    def _more(self, until: float) -> bool:
        ready, _, _ = select.select([self._screen], [], [], max(0.0, until - time.monotonic()))
        try:
            data = os.read(self._screen, 65536) if ready else b""
        except OSError:  # the other side is closed
            return False
        self.seen += data.decode("utf-8", "replace")
        return bool(data)

    def _plain(self) -> str:
        return " ".join(re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", self.seen).split())


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    return tmp_path


@pytest.fixture
def person(folder: Path) -> Iterator[Person]:
    sitting = Person(folder, "measure", "--interactive")
    yield sitting
    sitting.close()


def test_a_whole_session(person: Person, folder: Path) -> None:
    manifest = folder / "rarms.yaml"
    person.waits_for("vision with busy-loop on onboard (simulated): 10 settings")
    person.waits_for("against CR (% of its VPs)")
    person.waits_for("onboard: ")
    person.waits_for("not known: speech is not measured.")
    person.waits_for("A level for vision, such as 100 ms or 95 %, or Enter to continue [?, q]:")
    person.types("?")
    person.waits_for("A level is a threshold with its unit")
    person.types("150 ms")
    person.waits_for("vision: mean_response_time at most 50 ms -> at most 150 ms")
    person.waits_for("Write this level into the manifest? [y/N/?/q]")
    person.types("n")
    person.waits_for("A level for vision")
    assert manifest.read_text(encoding="utf-8") == MANIFEST, "nothing is written without a yes"
    person.types("150 ms")
    person.waits_for("Write this level into the manifest? [y/N/?/q]")
    person.types("y")
    person.waits_for("Written to")
    assert "at_most: 150 ms } }  # the line is not too late" in manifest.read_text(encoding="utf-8")
    person.waits_for("% of its VPs was measured. Search there? [y/N/?/q]")
    person.types("y")
    person.waits_for("vision busy-loop")
    person.waits_for("A level for vision")
    person.types("")
    person.waits_for("speech busy-loop")
    person.waits_for("A level for speech")
    person.types("q")
    person.waits_for("Ended. Results are saved; run the same command to continue.")
    assert person.leaves() == 0
    assert (folder / "measurements" / "onboard" / "speech" / "busy-loop.jsonl").is_file()


def test_ctrl_c_at_question_leaves_what_was_measured(person: Person, folder: Path) -> None:
    person.waits_for("A level for vision")

    person.interrupts()

    person.waits_for("run the same command to continue.")
    assert person.leaves() == 130
    log = folder / "measurements" / "onboard" / "vision" / "busy-loop.jsonl"
    assert len(log.read_text(encoding="utf-8").splitlines()) == 11
    assert (folder / "rarms.yaml").read_text(encoding="utf-8") == MANIFEST


def over_full(tmp_path: Path) -> Person:
    """A user who keeps all levels of the over-full robot, and is asked whether to combine."""
    shutil.copy(CHECKOUT / "manifests" / "over-full" / "rarms.yaml", tmp_path)
    person = Person(tmp_path, "measure", "--interactive")
    for component in ("people-detection", "label-reading", "path-following", "stock-messages"):
        person.waits_for(f"A level for {component}")
        person.types("")
    person.waits_for("Need 2.")
    person.waits_for("have 2 LP, predicted ")
    person.waits_for("Combine components? [y/N/?/q]")
    return person


def test_too_demanding_levels_go_on_to_combining(tmp_path: Path) -> None:
    person = over_full(tmp_path)
    try:
        person.types("?")
        person.waits_for("like `rarms tune --interactive")
        person.types("y")
        person.waits_for("Try ")
        person.types("q")
        person.waits_for(f"Ended. Results are saved; `rarms tune -f {tmp_path}` continues combining.")
        assert person.leaves() == 0
        assert "partitions:" not in (tmp_path / "rarms.yaml").read_text(encoding="utf-8")
        person.close()
        person = Person(tmp_path, "tune", "--interactive")
        person.waits_for("Try ")
        person.types("q")
        assert person.leaves() == 0
    finally:
        person.close()


def test_a_combination_is_shown_before_it_is_written(tmp_path: Path) -> None:
    person = over_full(tmp_path)
    try:
        person.types("y")
        asks = "Write these partitions into the manifest? [y/N/?/q]"
        while person.waits_for("saves at most", asks) == "saves at most":
            person.waits_for("[y/N/?/q]")
            person.types("y")
        assert "partitions:" not in (tmp_path / "rarms.yaml").read_text(encoding="utf-8")
        person.types("y")
        person.waits_for("Written to")
        assert person.leaves() == 0
        assert "stock-messages]" in (tmp_path / "rarms.yaml").read_text(encoding="utf-8")
    finally:
        person.close()
