"""Measuring once more, and measuring for two: passes that go on, logs that one writes at a time, busy settings."""

from collections.abc import Iterator
from contextlib import chdir, suppress
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.app.measurement_files import hold_data_log
from rarms_iac.measuring.experiment_log import KnownSettings
from rarms_iac.storage import disk
from rarms_iac.storage.datalog.log import DataLog
from tests.builders_measured import a_series, a_setting
from tests.crashing import Crash, CrashingDisk
from tests.fluid import without_scheduler
from tests.measuring import the_log as measured_log
from tests.robots import a_measured, a_robot_of
from tests.unit.cli.running import Ran, rarms

MANIFEST = a_robot_of(
    a_measured("vision", until="samples: 5"),
    a_measured("speech", criticality=20, at_most="90 ms", until="samples: 5"),
    hosts="\n  ".join(
        f"{name}: {{ logical_processors: 2, memory: 4 GiB, platform: robot }}" for name in ("left", "right")
    ),
)
SWEPT = ("measure", "--from", "60%", "--to", "70%", "--host", "left")
ONCE = [(60, 1), (70, 1)]
TWICE = [*ONCE, (60, 2), (70, 2)]


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Path]:
    """A folder with a robot whose two components are measured, which is where we are."""
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    with chdir(tmp_path), without_scheduler():
        assert rarms(*SWEPT).code == 0
        yield tmp_path


def test_order_is_that_of_the_seed() -> None:
    runs = [replace(a_setting(reserve, a_series("vision", [1.0])), seed=seed) for reserve, seed in MEASURED_TWICE]

    known = KnownSettings(runs=tuple(runs), simulated=True)

    assert [setting.reserve for setting in known.seen_with(2)] == [45, 60]
    assert [setting.reserve for setting in known.settings] == [60, 45, 50]


MEASURED_TWICE = ((60, 1), (45, 1), (50, 1), (45, 2), (60, 2))


def path_of(name: str) -> Path:
    return Path.cwd() / "measurements" / "robot" / name / "busy-loop.jsonl"


def the_log(name: str) -> DataLog:
    return measured_log(path_of(name))


def recorded(name: str) -> list[tuple[int, int]]:
    return [(entry.setting.reserve, entry.setting.seed) for entry in the_log(name).recorded]


def files_of(folder: Path) -> dict[Path, bytes]:
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def code_of(ran: Ran) -> tuple[int, str]:
    return ran.code, ran.err[ran.err.index("RARMS") :][:8]


def test_ended_pass_is_followed_by_another(here: Path) -> None:
    assert rarms(*SWEPT, "--again").code == 0
    assert rarms(*SWEPT).code == 0
    assert recorded("vision") == TWICE
    assert rarms(*SWEPT, "--again").code == 0
    assert recorded("vision") == [*TWICE, (60, 3), (70, 3)]


def test_another_question_has_a_pass_of_its_own(here: Path) -> None:
    with disk.use(CrashingDisk(40)), suppress(Crash):
        rarms(*SWEPT, "--again")
    assert [remeasurement.ended for remeasurement in the_log("vision").remeasurements] == [False]
    other = ("measure", "vision", "--from", "60%", "--to", "80%", "--host", "left", "--again")

    assert rarms(*other).code == 0
    assert recorded("vision")[-3:] == [(60, 3), (70, 3), (80, 3)]
    assert rarms(*SWEPT, "--again").code == 0
    assert [entry for entry in recorded("vision") if entry[1] == 2] == [(60, 2), (70, 2)]


def test_what_cannot_be_run_begins_no_pass(here: Path) -> None:
    before = path_of("vision").read_bytes()

    assert rarms("measure", "--again", "--seed", "7").code == 64
    with hold_data_log(here, path_of("vision"), 0):
        assert code_of(rarms(*SWEPT, "--again")) == (3, "RARMS184")
    assert path_of("vision").read_bytes() == before


def test_two_hosts_share_no_log_at_once(here: Path) -> None:
    """Each host has a lock of its own: what they share is the log."""
    before = path_of("vision").read_bytes()
    with hold_data_log(here, path_of("vision"), 0):
        ran = rarms("measure", "vision", "--from", "60%", "--to", "80%", "--host", "right")
        other = rarms("measure", "speech", "--from", "60%", "--to", "80%", "--host", "right")

    assert code_of(ran) == (3, "RARMS184")
    assert "process" in ran.err
    assert path_of("vision").read_bytes() == before
    assert other.code == 0, "another log is free"
    assert rarms("measure", "vision", "--from", "60%", "--to", "80%", "--host", "right").code == 0
    assert recorded("vision") == [*ONCE, (80, 1)]


def test_quiet_pass_replaces_busy_measurements(here: Path) -> None:
    searched = ("measure", "vision", "--samples", "60", "--host", "left")
    manifest = (
        MANIFEST.replace(
            "reserve: measured }\n    memory: 512 MiB\n    simulation: { work: 20 ms",
            "reserve: 1 % }\n    memory: 512 MiB\n    simulation: { work: 20 ms",
        )
        .replace("samples: 5", "samples: 60")
        .replace("at_most: 50 ms", "at_most: 60 ms")
    )
    (here / "rarms.yaml").write_text(manifest, encoding="utf-8", newline="\n")
    assert rarms("apply", "--auto-approve", "--host", "left").code == 0
    busy = rarms(*searched, "--on-busy-host")
    measured = manifest.replace("reserve: 1 % }", "reserve: measured }", 1)
    (here / "rarms.yaml").write_text(measured, encoding="utf-8", newline="\n")
    assert (busy.code, "RARMS105" in busy.err) == (0, True), busy.err
    assert "RARMS105" in rarms("plan").out
    assert code_of(rarms(*searched, "--again")) == (3, "RARMS115")
    assert the_log("vision").remeasurements == (), "what is refused begins nothing"
    assert rarms("destroy", "--auto-approve").code == 0

    with disk.use(CrashingDisk(60)), suppress(Crash):
        rarms(*searched, "--again")
    assert [remeasurement.ended for remeasurement in the_log("vision").remeasurements] == [False]
    assert "RARMS105" in rarms("plan").out, "half a pass stands for nothing"
    again = rarms(*searched, "--again")

    assert again.code == 0, again.err
    assert "RARMS105" not in rarms("plan").out
    assert all(not entry.is_busy for entry in the_log("vision").counting)
    assert any(entry.is_busy for entry in the_log("vision").recorded), "what was measured stays in the log"


def test_quiet_setting_replaces_a_busy_one(here: Path) -> None:
    lines = path_of("vision").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 3
    log = the_log("vision")
    quiet = log.recorded[0]
    busy = type(quiet)(
        setting=quiet.setting,
        provenance=type(quiet.provenance)(rarms_version="0", when="2026-01-01T00:00:00Z", beside=("speech",)),
    )

    assert DataLog(header=log.header, recorded=(busy, quiet)).counting == (quiet,)
    assert DataLog(header=log.header, recorded=(quiet, busy)).counting == (quiet, busy)
