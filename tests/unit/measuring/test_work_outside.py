"""Work that ran outside of the partitions, and memory kills: the same findings in `measure`, `tune` and `prove`."""

from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path

import pytest

from rarms_iac.model.environment_setup import P1, P2
from rarms_iac.model.outcomes import TooManyFailures
from rarms_iac.model.series import SkippedLines
from rarms_iac.model.setting import OutsideWork, SettingEvidence
from rarms_iac.providers.simulated.measuring import SimulatedRun
from tests.fluid import without_scheduler
from tests.unit.cli.running import Ran, rarms
from tests.unit.measuring import test_prove, test_tune

ELSEWHERE = OutsideWork(name="sh", group=f"/libpod_parent/libpod-{'0a' * 32}", cpu_ms=790.0, component="vision")
FOUND = SettingEvidence(
    elapsed_ms=1000.0,
    cpu_ms={P1: 10.0, P2: 10_000.0},
    outside=(ELSEWHERE,),
    out_of_memory={"vision": 2},
    skipped_lines={"vision": SkippedLines(count=3, first=('"booting"',))},
)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder in which every setting and start counts work outside."""
    monkeypatch.setattr(SimulatedRun, "evidence", lambda _running: FOUND)
    with chdir(tmp_path), without_scheduler():
        yield tmp_path


def told(ran: Ran, starts: int = 1) -> None:
    text = " ".join(ran.err.split())
    assert f"Processes of vision left their group: sh in /libpod_parent/libpod-* {790 * starts} ms." in text, text
    assert f"The kernel killed {2 * starts} processes of its partition" in text
    assert text.count("[RARMS393]") == text.count("[RARMS394]") == 1


def test_measure_names_work_outside_and_kills(here: Path) -> None:
    (here / "rarms.yaml").write_text(test_prove.MANIFEST, encoding="utf-8")

    told(rarms("measure", "vision", "--from", "50%", "--to", "50%"))
    told(rarms("measure", "vision", "--from", "50%", "--to", "50%"))  # from the log


def test_prove_adds_up_the_starts(here: Path) -> None:
    (here / "rarms.yaml").write_text(test_prove.MANIFEST, encoding="utf-8")
    assert rarms("apply", "--auto-approve").code == 0

    proved = rarms("prove", "--without-load")

    told(proved, starts=8)
    assert "vision: 24 lines" in " ".join(proved.out.split())


def test_tune_names_work_outside_and_kills(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "rarms.yaml").write_text(test_tune.MANIFEST, encoding="utf-8")
    monkeypatch.setattr(SimulatedRun, "evidence", lambda _running: None)
    assert rarms("measure", "--samples", "400").code == 0
    monkeypatch.setattr(SimulatedRun, "evidence", lambda _running: FOUND)

    ran = rarms("tune", "--samples", "60", "--dry-run")

    assert "RARMS393" in ran.err
    assert "RARMS394" in ran.err


def test_memory_is_advised_where_memory_kills(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "rarms.yaml").write_text(test_prove.MANIFEST, encoding="utf-8")
    failed = TooManyFailures(component="vision", failures=("killed by signal KILL",), allowed=0)
    for module in ("setting_run", "proof"):
        monkeypatch.setattr(f"rarms_iac.measuring.{module}.watch", lambda *_, **_more: failed)

    measured = rarms("measure", "vision")
    assert rarms("apply", "--auto-approve").code == 0
    for ran in (measured, rarms("prove", "--without-load")):
        text = " ".join(ran.err.split())
        assert "The kernel killed 2 processes of its partition" in text
        assert "Raise `memory`" in text
        assert "run: { failures" not in text
