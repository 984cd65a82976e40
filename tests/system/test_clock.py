"""A wall clock that goes back, before each command or at each reading: every command ends as under a right one."""

import json
import time
from collections.abc import Iterator
from contextlib import chdir
from datetime import datetime, timedelta, tzinfo
from pathlib import Path

import pytest

from rarms_iac.app import hosts, measurement_files, requests
from rarms_iac.measuring import measure
from rarms_iac.storage import disk
from tests.crashing import CrashingDisk
from tests.disturbing import End, look
from tests.effort import LONG
from tests.fluid import without_scheduler
from tests.robots import CELL
from tests.unit.cli.running import rarms

ROUTE = (
    ("measure", "--samples", "60"),
    ("tune", "--samples", "60"),
    ("plan", "--out", "plan.json"),
    ("apply", "plan.json"),
    ("prove", "--without-load"),
    ("measure", "--again", "--samples", "60", "--stop-partitions"),
    ("apply", "--auto-approve"),
    ("undo", "--auto-approve"),
    ("plan",),
    ("apply", "--auto-approve"),
    ("history", "--json"),
    ("destroy", "--auto-approve"),
)
READERS = (hosts, measurement_files, requests, measure)
"""The modules that ask for the time of day."""
STEPS = (timedelta(milliseconds=100), timedelta(hours=1), timedelta(days=400))


class Falling(datetime):
    """A clock that is further back whenever it is read."""

    back = timedelta(days=0)
    step = timedelta(days=0)

    @classmethod
    def now(cls, tz: tzinfo | None = None) -> "Falling":
        cls.back += cls.step
        return cls.fromtimestamp(datetime.now(tz).timestamp(), tz) - cls.back


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[type[Falling]]:
    for module in READERS:
        monkeypatch.setattr(module, "datetime", Falling)
    ns = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: ns() - int(Falling.back.total_seconds() * 1e9))
    Falling.back = Falling.step = timedelta(days=0)
    with without_scheduler():
        yield Falling


def walk(folder: Path, step: timedelta) -> tuple[list[int], End]:
    """Go the route with the clock going back so far at each reading; the codes of all, and what is there."""
    folder.mkdir()
    (folder / "rarms.yaml").write_text(CELL, encoding="utf-8", newline="\n")
    Falling.back, Falling.step = timedelta(days=0), step
    with chdir(folder), disk.use(CrashingDisk(0)):
        codes = [rarms(*words).code for words in ROUTE]
    return codes, look(folder, 0)


def test_a_clock_that_jumps_back_changes_no_end(tmp_path: Path, clock: type[Falling]) -> None:
    right = walk(tmp_path / "right", timedelta(days=0))
    assert set(right[0]) <= {0, 4}
    for number, step in enumerate(STEPS if LONG else STEPS[1:2]):
        assert walk(tmp_path / str(number), step) == right, step
        assert clock.back > len(ROUTE) * step


def test_undone_proof_stays_undone_after_clock_jump(tmp_path: Path, clock: type[Falling]) -> None:
    (tmp_path / "rarms.yaml").write_text(CELL.replace("reserve: measured", "reserve: 60 %", 1), encoding="utf-8")
    with chdir(tmp_path):
        for words in (*ROUTE[:5], ("undo", "--auto-approve")):
            clock.step = timedelta(days=1)
            assert rarms(*words).code in {0, 4}, words

        proofs = json.loads(rarms("status", "--json").out)["proofs"]

    assert all("its layout on onboard was undone at " in proof["outdated"][0] for proof in proofs)
    assert proofs
