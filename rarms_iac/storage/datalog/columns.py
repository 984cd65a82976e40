"""A setting as one line: columns of numbers rather than an object a sample, so that a reviewer can read along.

Times are kept to a tenth of a microsecond. What is usual is left out: a success, a count of one, no failure.
"""

import re
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from math import isnan, nan
from types import NoneType
from typing import Any, cast

from rarms_iac.model.series import LARGEST_SAMPLE, SampleColumns, Series, columns_of
from rarms_iac.model.setting import Setting, SettingEvidence
from rarms_iac.storage.codec import Json, NotDecodable, decode, encode, in_range
from rarms_iac.storage.datalog.log import Provenance, Recorded
from rarms_iac.storage.ranges import range_of

DIGITS = 4
"""Decimals of a millisecond."""

_SETTING = frozenset({"reserve", "beside", "seed", "series", "provenance"})
_EVIDENCE = "evidence"
"""Only what was measured on a host that counts has it."""
_SPENT = "spent_ms"
_PROCESSORS = "processors"
"""What was measured before these were recorded lacks them."""
_USED = "used_processors"
"""Only what was measured where that can be seen has it."""

_OPTIONAL = frozenset({"unsuccessful", "count", "failures", "unsettled", "starts"})
_SERIES = _OPTIONAL | {"component", "elapsed_ms", "cpu_ms", "began_ms", "response_ms"}
_NUMBER: frozenset[type] = frozenset({int, float})
_ANSWER: frozenset[type] = frozenset({int, float, NoneType})
_NUMBER_OF_A_SAMPLE = re.compile("[0-9]{1,12}")


def as_recorded(setting: Setting) -> Setting:
    """Return the setting as it will be read back: its times rounded.

    All that decides by what was measured decides by this, so that a run that goes on from its log decides the same.

    Returns:
        A setting that equals what `setting_in` gives of its line.
    """
    series = tuple(_rounded_series(series) for series in setting.series)
    return replace(
        setting,
        series=series,
        evidence=setting.evidence and _rounded_evidence(setting.evidence),
        spent_ms=None if setting.spent_ms is None else round(setting.spent_ms, DIGITS),
    )


def line_of(recorded: Recorded) -> dict[str, Json]:
    """Return the record of a setting.

    Args:
        recorded: a setting, and where and when it was measured.

    Returns:
        Fields of JSON values; the samples as columns, which a reviewer reads and git packs.
    """
    setting = as_recorded(recorded.setting)
    evidence: dict[str, Json] = {} if setting.evidence is None else {_EVIDENCE: encode(setting.evidence)}
    if setting.spent_ms is not None:
        evidence[_SPENT] = setting.spent_ms
    if setting.processors:
        evidence[_PROCESSORS] = setting.processors
    if setting.used_processors is not None:
        evidence[_USED] = setting.used_processors
    return {
        "reserve": setting.reserve,
        "beside": setting.beside,
        "seed": setting.seed,
        "series": [_columns(series) for series in setting.series],
        **evidence,
        "provenance": encode(recorded.provenance),
    }


def setting_in(line: Mapping[str, Json]) -> Recorded:
    """Return the setting that a record says.

    Args:
        line: a record of a data log.

    Returns:
        The setting; its samples stay columns.

    Raises:
        NotDecodable: it is none.
    """
    _fields(line, _SETTING, _SETTING | {_EVIDENCE, _SPENT, _PROCESSORS, _USED}, "")
    series = line["series"]
    if not isinstance(series, list):
        raise NotDecodable("series", "it is no array")
    reserve = _whole(line, "reserve")
    evidence = decode(SettingEvidence, line[_EVIDENCE]) if _EVIDENCE in line else None
    spent = line.get(_SPENT)
    _check_numbers([spent], _ANSWER, _SPENT)
    columns = (_series(column, f"series[{at}]") for at, column in enumerate(series))
    setting = Setting(
        reserve=reserve,
        beside=_whole(line, "beside"),
        seed=_whole(line, "seed"),
        series=tuple(replace(each, wanders=evidence is not None) for each in columns),
        evidence=evidence,
        spent_ms=cast("float | None", spent),
        processors=_whole(line, _PROCESSORS) if _PROCESSORS in line else 0,
        used_processors=_whole(line, _USED) if _USED in line else None,
    )
    return Recorded(setting=setting, provenance=decode(Provenance, line["provenance"]))


def _rounded_evidence(evidence: SettingEvidence) -> SettingEvidence:
    return replace(evidence, **{part.name: _rounded_times(getattr(evidence, part.name)) for part in fields(evidence)})


def _rounded_times(times: Any) -> Any:
    match times:
        case float():
            return round(times, DIGITS)
        case Mapping():
            return {name: _rounded_times(time) for name, time in sorted(times.items())}
        case _:
            return times


def _rounded_series(series: Series) -> Series:
    return replace(
        series,
        samples=_rounded_samples(columns_of(series.samples)),
        elapsed_ms=round(series.elapsed_ms, DIGITS),
        cpu_ms=None if series.cpu_ms is None else round(series.cpu_ms, DIGITS),
    )


def _rounded_samples(samples: SampleColumns) -> SampleColumns:
    began, answers = (
        array("d", [round(time, DIGITS) for time in times]) for times in (samples.began_ms, samples.response_ms)
    )
    return replace(samples, began_ms=began, response_ms=answers, known={})


def _columns(series: Series) -> dict[str, Json]:
    samples = columns_of(series.samples)
    columns: dict[str, Json] = {
        "component": series.component,
        "elapsed_ms": series.elapsed_ms,
        "cpu_ms": series.cpu_ms,
        "began_ms": list(samples.began_ms),
        "response_ms": [None if isnan(time) else time for time in samples.response_ms],
    }
    unsuccessful: list[Json] = [at for at, successful in enumerate(samples.successful) if not successful]
    if unsuccessful:
        columns["unsuccessful"] = unsuccessful
    if any(count != 1 for count in samples.counts):
        columns["count"] = list(samples.counts)
    if samples.failures:
        columns["failures"] = {str(at): reason for at, reason in samples.failures.items()}
    if series.unsettled:
        columns["unsettled"] = series.unsettled
    if series.starts:
        columns["starts"] = list(series.starts)
    return columns


def _series(data: Json, path: str) -> Series:
    if not isinstance(data, dict):
        raise NotDecodable(path, "it is no object")
    _fields(data, _SERIES - _OPTIONAL, _SERIES, path)
    # A job may have begun, or been due, before its host had settled and samples counted.
    began = _column(data, "began_ms", _NUMBER, path, least=-LARGEST_SAMPLE)
    response: Sequence[float | None] = _column(data, "response_ms", _ANSWER, path)
    counts = _column(data, "count", _NUMBER, path) if "count" in data else [1.0] * len(began)
    if not len(began) == len(response) == len(counts):
        raise NotDecodable(path, "its columns are of different lengths")
    missed = _indexes(data.get("unsuccessful", []), len(began), f"{path}.unsuccessful")
    failures = _failures(data.get("failures", {}), len(began), f"{path}.failures")
    name, elapsed, cpu = data["component"], data["elapsed_ms"], data["cpu_ms"]
    unsettled = data.get("unsettled", "")
    for field_name, text in (("component", name), ("unsettled", unsettled)):
        if type(text) is not str:
            raise NotDecodable(f"{path}.{field_name}", "it is no text")
    _check_numbers([elapsed], _NUMBER, f"{path}.elapsed_ms")
    _check_numbers([cpu], _ANSWER, f"{path}.cpu_ms")
    successful = bytearray(b"\1") * len(began)
    for at in missed:
        successful[at] = 0
    samples = SampleColumns(
        began_ms=array("d", began),
        response_ms=array("d", [nan if time is None else time for time in response]),
        successful=bytes(successful),
        counts=array("d", counts),
        failures=failures,
    )
    return Series(
        component=cast("str", name),
        samples=samples,
        elapsed_ms=cast("float", elapsed),
        cpu_ms=cast("float | None", cpu),
        unsettled=cast("str", unsettled),
        starts=tuple(_indexes(data.get("starts", []), len(began), f"{path}.starts")),
    )


def _fields(data: Mapping[str, Json], needed: frozenset[str], known: frozenset[str], path: str) -> None:
    prefix = f"{path}." if path else ""
    if missing := needed - data.keys():
        raise NotDecodable(prefix + min(missing), "the field is missing")
    if unknown := data.keys() - known:
        raise NotDecodable(prefix + min(unknown), "there is no such field")


def _whole(data: Mapping[str, Json], name: str) -> int:
    value = data[name]
    if type(value) is not int:
        raise NotDecodable(name, "it is no whole number")
    return in_range(value, range_of("Setting", name), name)


def _column(
    data: Mapping[str, Json], name: str, types: frozenset[type], path: str, least: float = 0.0
) -> Sequence[float]:
    column = data[name]
    if not isinstance(column, list):
        raise NotDecodable(f"{path}.{name}", "it is no array")
    _check_numbers(column, types, f"{path}.{name}", least)
    return cast("Sequence[float]", column)


def _check_numbers(values: Sequence[Json], types: frozenset[type], path: str, least: float = 0.0) -> None:
    """NOTE: checked as a whole, because a log holds many thousand numbers."""
    found = set(map(type, values))
    if not found <= types:
        raise NotDecodable(path, "it is or holds what is no number")
    numbers = cast("Sequence[float]", [value for value in values if value is not None] if NoneType in found else values)
    if numbers and not (min(numbers) >= least and max(numbers) <= LARGEST_SAMPLE):
        raise NotDecodable(path, f"a number is below {least:g} or above {LARGEST_SAMPLE:.0e}")


def _indexes(data: Json, length: int, path: str) -> Sequence[int]:
    if not isinstance(data, list) or not set(map(type, data)) <= {int}:
        raise NotDecodable(path, "it is no array of whole numbers")
    found = cast("Sequence[int]", data)
    if found and (min(found) < 0 or max(found) >= length):
        raise NotDecodable(path, f"it names a sample that is not there: there are {length}")
    return found


def _failures(data: Json, length: int, path: str) -> Mapping[int, str]:
    if not isinstance(data, dict) or not all(type(reason) is str for reason in data.values()):
        raise NotDecodable(path, "it is no object of texts")
    if not all(_NUMBER_OF_A_SAMPLE.fullmatch(key) for key in data):
        raise NotDecodable(path, "its keys are no numbers of samples")
    found = {int(key): cast("str", message) for key, message in data.items()}
    _indexes(cast("Json", list(found)), length, path)
    return dict(sorted(found.items()))
