"""Reads a component's output.

In: a line of text, and `run.samples`. Out: the reading of one job. Begin at `answer_reader`.
"""

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rarms_iac.model.run import Call, Field, Run, Samples
from rarms_iac.model.series import FIRST_SKIPPED, LARGEST_SAMPLE, SkippedLines
from rarms_iac.texts.messages import STREAM_NAMES, counted, quoted

SHOWN = 60
"""Characters of an unreadable line that its message shows."""

_NUMBER = re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?")
"""A number as text: ASCII digits, and no separator of thousands."""

_SEPARATORS = ",.'_\u2019\u00a0\u2009\u202f"
"""Characters inside a number: decimal marks, and separators of thousands."""

_BEFORE = re.compile(
    rf"[0-9](?P<inside>[{_SEPARATORS}]|[eE][+-]?|[xX])?$"  # more digits
    r"|(?:^|[\s=:;(\[])(?:[-\u2212][.,]?|\+?[.,])$"  # a sign, or a decimal mark without a digit before it
)
"""Text that ends with a part of the number that follows it."""

_AFTER = re.compile(rf"((?P<inside>[{_SEPARATORS}eExX])[+-]?)?[0-9]")
"""Text that begins with the rest of a number before it."""

_OTHER_FORM = re.compile(
    r"(?:(?<![^\s=:;(\[])[-+\u2212])?"  # a sign at the start of a word
    rf"(?:(?P<whole>[0-9]+)(?:\.(?P<decimals>[0-9]+))?(?P<rest>(?:[{_SEPARATORS}eExX][+-]?[0-9]+)*)|\b(?i:nan|inf)\b)"
)
"""A number in any form: `1.5`, `1.5e+06`, `1,200`, `0x10`, `-5`, `inf`."""

_BETWEEN = (None, ",")
"""Separators that are allowed between the digits of two named groups."""

_AROUND = rf"[0-9{_SEPARATORS}eExX+\u2212-]*"

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
    """The reason why a damaged sample cannot be read."""

    message: str


LineReader = Callable[[str], Reading | Unreadable | None]
"""Reads a line; None: the line is skipped, because it is neither a sample nor a damaged sample."""


def line_reader(samples: Samples) -> LineReader:
    """Return the reader of a command's lines, by `run.samples`."""
    if samples.source == "pattern":
        return _match_reader(samples)
    return lambda line: read_json(samples, line)


def read_json(samples: Samples, line: str) -> Reading | Unreadable | None:
    """Read one JSON object with the fields that the manifest names.

    A line that begins like an object and cannot be read is a damaged sample; any other line is not a sample.
    """
    if not line.lstrip().startswith("{"):
        return None
    try:
        values = json.loads(line, parse_constant=_refused)
    except (ValueError, RecursionError):
        return Unreadable(message=f"not a JSON object: {quoted(line, SHOWN)}")
    return read_values(samples, values, line)


def _match_reader(samples: Samples) -> LineReader:
    compiled = compile_pattern(samples.pattern)
    groups: Mapping[str, int] = compiled.groupindex
    fields = [field for field in (samples.response_time, samples.success, samples.count) if field is not None]

    def read_match(line: str) -> Reading | Unreadable | None:
        matched = compiled.search(line)
        if matched is None:
            return _refused_number(compiled, fields, line)
        spans = {name: matched.span(number) for name, number in groups.items()}
        for field in fields:
            if (whole := cut_number(line, spans, field.field)) is not None:
                part = quoted(matched.group(groups[field.field]), SHOWN)
                return Unreadable(
                    message=f'the field "{field.field}" reads {part}, only a part of {quoted(whole, SHOWN)}'
                )
        return read_values(samples, matched.groupdict(), line)

    return read_match


def cut_number(line: str, spans: Mapping[str, tuple[int, int]], name: str) -> str | None:
    """Find a number of which a named group has only a part, as in `12,5`, `1.5e+06` or `0x10`.

    Nothing is guessed about decimal commas: a digit after a separator belongs to the number, unless the separator is a
    comma and another named group begins (or, before the number, ends) there.

    Args:
        spans: Begin and end of each named group in it; -1 of one that took no part.

    Returns:
        The text that the group is a part of; None: it has the whole number, or no digit at that end.
    """
    start, end = spans[name]
    text = line[start:end] if start >= 0 else ""
    before = _BEFORE.search(line[max(0, start - 4) : start]) if text[:1].isdigit() or text[:1] == "." else None
    after = _AFTER.match(line, end) if text[-1:].isdigit() or text[-1:] == "." else None
    others = [span for group, span in spans.items() if group != name]
    # Between a digit and a digit stands a comma or nothing: that is where the neighbouring group ends or begins.
    if (
        before
        and before["inside"] in _BETWEEN
        and any(stop in {start, start - len(before["inside"] or "")} for _, stop in others)
    ):
        before = None
    if after and after["inside"] in _BETWEEN and any(begin == end + len(after["inside"] or "") for begin, _ in others):
        after = None
    if before is None and after is None:
        return None
    prefix, suffix = re.search(f"{_AROUND}$", line[max(0, start - SHOWN) : start]), re.match(_AROUND, line[end:])
    assert prefix is not None
    assert suffix is not None
    return f"{prefix[0]}{text}{suffix[0]}".strip(_SEPARATORS)


def _refused_number(compiled: Any, fields: Sequence[Field], line: str) -> Unreadable | None:
    """Find a line that does not match only because of the form of a number, such as `1.2e+06` of a slow job.

    Such a line matches if its numbers are replaced by whole numbers or by plain decimals.
    """
    for plain in (_whole_number, _decimal_number, _whole_of_decimals):
        text, spans = _with_numbers(plain, line)
        matched = compiled.search(text) if spans else None
        if matched is None:
            continue
        for field in fields:
            start, end = matched.span(compiled.groupindex[field.field])
            for written, (begin, stop) in spans:
                if begin < end and start < stop:
                    return Unreadable(message=f'the field "{field.field}" cannot have all of {quoted(written, SHOWN)}')
    return None


def _with_numbers(plain: Callable[[re.Match[str]], str], line: str) -> tuple[str, list[tuple[str, tuple[int, int]]]]:
    """Replace the numbers of a line. Return the text, and each old number with the span of its replacement."""
    parts, changed, at, length = list[str](), list[tuple[str, tuple[int, int]]](), 0, 0
    for found in _OTHER_FORM.finditer(line):
        number = plain(found)
        if number == found[0]:
            continue
        parts += [line[at : found.start()], number]
        length += found.start() - at
        changed.append((found[0], (length, length + len(number))))
        at, length = found.end(), length + len(number)
    return "".join((*parts, line[at:])), changed


def _whole_number(found: re.Match[str]) -> str:
    is_decimal = found[0] == f"{found['whole']}.{found['decimals']}"
    return found[0] if is_decimal else found["whole"] or "0"


def _decimal_number(found: re.Match[str]) -> str:
    is_plain = found[0] in {found["whole"], f"{found['whole']}.{found['decimals']}"}
    return found[0] if is_plain else f"{found['whole'] or 0}.{found['decimals'] or 0}"


def _whole_of_decimals(found: re.Match[str]) -> str:
    return found["whole"] or "0"


def read_values(samples: Samples, values: Mapping[str, Any], line: str) -> Reading | Unreadable:
    """Return the fields that the manifest names, from the values of an object or of a pattern's groups.

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
        response = None if response is None else response * float(samples.response_time.in_ms)
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
    """Return whether the field exists, and its value: a key as written, or a path of keys with dots between."""
    if field.field in values:
        return True, values[field.field]
    value: Any = values
    for key in field.field.split("."):
        if not isinstance(value, Mapping) or key not in value:
            return False, None
        value = value[key]
    return True, value


def number(value: object) -> float | None:
    """Return a finite number that is not negative, also as text; None: it is not one.

    Text is a number as a whole or not at all: `12,5` and `1_000` are refused.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    if isinstance(value, str) and not _NUMBER.fullmatch(value.strip()):
        return None
    try:
        read = float(value)
    except (ValueError, OverflowError):
        return None
    return read if math.isfinite(read) and read >= 0 else None


def truth(value: object) -> bool | None:
    """Read 1 or 0, true or false, also as text; None for anything else."""
    text = str(value).strip().lower() if isinstance(value, bool | int | float | str) else ""
    return {"1": True, "1.0": True, "true": True, "0": False, "0.0": False, "false": False}.get(text)


def compile_pattern(pattern: str) -> Any:
    """Compile a pattern of `run.samples` with RE2, which matches in linear time.

    Raises:
        re2.error: it is not such a pattern, or takes more than `PATTERN_MEMORY` bytes.
        UnicodeEncodeError: it contains half a character.
    """
    import re2

    options = re2.Options()
    options.max_mem = PATTERN_MEMORY
    options.log_errors = False
    return re2.compile(pattern, options=options)


def _refused(name: str) -> float:
    raise ValueError(name)


def _wrong(field: Field, wanted: str, value: object, line: str, *, there: bool) -> Unreadable:
    if not there:
        return Unreadable(message=f'no field "{field.field}" in {quoted(line, SHOWN)}')
    return Unreadable(
        message=f'the field "{field.field}" is {quoted(json.dumps(value, default=str), SHOWN)}, not {wanted}'
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class JobAnswer:
    """A job's answer; or a report that the function is loaded, cannot be loaded, or raised an error."""

    reading: Reading = Reading()
    began: float | None = None  # where the runner knows it; a periodic job's scheduled start
    ready: float | None = None
    cannot: str = ""
    failure: str = ""


AnswerReader = Callable[[str], JobAnswer | Unreadable | None]
"""Reads a line of any component, also of a function's caller; None: the line does not belong to a job."""


def answer_reader(run: Run) -> AnswerReader:
    """Return the reader of a component's lines."""
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
    """Return the job by the caller's clock, and by what the function returned where the manifest names fields."""
    samples = run.samples
    if not any((samples.response_time, samples.success, samples.count)):
        return Reading(response_ms=response)
    if samples.source == "pattern":
        reading = read(result) if isinstance(result, str) else None
        reading = reading or Unreadable(message="the function did not return a text that matches the pattern")
    elif isinstance(result, dict):
        reading = read_values(samples, result, json.dumps(result))
    else:
        return Unreadable(message="the function did not return a map with the fields of `run.samples`")
    if isinstance(reading, Reading) and samples.response_time is None:
        return replace(reading, response_ms=response)
    return reading


def skip_line(skipped: SkippedLines, line: str) -> SkippedLines:
    """Count one more skipped line."""
    first = skipped.first
    if len(first) < FIRST_SKIPPED:
        first = (*first, quoted(line, SHOWN))
    return SkippedLines(count=skipped.count + 1, first=first)


def lines_that_match(read: AnswerReader, text: str) -> int:
    """Count the lines of a text that are samples."""
    return sum(isinstance(read(line), JobAnswer) for line in text.splitlines() if line.strip())


def describe_skipped(samples: Samples, skipped: SkippedLines) -> str:
    """Describe the number of skipped lines, with the first ones."""
    if samples.source == "pattern":
        fault = "did not match the pattern"
    else:
        fault = "was not a JSON object" if skipped.count == 1 else "were not JSON objects"
    which = "the first: " if skipped.count > len(skipped.first) else ""
    return f"{counted(skipped.count, 'line')} {fault} ({which}{', '.join(skipped.first)})"


def describe_no_sample(message: str, samples: Samples, skipped: SkippedLines, elsewhere: int) -> str:
    """Explain why there is no sample, with the skipped lines and the samples of the other stream.

    Args:
        elsewhere: Lines of the other stream that are samples.
    """
    parts = [message]
    if skipped.count:
        parts.append(describe_skipped(samples, skipped))
    if elsewhere:
        other = samples.other_stream
        found = f"{counted(elsewhere, 'line')} of {STREAM_NAMES[other]} {'matches' if elsewhere == 1 else 'match'}"
        parts.append(f"{found}: use `samples: {{stream: {other}}}`")
    return "; ".join(parts)
