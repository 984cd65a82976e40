"""Reads a component's output: a line of text comes in, the reading of one job goes out (`run.samples`)."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from rarms_iac.model.run import Call, Field, Run, Samples
from rarms_iac.model.series import LARGEST_SAMPLE
from rarms_iac.model.wording import quoted

SHOWN = 60
"""Characters of an unreadable line that its message shows."""

PATTERN_MEMORY = 2**20
"""Bytes that a compiled pattern may take."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """The values of one job, as the component wrote them."""

    response_ms: float | None = None
    successful: bool = True
    count: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Unreadable:
    """Why something that should have been a sample is none."""

    message: str


LineReader = Callable[[str], Reading | Unreadable | None]
"""Reads a line; None: the line is no sample at all, and not a damaged one either."""


def line_reader(samples: Samples) -> LineReader:
    """Choose how the lines of a command are read, as `run.samples` says."""
    if samples.source == "pattern":
        match = _matcher(samples.pattern)

        def read_match(line: str) -> Reading | Unreadable | None:
            groups = match(line)
            return None if groups is None else read_values(samples, groups, line)

        return read_match
    return lambda line: read_json(samples, line)


def read_json(samples: Samples, line: str) -> Reading | Unreadable:
    """Read one JSON object with the fields that the manifest names."""
    try:
        values = json.loads(line, parse_constant=_refused)
    except (ValueError, RecursionError):
        return Unreadable(message=f"not a JSON object: {quoted(line, SHOWN)}")
    if not isinstance(values, dict):
        return Unreadable(message=f"not a JSON object: {quoted(line, SHOWN)}")
    return read_values(samples, values, line)


def read_values(samples: Samples, values: Mapping[str, Any], line: str) -> Reading | Unreadable:
    """The fields that the manifest names, from the values of an object or of a pattern's groups.

    A response time that is null (a group that took no part) is a job without an answer; it succeeded only if its
    `success` says so.
    """
    response: float | None = None
    count: float | None = 1.0
    if samples.response_time is not None:
        there, value = look_up(values, samples.response_time)
        response = None if value is None else number(value)
        if not there or (value is not None and response is None):
            return _wrong(samples.response_time, "a time", value, line, there=there)
        response = None if response is None else response * float(samples.response_time.factor)
        if response is not None and response > LARGEST_SAMPLE:
            return _wrong(samples.response_time, f"at most {LARGEST_SAMPLE:.0e} ms", value, line, there=True)
    successful: bool | None = samples.response_time is None or response is not None
    if samples.success is not None:
        there, value = look_up(values, samples.success)
        successful = truth(value)
        if successful is None:
            return _wrong(samples.success, "1 or 0, true or false", value, line, there=there)
    if samples.count is not None:
        there, value = look_up(values, samples.count)
        count = number(value)
        if count is None or count > LARGEST_SAMPLE:
            return _wrong(samples.count, "a number", value, line, there=there)
    return Reading(response_ms=response, successful=bool(successful), count=1.0 if count is None else count)


def look_up(values: Mapping[str, Any], field: Field) -> tuple[bool, Any]:
    """Whether the field is there, and its value: a key as it is written, or a path of keys with dots between."""
    if field.name in values:
        return True, values[field.name]
    value: Any = values
    for key in field.name.split("."):
        if not isinstance(value, Mapping) or key not in value:
            return False, None
        value = value[key]
    return True, value


def number(value: object) -> float | None:
    """A finite number that is not negative, also as text; None where it is none."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        read = float(value)
    except (ValueError, OverflowError):
        return None
    return read if math.isfinite(read) and read >= 0 else None


def truth(value: object) -> bool | None:
    """1 or 0, true or false, also as text; None where it is neither."""
    text = str(value).strip().lower() if isinstance(value, bool | int | float | str) else ""
    return {"1": True, "1.0": True, "true": True, "0": False, "0.0": False, "false": False}.get(text)


def compile_pattern(pattern: str) -> Any:
    """Compile a pattern of `run.samples` with RE2, which matches in linear time.

    Raises:
        re2.error: it is no such pattern, or takes more than `PATTERN_MEMORY` bytes.
        UnicodeEncodeError: it contains half a character.
    """
    import re2

    options = re2.Options()
    options.max_mem = PATTERN_MEMORY
    options.log_errors = False
    return re2.compile(pattern, options=options)


def _matcher(pattern: str) -> Callable[[str], Mapping[str, Any] | None]:
    compiled = compile_pattern(pattern)

    def match(line: str) -> Mapping[str, Any] | None:
        matched = compiled.search(line)
        return None if matched is None else matched.groupdict()

    return match


def _refused(name: str) -> float:
    raise ValueError(name)


def _wrong(field: Field, wanted: str, value: object, line: str, *, there: bool) -> Unreadable:
    if not there:
        return Unreadable(message=f'no field "{field.name}" in {quoted(line, SHOWN)}')
    return Unreadable(
        message=f'the field "{field.name}" is {quoted(json.dumps(value, default=str), SHOWN)}, not {wanted}'
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class JobAnswer:
    """A job's answer; or that the function is loaded, that it cannot be, or that it raised."""

    reading: Reading = Reading()
    began: float | None = None  # where the runner knows it; a periodic job's scheduled start
    ready: float | None = None
    cannot: str = ""
    failure: str = ""


AnswerReader = Callable[[str], JobAnswer | Unreadable | None]
"""Reads a line of any component, a function's caller included; None: it says nothing about a job."""


def answer_reader(run: Run) -> AnswerReader:
    """Choose how this component's lines are read."""
    read = line_reader(run.samples)
    if isinstance(run.start, Call):
        return lambda line: _read_caller(run, read, line)

    def read_command(line: str) -> JobAnswer | Unreadable | None:
        reading = read(line)
        return JobAnswer(reading=reading) if isinstance(reading, Reading) else reading

    return read_command


def _read_caller(run: Run, read: LineReader, line: str) -> JobAnswer | Unreadable | None:
    message = json.loads(line)
    match message:
        case {"ready": float(ready)}:
            return JobAnswer(ready=ready)
        case {"cannot": str(cannot)}:
            return JobAnswer(cannot=cannot)
        case {"due": float(due), "error": str(error)}:
            return JobAnswer(began=due, failure=error)
        case {"due": float(due), "response": float(response)}:
            reading = _read_result(run, read, message.get("result"), response)
            return JobAnswer(reading=reading, began=due) if isinstance(reading, Reading) else reading
        case _:
            return Unreadable(message=f"the runner's line {quoted(line, SHOWN)}")


def _read_result(run: Run, read: LineReader, result: object, response: float) -> Reading | Unreadable:
    """The job by the clock of who called it, and by what the function returned where the manifest names fields."""
    samples = run.samples
    if not any((samples.response_time, samples.success, samples.count)):
        return Reading(response_ms=response)
    if samples.source == "pattern":
        reading = read(result) if isinstance(result, str) else None
        reading = reading or Unreadable(message="the function returned no text that the pattern matches")
    elif isinstance(result, dict):
        reading = read_values(samples, result, json.dumps(result))
    else:
        return Unreadable(message="the function returned no map with the fields that `run.samples` names")
    if isinstance(reading, Reading) and samples.response_time is None:
        return replace(reading, response_ms=response)
    return reading
