"""Records of a log from elsewhere: each is read as if it were ours, and what is new is added."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.storage import disk
from rarms_iac.storage.codec import encode
from rarms_iac.storage.datalog import merging
from rarms_iac.storage.datalog.decisions import read_entries, read_runs
from rarms_iac.storage.datalog.files import LogUnreadable, append_setting, append_to_log, read_log
from rarms_iac.storage.datalog.identity import header_digest
from rarms_iac.storage.datalog.log import Header, Recorded
from rarms_iac.storage.datalog.merging import is_log, merge_records, new_records
from rarms_iac.storage.records import sealed_line
from tests.builders_measured import PROVEN, TAKEN, TUNED, a_header, a_setting
from tests.crashing import Crash, CrashingDisk, When

LOG = "onboard/vision/busy-loop.jsonl"
CONFIGURATION = "onboard/vision.configuration.jsonl"
TUNING = "onboard/tuning.jsonl"


def a_log(folder: Path, *reserves: int, header: Header | None = None) -> Path:
    path = folder / "measurements" / LOG
    for reserve in reserves:
        append_setting(path, header or a_header(), Recorded(setting=a_setting(reserve), provenance=TAKEN))
    return path


def elsewhere(folder: Path, *reserves: int) -> bytes:
    return a_log(folder / "robot", *reserves).read_bytes()


def reserves_in(folder: Path) -> list[int]:
    file = read_log(folder / "measurements" / LOG)
    assert file is not None
    return [record.setting.reserve for _, record in file.recorded]


def test_new_records_are_added_once(tmp_path: Path) -> None:
    a_log(tmp_path, 10, 30)
    came = elsewhere(tmp_path, 10, 20)

    assert merge_records(tmp_path, LOG, came)
    assert not merge_records(tmp_path, LOG, came)

    assert reserves_in(tmp_path) == [10, 30, 20]


def test_another_header_comes_along(tmp_path: Path) -> None:
    a_log(tmp_path, 10)
    other = replace(a_header(), platform_facts=replace(a_header().platform_facts, os_build=1))
    came = a_log(tmp_path / "robot", 20, header=replace(other, digest=header_digest(other))).read_bytes()

    assert merge_records(tmp_path, LOG, came)

    file = read_log(tmp_path / "measurements" / LOG)
    assert file is not None
    assert [header.platform_facts.os_build for header in file.headers.values()] == [26100, 1]


def test_logs_of_decisions_are_merged(tmp_path: Path) -> None:
    robot = tmp_path / "robot" / "measurements"
    append_to_log(robot / CONFIGURATION, PROVEN)
    append_to_log(robot / TUNING, TUNED)

    for name in (CONFIGURATION, TUNING):
        assert merge_records(tmp_path, name, (robot / name).read_bytes())

    assert read_entries(tmp_path / "measurements" / CONFIGURATION) == (PROVEN,)
    assert read_runs(tmp_path / "measurements" / TUNING) == (TUNED,)


def test_foreign_line_ends_and_torn_line_are_harmless(tmp_path: Path) -> None:
    came = elsewhere(tmp_path, 10, 20)
    torn = came.replace(b"\n", b"\r\n")[:-40]
    a_log(tmp_path, 10)

    assert new_records(tmp_path, LOG, torn) == b""
    assert new_records(tmp_path, LOG, came[:-1]) == came.splitlines(keepends=True)[-1]


def resealed(change: Callable[[dict[str, object]], dict[str, object]]) -> Callable[[bytes], bytes]:
    header = encode(a_header())
    assert isinstance(header, dict)
    return lambda _came: sealed_line(change(dict(header)))  # type: ignore[arg-type]  # JSON values all the same


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda came: came.replace(b'"reserve":10', b'"reserve":11'), "damaged"),
        (lambda came: b'{"header":1}\n{"record":1}\n', "damaged"),
        (lambda came: b"\xfd7zXZ\x00" * 30, "damaged"),
        (lambda came: b"", "empty"),
        (lambda came: came.split(b"\n", 1)[1], "refers to the missing header"),
        (lambda came: came + sealed_line({"header": a_header().digest}), "field is missing"),
        (lambda came: came + sealed_line({"colour": "red"}), "field is unknown"),
        (lambda came: b"<<<<<<< ours\n" + came, "merge conflict"),
        (resealed(lambda header: {**header, "digest": "0" * 16}), "not the digest of this header"),
        (resealed(lambda header: {**header, "platform": "other"}), "not the digest of this header"),
    ],
)
def test_what_is_not_log_of_ours_is_refused(tmp_path: Path, damage: Callable[[bytes], bytes], reason: str) -> None:
    a_log(tmp_path, 50)

    with pytest.raises(LogUnreadable, match=reason):
        merge_records(tmp_path, LOG, damage(elsewhere(tmp_path, 10, 20)))

    assert reserves_in(tmp_path) == [50]


@pytest.mark.parametrize("name", [LOG.replace("vision", "speech"), LOG.replace("busy-loop", "bursts"), CONFIGURATION])
def test_a_log_of_another_name_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(LogUnreadable):
        merge_records(tmp_path, name, elsewhere(tmp_path, 10))


def test_a_configuration_log_of_another_component_is_refused(tmp_path: Path) -> None:
    append_to_log(tmp_path / "robot", PROVEN)

    with pytest.raises(LogUnreadable, match="it belongs to vision, not speech"):
        merge_records(tmp_path, CONFIGURATION.replace("vision", "speech"), (tmp_path / "robot").read_bytes())


def test_too_many_bytes_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    came = elsewhere(tmp_path, 10)
    monkeypatch.setattr(merging, "MOST_BYTES", len(came) - 1)

    with pytest.raises(LogUnreadable, match="more than"):
        merge_records(tmp_path, LOG, came)


def test_a_damaged_log_here_gets_nothing(tmp_path: Path) -> None:
    path = a_log(tmp_path, 50)
    path.write_bytes(path.read_bytes().replace(b'"reserve":50', b'"reserve":51'))
    before = path.read_bytes()

    with pytest.raises(LogUnreadable) as problem:
        merge_records(tmp_path, LOG, elsewhere(tmp_path, 10))

    assert (problem.value.path, path.read_bytes()) == (path, before)


@pytest.mark.parametrize("when", When)
@pytest.mark.parametrize("is_there", [True, False])
def test_crashed_merge_is_repaired_by_merging(tmp_path: Path, when: When, *, is_there: bool) -> None:
    came = elsewhere(tmp_path, 10, 20, 30)
    for at in (1, 2, 3, 4):
        folder = tmp_path / str(at)
        if is_there:
            a_log(folder, 50)
        with disk.use(CrashingDisk(at, when)), suppress(Crash):
            merge_records(folder, LOG, came)

        merge_records(folder, LOG, came)

        assert reserves_in(folder) == ([50] if is_there else []) + [10, 20, 30]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        (LOG, True),
        (CONFIGURATION, True),
        (TUNING, True),
        ("onboard/a+b/busy-loop.jsonl", True),
        ("onboard/../../etc/passwd", False),
        ("../vision/busy-loop.jsonl", False),
        ("onboard/vision/.jsonl", False),
        ("onboard/vision/x/busy-loop.jsonl", False),
        ("onboard/vision.jsonl", False),
        ("/onboard/vision/busy-loop.jsonl", False),
        ("onboard/vision\n/busy-loop.jsonl", False),
        ("vision.configuration.jsonl", False),
    ],
)
def test_only_names_of_logs_are_names_of_logs(name: str, *, expected: bool) -> None:
    assert is_log(name) is expected
