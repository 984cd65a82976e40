"""A robot's measurements: bounded, checked as a whole, and added only then."""

from collections.abc import Callable
from pathlib import Path

import pytest

from rarms_iac.app import measurement_files
from rarms_iac.app.measurement_files import add_measurements
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.storage.datalog.files import append_to_log
from tests.builders_measured import PROVEN
from tests.unit.storage.datalog.test_merging import CONFIGURATION, LOG, a_log, reserves_in

OTHER = LOG.replace("vision", "zoom")


@pytest.fixture
def came(tmp_path: Path) -> dict[str, bytes]:
    """The logs of a robot that measured."""
    a_log(tmp_path / "robot", 10, 20)
    folder = tmp_path / "robot" / "measurements"
    append_to_log(folder / CONFIGURATION, PROVEN)
    return {name: (folder / name).read_bytes() for name in (LOG, CONFIGURATION)}


@pytest.fixture
def here(tmp_path: Path) -> Path:
    """A folder here, with a log that has one of the records."""
    a_log(tmp_path / "here", 10)
    return tmp_path / "here"


def refusal(use: Callable[[], object]) -> str:
    """What the one finding says."""
    with pytest.raises(UseCaseError) as problem:
        use()
    (finding,) = problem.value.findings
    assert finding.code == "RARMS107"
    return str(finding.detail)


def test_records_of_robot_are_added_to_logs_here(came: dict[str, bytes], here: Path) -> None:
    assert add_measurements(here, "onboard", came) == (CONFIGURATION, LOG)
    assert add_measurements(here, "onboard", came) == ()
    assert reserves_in(here) == [10, 20]


def test_one_bad_log_keeps_all_others_out(came: dict[str, bytes], here: Path) -> None:
    bad = {**came, OTHER: came[LOG]}

    reason = "The robot's measurements/onboard/zoom/busy-loop.jsonl, line 1: it belongs to"
    assert reason in refusal(lambda: add_measurements(here, "onboard", bad))
    assert reserves_in(here) == [10]


@pytest.mark.parametrize("bad", [b"", b"\xfd7zXZ\0" * 30, b'{"header":1}\n{"record":1}\n', b"[" * 100_000])
def test_a_log_that_is_garbage_is_refused(here: Path, bad: bytes) -> None:
    assert "The robot's" in refusal(lambda: add_measurements(here, "onboard", {OTHER: bad}))
    assert not (here / "measurements" / OTHER).exists()


def test_damaged_log_here_is_named_as_one_here(came: dict[str, bytes], here: Path) -> None:
    path = here / "measurements" / LOG
    path.write_bytes(path.read_bytes().replace(b'"reserve":10', b'"reserve":11'))

    assert refusal(lambda: add_measurements(here, "onboard", came)).startswith(path.as_posix())


@pytest.mark.parametrize(
    "name", ["../vision.jsonl", "/etc/passwd", "onboard/../../x.jsonl", LOG.replace("onboard", "two")]
)
def test_only_logs_of_the_platform_are_added(came: dict[str, bytes], here: Path, name: str) -> None:
    bad = {**came, name: came[LOG]}

    assert "is not a log of onboard" in refusal(lambda: add_measurements(here, "onboard", bad))
    assert reserves_in(here) == [10]


def test_too_many_bytes_in_all_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measurement_files, "MOST_BYTES", 511)

    logs = {LOG: b"x" * 256, OTHER: b"x" * 256}
    assert "more than 511 bytes" in refusal(lambda: add_measurements(Path(), "onboard", logs))
