"""Our frozen values as JSON and back, by their type hints: journals, data logs, plan files and snapshots.

A dataclass becomes an object of its fields, an enumeration its value, a `Fraction` the text `1/3`, a date its ISO
text, a tuple or frozenset an array, a mapping with text as keys an object in its own order, samples an object of
columns. In a union of dataclasses the `kind` field names the member; where the members have none, an object
`{"<class name>": {...}}` says it. A field of `Any` holds JSON as it is. Reading is strict: what is unknown, missing or
of a wrong type is `NotDecodable`, with the path to it. Nothing is guessed and nothing is executed.
"""

from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import MISSING, Field, fields, is_dataclass
from datetime import date
from enum import Enum
from fractions import Fraction
from functools import cache
from math import inf, isfinite, isnan, nan
from re import compile as pattern
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NewType, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from rarms_iac.model.output import OpenBound, OutputText, output_hints
from rarms_iac.model.series import LARGEST_SAMPLE, Sample, SampleColumns, columns_of
from rarms_iac.storage.ranges import ANY, BY_SETTING, Range, range_of

Json = None | bool | int | float | str | list["Json"] | dict[str, "Json"]
Encode = Callable[[Any], Json]
Decode = Callable[[Any, str], Any]
T = TypeVar("T")

_NUMBER_OF_A_SAMPLE = pattern("[0-9]{1,12}")
_FRACTION = pattern(r"-?[0-9]{1,40}(/[1-9][0-9]{0,40})?")
_KIND = "kind"
_INFINITE = {"inf": inf, "-inf": -inf}


class NotDecodable(ValueError):
    """The JSON is not a value of the type that was asked for."""

    def __init__(self, path: str, message: str) -> None:
        super().__init__(f"{path or 'the document'}: {message}")
        self.path = path
        self.message = message


def _once(make: Callable[[Any], T]) -> Callable[[Any], T]:
    """Return a function that works each type out once."""
    return cast("Callable[[Any], T]", cache(make))


def encode(value: object, hint: object = None) -> Json:
    """Return the JSON of a value, as its type (or the wider `hint`, for a union or mapping) says.

    Args:
        value: a frozen value, or a collection of them.
        hint: the type to read it by; None: the value's own class.

    Returns:
        What `json.dumps` takes; `decode` of it is equal to the value.
    """
    return _encoder(type(value) if hint is None else hint)(value)


def encode_output(value: object) -> Json:
    """Return the JSON of a result for programs, as `model.output` says.

    rarms never reads it, so it names no types.

    Args:
        value: a frozen value, or a collection of them.

    Returns:
        What `json.dumps` takes: an exact number is the nearest that JSON has, an infinite one null, a key its text.
    """
    match value:
        case OutputText():
            return str(value)
        case Enum():
            return encode_output(value.value)
        case Fraction():
            return float(value)
        case float():
            return value if isfinite(value) else None
        case str():
            return value.encode("utf-8", "replace").decode("utf-8")  # strict parsers refuse lone surrogates
        case None | bool() | int():
            return value
        case date():
            return value.isoformat()
        case Mapping():
            return {str(key): encode_output(item) for key, item in value.items()}
        case frozenset():
            return [encode_output(item) for item in sorted(value)]
        case Sequence():
            return [encode_output(item) for item in value]
        case _:
            cls: Any = type(value)
            return {name: encode_output(getattr(value, name)) for name in output_hints(cls)}


def decode(hint: type[T], data: object) -> T:
    """Return the value of this type that the JSON says.

    Args:
        hint: a class; a union takes `decode_union`.

    Returns:
        The value, every field of it checked.

    Raises:
        NotDecodable: it says something else.
    """
    return cast("T", _decoder(hint)(data, ""))


def decode_union(hint: object, data: object) -> Any:
    """Decode as `decode` does, for a union or another type that is not a class.

    Returns:
        The value.

    Raises:
        NotDecodable: the JSON says something else.
    """
    return _decoder(hint)(data, "")


N = TypeVar("N", int, float)


def in_range(number: N, allowed: Range, path: str) -> N:
    """Give the number back where its range has it.

    Returns:
        The same number.

    Raises:
        NotDecodable: it is smaller or larger.
    """
    least, most = allowed
    if not least <= number <= most:
        raise NotDecodable(path, f"{_shortened(number)} is not between {least:,} and {most:,}")
    return number


def _in_64_bits(number: int, path: str) -> int:
    """Return the number where 64 bits, with or without a sign, hold it: all that is computed from it stays finite."""
    if not -(2**63) <= number < 2**64:
        raise NotDecodable(path, "it is a whole number of more than 64 bits")
    return number


@_once
def _encoder(hint: Any) -> Encode:
    hint = _bare(hint)
    if hint is Any:
        return lambda value: cast("Json", value)
    if _is_record(hint):
        return _encode_dataclass(hint)
    if hint == OpenBound:
        return lambda value: value if isfinite(value) else str(value)
    if hint in (str, int, bool, float, NoneType) or get_origin(hint) is Literal:
        return lambda value: cast("Json", value)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return lambda value: value.value
    if hint is Fraction:
        return str
    if hint is date:
        return lambda value: value.isoformat()
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return _encode_union(arguments)
    if origin is tuple:
        return _encode_tuple(arguments)
    if hint == Sequence[Sample]:
        return _encode_samples
    if origin is Sequence:
        return _encode_tuple((arguments[0], ...))
    if origin is frozenset:
        encode_item = _encoder(arguments[0])
        return lambda value: [encode_item(item) for item in sorted(value)]
    if origin is Mapping:
        encode_item = _encoder(arguments[1])
        return lambda value: {key: encode_item(item) for key, item in value.items()}
    raise TypeError(f"no JSON for {hint!r}")


@_once
def _decoder(hint: Any) -> Decode:
    hint = _bare(hint)
    if hint is Any:
        return lambda data, _: data
    if _is_record(hint):
        return _decode_dataclass(hint)
    if hint in (str, int, bool, NoneType):
        return _exactly(hint)
    if hint == OpenBound:
        return lambda data, path: _INFINITE[data] if data in _INFINITE else _decode_float(data, path)
    if hint is float:
        return _decode_float
    if isinstance(hint, type) and issubclass(hint, Enum):
        return _one_of({member.value: member for member in hint})
    if hint is Fraction:
        return _decode_fraction
    if hint is date:
        return _decode_date
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Literal:
        return _one_of({value: value for value in arguments})
    if origin in (Union, UnionType):
        return _decode_union(arguments)
    if origin is tuple:
        return _decode_tuple(arguments)
    if hint == Sequence[Sample]:
        return _decode_samples
    if origin is Sequence:
        return _decode_tuple((arguments[0], ...))
    if origin is frozenset:
        many = _decode_tuple((arguments[0], ...))
        return lambda data, path: frozenset(many(data, path))
    if origin is Mapping:
        item = _decoder(arguments[1])
        return lambda data, path: {key: item(each, _below(path, key)) for key, each in _object(data, path).items()}
    raise TypeError(f"no value from JSON for {hint!r}")


def _bare(hint: Any) -> Any:
    """Return the type behind a NewType or remarks on it; a bound that may be infinite stays one."""
    while hint != OpenBound:
        if isinstance(hint, NewType):
            hint = hint.__supertype__
        elif get_origin(hint) is Annotated:
            hint = get_args(hint)[0]
        else:
            return hint
    return hint


def _is_record(hint: Any) -> bool:
    return isinstance(hint, type) and is_dataclass(hint)


def _hints(cls: type) -> list[tuple[Field[Any], Any]]:
    hints = get_type_hints(cls, include_extras=True)
    return [(field, hints[field.name]) for field in fields(cls)]


def _encode_dataclass(cls: type) -> Encode:
    parts: list[tuple[str, Encode]] = []  # filled below: a type may contain itself

    def write(value: Any) -> Json:
        if not parts:
            parts.extend((field.name, _encoder(hint)) for field, hint in _hints(cls))
        return {name: part(getattr(value, name)) for name, part in parts}

    return write


def _decode_dataclass(cls: type) -> Decode:
    parts: dict[str, Decode] = {}
    required = frozenset(
        field.name for field in fields(cls) if field.default is MISSING and field.default_factory is MISSING
    )

    def read(data: Any, path: str) -> Any:
        if not parts:
            parts.update((field.name, decoder_of_field(cls.__name__, field.name, hint)) for field, hint in _hints(cls))
        given = _fields(data, path, required, parts.keys())
        values = {name: parts[name](value, _below(path, name)) for name, value in given.items()}
        try:
            return cls(**values)
        except ValueError as problem:  # of its `__post_init__`
            raise NotDecodable(path, str(problem)) from problem

    return read


def decoder_of_field(record: str, name: str, hint: Any) -> Decode:
    """Return the decoder of a field, which also holds its numbers to their range.

    Returns:
        A function of JSON and the path to it, which gives the value or raises `NotDecodable`.
    """
    decode_field = _decoder(hint)
    if not has_numbers(hint):
        return decode_field
    if f"{record}.{name}" in BY_SETTING:
        return _decode_settings(decode_field)
    if (allowed := range_of(record, name)) == ANY:
        return decode_field

    def read(data: Any, path: str) -> Any:
        value = decode_field(data, path)
        for number in _numbers_in(value):
            in_range(number, allowed, path)
        return value

    return read


def _decode_settings(decode_values: Decode) -> Decode:
    def read(data: Any, path: str) -> Any:
        values = decode_values(data, path)
        for name, value in values.items():
            for number in _numbers_in(value):
                in_range(number, range_of("PartitionSettings", name), _below(path, name))
        return values

    return read


def has_numbers(hint: Any) -> bool:
    """Return whether a type holds numbers, also in collections; those of nested records do not count.

    Returns:
        False also for exact fractions, which say where they are read what they may be.
    """
    bare = _bare(hint)
    if get_origin(bare) is Literal:
        return False
    return bare in (int, float) or any(map(has_numbers, get_args(bare)))


def _numbers_in(value: Any) -> Iterator[float]:
    if isinstance(value, int | float):
        if value is not True and value is not False:
            yield value
    elif isinstance(value, Mapping):
        for item in value.values():
            yield from _numbers_in(item)
    elif isinstance(value, tuple | frozenset):
        for item in value:
            yield from _numbers_in(item)


def _kind_of(cls: Any) -> str | None:
    """Return the constant value of a dataclass' `kind` field, None where it has none."""
    if not _is_record(cls) or _KIND not in {field.name for field in fields(cls)}:
        return None
    values = get_args(get_type_hints(cls)[_KIND])
    return str(values[0]) if len(values) == 1 else None


def _encode_union(members: tuple[Any, ...]) -> Encode:
    classes = [_bare(member) for member in members]
    records = [task_class for task_class in classes if _is_record(task_class)]
    wrapped = {record for record in records if _kind_of(record) is None and len(records) > 1}
    plain = [task_class for task_class in classes if not _is_record(task_class)]

    def write(value: Any) -> Json:
        cls = type(value)
        if cls in wrapped:
            return {cls.__name__: _encoder(cls)(value)}
        if cls in records or cls in plain:
            return _encoder(cls)(value)
        (only,) = (hint for hint in plain if hint is not NoneType and isinstance(value, get_origin(hint) or hint))
        return _encoder(only)(value)

    return write


def _decode_union(members: tuple[Any, ...]) -> Decode:
    classes = [_bare(member) for member in members]
    records = [task_class for task_class in classes if _is_record(task_class)]
    plain = [task_class for task_class in classes if not _is_record(task_class) and task_class is not NoneType]
    kinds = {kind: record for record in records if (kind := _kind_of(record)) is not None}
    wrapped = {record.__name__: record for record in records if _kind_of(record) is None}

    def read_record(data: dict[str, Any], path: str) -> Any:
        if len(records) == 1:
            return _decoder(records[0])(data, path)
        if isinstance(kind := data.get(_KIND), str) and kind in kinds:
            return _decoder(kinds[kind])(data, path)
        if len(data) == 1 and (name := next(iter(data))) in wrapped:
            return _decoder(wrapped[name])(data[name], _below(path, name))
        raise NotDecodable(path, f"it is not one of {', '.join(sorted([*kinds, *wrapped]))}")

    def read(data: Any, path: str) -> Any:
        if records and type(data) is dict:
            return read_record(data, path)
        if data is None and NoneType in classes:
            return None
        for hint in plain[:-1]:
            # NOTE: the exception is not kept: its frames hold the whole line of a long log until they are collected.
            with suppress(NotDecodable):
                return _decoder(hint)(data, path)
        if plain:
            return _decoder(plain[-1])(data, path)
        raise NotDecodable(path, f"{_shortened(data)} does not fit here")

    return read


def _encode_tuple(arguments: tuple[Any, ...]) -> Encode:
    if arguments[1:] == (...,):
        encode_item = _encoder(arguments[0])
        return lambda value: [encode_item(item) for item in value]
    parts = [_encoder(argument) for argument in arguments]
    return lambda value: [part(item) for part, item in zip(parts, value, strict=True)]


def _decode_tuple(arguments: tuple[Any, ...]) -> Decode:
    if arguments[1:] == (...,):
        decode_item = _decoder(arguments[0])
        return lambda data, path: tuple(
            decode_item(item, f"{path}[{at}]") for at, item in enumerate(_array(data, path))
        )
    parts = [_decoder(argument) for argument in arguments]

    def read(data: Any, path: str) -> tuple[Any, ...]:
        items = _array(data, path)
        if len(items) != len(parts):
            raise NotDecodable(path, f"it has {len(items)} items, not {len(parts)}")
        return tuple(part(item, f"{path}[{at}]") for at, (part, item) in enumerate(zip(parts, items, strict=True)))

    return read


_SAMPLE_COLUMNS = frozenset({"began_ms", "response_ms"})
_RARE_COLUMNS = frozenset({"unsuccessful", "counts", "failures"})
"""Columns that are left out where they have what is usual: a success, a count of one, no failure."""


def _encode_samples(samples: Sequence[Sample]) -> Json:
    """Return columns of numbers rather than an object a sample, so that a reviewer can read along."""
    columns = columns_of(samples)
    document: dict[str, Json] = {
        "began_ms": list(columns.began_ms),
        "response_ms": [None if isnan(time) else time for time in columns.response_ms],
    }
    if 0 in columns.successful:
        document["unsuccessful"] = [at for at, successful in enumerate(columns.successful) if not successful]
    if any(count != 1 for count in columns.counts):
        document["counts"] = list(columns.counts)
    if columns.failures:
        document["failures"] = {str(at): reason for at, reason in columns.failures.items()}
    return document


def _decode_samples(data: Any, path: str) -> SampleColumns:
    given = _fields(data, path, _SAMPLE_COLUMNS, _SAMPLE_COLUMNS | _RARE_COLUMNS)
    # A job may have begun, or been due, before its host had settled and samples counted.
    began = _column(given["began_ms"], f"{path}.began_ms", least=-LARGEST_SAMPLE)
    answers = _column(given["response_ms"], f"{path}.response_ms", others=NoneType)
    counts = _column(given["counts"], f"{path}.counts") if "counts" in given else array("d", [1.0]) * len(began)
    if not len(began) == len(answers) == len(counts):
        raise NotDecodable(path, "its columns are of different lengths")
    successful = bytearray(b"\1") * len(began)
    for at in sample_numbers(given.get("unsuccessful", []), len(began), f"{path}.unsuccessful"):
        successful[at] = 0
    failures = _decoder(Mapping[str, str])(given.get("failures", {}), f"{path}.failures")
    if not all(map(_NUMBER_OF_A_SAMPLE.fullmatch, failures)):
        raise NotDecodable(f"{path}.failures", "its keys are not numbers of samples")
    sample_numbers(list(map(int, failures)), len(began), f"{path}.failures")
    return SampleColumns(
        began_ms=began,
        response_ms=answers,
        successful=bytes(successful),
        counts=counts,
        failures=dict(sorted((int(at), reason) for at, reason in failures.items())),
    )


def _column(data: Any, path: str, least: float = 0.0, others: type = float) -> "array[float]":
    """Return a column of numbers, NaN for null. NOTE: it is checked as a whole; a log holds many thousand numbers."""
    types = set(map(type, _array(data, path)))
    if not types <= {int, float, others}:
        raise NotDecodable(path, "it contains a value that is not a number")
    numbers = [value for value in data if value is not None] if NoneType in types else data
    if numbers and not (min(numbers) >= least and max(numbers) <= LARGEST_SAMPLE):
        raise NotDecodable(path, f"a number is below {least:g} or above {LARGEST_SAMPLE:.0e}")
    return array("d", [nan if value is None else value for value in data] if NoneType in types else data)


def sample_numbers(data: Any, length: int, path: str) -> Sequence[int]:
    """Return numbers of samples, of which there are `length`.

    Raises:
        NotDecodable: it is something else, or a sample is not there.
    """
    if not isinstance(data, list | tuple) or not set(map(type, data)) <= {int}:
        raise NotDecodable(path, "it is not an array of whole numbers")
    if data and (min(data) < 0 or max(data) >= length):
        raise NotDecodable(path, f"it refers to a missing sample: {length} are recorded")
    return data


def _exactly(cls: Any) -> Decode:
    def read(data: Any, path: str) -> Any:
        if type(data) is not cls:  # so that true is not a number
            raise NotDecodable(path, f"{_shortened(data)} is not {_NAMES[cls]}")
        return _in_64_bits(data, path) if cls is int else data

    return read


_NAMES = {str: "text", int: "a whole number", bool: "true or false", NoneType: "null"}


def _one_of(members: dict[Any, Any]) -> Decode:
    def read(data: Any, path: str) -> Any:
        if type(data) not in (str, int, bool) or data not in members:
            raise NotDecodable(path, f"{_shortened(data)} is not one of {', '.join(map(str, members))}")
        return members[data]

    return read


def _decode_float(data: Any, path: str) -> float:
    if type(data) not in (int, float):
        raise NotDecodable(path, f"{_shortened(data)} is not a number")
    return float(_in_64_bits(data, path) if type(data) is int else data)


def _decode_fraction(data: Any, path: str) -> Fraction:
    if type(data) is not str or not _FRACTION.fullmatch(data):
        raise NotDecodable(path, f"{_shortened(data)} is not an exact number such as 7 or 1/3")
    return Fraction(data)


def _decode_date(data: Any, path: str) -> date:
    try:
        return date.fromisoformat(data)
    except (TypeError, ValueError):
        raise NotDecodable(path, f"{_shortened(data)} is not a date such as 2027-01-31") from None


def _object(data: Any, path: str) -> dict[str, Any]:
    if type(data) is not dict:
        raise NotDecodable(path, f"{_shortened(data)} is not an object")
    return data


def _fields(data: Any, path: str, required: Set[str], known: Set[str]) -> dict[str, Any]:
    given = _object(data, path)
    if unknown := given.keys() - known:
        raise NotDecodable(_below(path, min(unknown)), "this field is unknown")
    if missing := required - given.keys():
        raise NotDecodable(_below(path, min(missing)), "the field is missing")
    return given


def _array(data: Any, path: str) -> list[Any]:
    if type(data) is not list:
        raise NotDecodable(path, f"{_shortened(data)} is not an array")
    return data


def _below(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _shortened(data: Any) -> str:
    """Return the JSON value for a message, short."""
    if isinstance(data, dict | list):
        return "an object" if isinstance(data, dict) else "an array"
    text = "null" if data is None else str(data).lower() if isinstance(data, bool) else repr(data)
    return text if len(text) <= 40 else f"{text[:37]}..."
