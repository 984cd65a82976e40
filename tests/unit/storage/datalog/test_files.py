"""The tuning log: a run comes back as it was written, is not written twice, and damage is told."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from rarms_iac.model.series import Sample
from rarms_iac.storage.codec import encode
from rarms_iac.storage.datalog.decisions import Chosen, append_run, last_chosen, read_entries, read_runs, tuning_path
from rarms_iac.storage.datalog.files import (
    LogUnreadable,
    append_setting,
    append_to_log,
    configuration_path,
    log_path,
    read_log,
)
from rarms_iac.storage.datalog.log import LogRecord, Recorded, as_recorded
from rarms_iac.storage.writing import append
from scripts.file_schemas import data_log_schema
from tests.builders_measured import PROVEN, TAKEN, TUNED, a_bench, a_header, a_series, a_setting, a_subject
from tests.measuring import the_log


def a_file(folder: Path, *reserves: int) -> Path:
    path = log_path(folder, "onboard", ["vision", "speech"], "busy-loop")
    append_to_log(path, a_header())
    for each in reserves:
        append_setting(path, a_header(), Recorded(setting=a_setting(each), provenance=TAKEN))
    return path


def append_changed(path: Path, *keys: str | int, value: Any) -> None:
    """Append the record of a setting in which one value is another."""
    record: Any = encode(LogRecord(header=a_header().digest, record=Recorded(setting=a_setting(), provenance=TAKEN)))
    part = record["record"]["Recorded"]["setting"]
    for key in keys[:-1]:
        part = part[key]
    part[keys[-1]] = value
    append(path, record)


def test_log_path_names_components_platform_and_load(tmp_path: Path) -> None:
    found = log_path(tmp_path, "onboard", ["vision", "speech"], "busy-loop")

    assert found == tmp_path / "measurements" / "onboard" / "speech+vision" / "busy-loop.jsonl"


def test_what_is_written_reads_back(tmp_path: Path) -> None:
    odd = replace(
        a_series(responses=(88.0, None, 90.25)),
        samples=(
            Sample(began_ms=0.0, response_ms=88.123456789, successful=True, count=3.0),
            Sample(began_ms=88.2, response_ms=None, successful=False, failure="Prüfung \ud800"),
            Sample(began_ms=99.0, response_ms=1.0, successful=False),
        ),
        cpu_ms=None,
    )
    path = a_file(tmp_path, 70)
    append_setting(path, a_header(), Recorded(setting=a_setting(10, odd), provenance=replace(TAKEN, beside=("other",))))

    log = the_log(path)

    assert log.header == a_header()
    assert log.settings == (a_setting(70), as_recorded(a_setting(10, odd)))
    assert log.recorded[1].provenance.beside == ("other",)
    assert log.settings[1].series[0].samples[0].response_ms == 88.1235


def test_used_log_is_reread_only_when_written(tmp_path: Path) -> None:
    path = a_file(tmp_path, 10)
    log = read_log(path)

    assert read_log(path) is log
    append_setting(path, a_header(), Recorded(setting=a_setting(20), provenance=TAKEN))

    assert [setting.reserve for setting in the_log(path).settings] == [10, 20]


def test_damaged_setting_names_its_line(tmp_path: Path) -> None:
    path = a_file(tmp_path, 10, 20)
    path.write_bytes(path.read_bytes().replace(b'"reserve":10', b'"reserve":11'))

    with pytest.raises(LogUnreadable, match="damaged") as error:
        read_log(path)

    assert error.value.line == 2


def test_missing_log_is_none_and_empty_damaged(tmp_path: Path) -> None:
    path = tmp_path / "none.jsonl"
    assert read_log(path) is None
    path.write_bytes(b"")
    with pytest.raises(LogUnreadable, match="empty"):
        read_log(path)


def test_setting_without_member_series_is_none(tmp_path: Path) -> None:
    path = a_file(tmp_path, 10)
    append_changed(path, "series", value=[])

    with pytest.raises(LogUnreadable, match="series: it has the components none instead of"):
        read_log(path)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("reserve", 0, "0 is not between 1 and 100"),
        ("reserve", "70", "not a whole number"),
        ("colour", "red", "field is unknown"),
        ("series", [{"component": "vision"}], "the field is missing"),
        ("series", {}, "not an array"),
    ],
)
def test_what_is_no_setting_says_why(tmp_path: Path, before: str, after: Any, message: str) -> None:
    path = a_file(tmp_path)
    append_changed(path, before, value=after)

    with pytest.raises(LogUnreadable, match=message):
        read_log(path)


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("response_ms", [1.0], "different lengths"),
        ("response_ms", ["1", 2], "not a number"),
        ("began_ms", [None, 2], "not a number"),
        ("unsuccessful", [2], "missing sample"),
        ("failures", {"x": "died"}, "not numbers of samples"),
        ("failures", {"1": 4}, "4 is not text"),
        ("colours", [], "field is unknown"),
    ],
)
def test_columns_that_do_not_fit_say_why(tmp_path: Path, column: str, value: Any, message: str) -> None:
    path = a_file(tmp_path)
    append_changed(path, "series", 0, "samples", column, value=value)

    with pytest.raises(LogUnreadable, match=message):
        read_log(path)


def test_another_version_is_told(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    append_to_log(path, replace(a_header(), format_version="rarms-datalog/9"))

    with pytest.raises(LogUnreadable, match="rarms-datalog/9"):
        read_log(path)


def chosen(reserve: int = 62) -> Chosen:
    return Chosen(
        component="vision",
        when="2027-01-31T12:00:00Z",
        rarms_version="0",
        apt={"mean_response_time": "at most 100 ms"},
        partition="vision",
        reserve=reserve,
        task="ObjectIdentification",
        data_log="measurements/onboard/vision/busy-loop.jsonl",
        identity="0" * 64,
        setup=a_subject().setup,
        platform_facts=a_bench(),
    )


def test_entries_read_back_and_the_last_choice_holds(tmp_path: Path) -> None:
    path = configuration_path(tmp_path, "onboard", "vision")
    for entry in (chosen(62), chosen(70), PROVEN):
        append_to_log(path, entry)

    entries = read_entries(path)

    assert entries == (chosen(62), chosen(70), PROVEN)
    assert last_chosen(entries) == chosen(70)
    assert last_chosen(()) is None
    assert read_entries(tmp_path / "none.jsonl") == ()


def test_log_lines_follow_the_schema(tmp_path: Path) -> None:
    validator = jsonschema.Draft202012Validator(data_log_schema())
    path = a_file(tmp_path, 10, 70)
    whole = replace(a_setting(80), processors=2, used_processors=1, spent_ms=12.5)
    append_setting(path, a_header(), Recorded(setting=whole, provenance=TAKEN))
    lines = [json.loads(line) for line in path.read_text(encoding="ascii").splitlines()]

    for line in lines:
        validator.validate(line)
    lines[1]["record"]["Recorded"]["setting"]["reserve"] = 0
    with pytest.raises(jsonschema.ValidationError):
        validator.validate(lines[1])


def test_runs_come_back_in_order(tmp_path: Path) -> None:
    path, later = tuning_path(tmp_path, "two-core"), replace(TUNED, after=180)
    assert read_runs(path) == ()
    append_run(path, TUNED)
    append_run(path, later)

    assert path == tmp_path / "measurements" / "two-core" / "tuning.jsonl"
    assert read_runs(path) == (TUNED, later)


def test_repeated_run_is_not_written(tmp_path: Path) -> None:
    path = tuning_path(tmp_path, "two-core")
    append_run(path, TUNED)
    append_run(path, replace(TUNED, when="2026-11-22T12:00:00Z", rarms_version="2"))

    assert read_runs(path) == (TUNED,)
