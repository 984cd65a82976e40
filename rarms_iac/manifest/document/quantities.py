"""Quantities as the manifest writes them: text with a unit in, exact values out."""

from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache
from typing import Annotated, Any

from pydantic import AfterValidator, PlainValidator, WithJsonSchema
from pydantic_core import InitErrorDetails, PydanticCustomError, ValidationError

from rarms_iac.model.indexes import INDEXES, PERCENTILE_PATTERN, PerformanceIndex, find_index, percentile_index
from rarms_iac.model.quantities import (
    Bytes,
    CpuAmount,
    LogicalProcessors,
    Milliseconds,
    NotAQuantity,
    Percent,
    ProcessorTime,
    ShareOfHost,
    Unit,
    parse_quantity,
    units_of,
)
from rarms_iac.model.system import AtLeast, AtMost, Measured, Threshold

_EXAMPLES = {
    Unit.TIME: "88 ms",
    Unit.MEMORY: "512 MiB",
    Unit.SHARE: "70 %",
    Unit.PROCESSORS: "1.4 LP",
    Unit.RATE: "24 /s",
}


def quantity_error(kinds: tuple[Unit, ...], *, positive: bool = False, also: str = "") -> PydanticCustomError:
    """What a field says of a value that is not such a quantity; `errors.py` puts it into words."""
    facts = {"units": units_of(*kinds), "examples": tuple(_EXAMPLES[kind] for kind in kinds), "positive": positive}
    return PydanticCustomError("rarms_quantity", "not a quantity", {**facts, "also": also})


def quantity_schema(*kinds: Unit, positive: bool = False) -> dict[str, Any]:
    """The JSON Schema of such a text."""
    units = "|".join(units_of(*kinds))
    some = r"(?=[0-9.]*[1-9])" if positive else ""
    return {
        "type": "string",
        "pattern": rf"^{some}[0-9]{{1,15}}(\.[0-9]{{1,15}})? ?({units})$",
        "examples": [_EXAMPLES[kind] for kind in kinds],
    }


def _reader(*kinds: Unit, positive: bool = False, make: Callable[[Unit, Fraction], Any]) -> Callable[[Any], Any]:
    @lru_cache(maxsize=4096)
    def parsed(text: str) -> Any:
        kind, value = parse_quantity(text, *kinds)
        if positive and value <= 0:
            raise NotAQuantity(text, units_of(*kinds))
        return make(kind, value)

    def read(value: Any) -> Any:
        if type(value) is str:
            try:
                return parsed(value)
            except NotAQuantity:
                pass
        raise quantity_error(kinds, positive=positive)

    return read


def _same(_kind: Unit, value: Fraction) -> Fraction:
    return value


def _whole(_kind: Unit, value: Fraction) -> int:
    return int(value)


def _amount(kind: Unit, value: Fraction) -> CpuAmount:
    return ShareOfHost(Percent(value)) if kind is Unit.SHARE else ProcessorTime(LogicalProcessors(value))


_read_amount = _reader(Unit.SHARE, Unit.PROCESSORS, make=_amount)


def _read_reserve(value: Any) -> Any:
    if value == "measured":
        return Measured.MEASURED
    try:
        return _read_amount(value)
    except PydanticCustomError:
        raise quantity_error((Unit.SHARE, Unit.PROCESSORS), also="measured") from None


Time = Annotated[
    Milliseconds, PlainValidator(_reader(Unit.TIME, make=_same)), WithJsonSchema(quantity_schema(Unit.TIME))
]
PositiveTime = Annotated[
    Milliseconds,
    PlainValidator(_reader(Unit.TIME, positive=True, make=_same)),
    WithJsonSchema(quantity_schema(Unit.TIME, positive=True)),
]
LONGEST_WAIT = Milliseconds(Fraction(3_600_000))
"""One hour: longer than any guest needs to shut down, and short enough for a script to wait through."""


def _bearable(value: Milliseconds) -> Milliseconds:
    if value > LONGEST_WAIT:
        raise PydanticCustomError("rarms_too_long", "longer than one hour")
    return value


Wait = Annotated[Time, AfterValidator(_bearable)]
Memory = Annotated[
    Bytes, PlainValidator(_reader(Unit.MEMORY, make=_whole)), WithJsonSchema(quantity_schema(Unit.MEMORY))
]
PositiveMemory = Annotated[
    Bytes,
    PlainValidator(_reader(Unit.MEMORY, positive=True, make=_whole)),
    WithJsonSchema(quantity_schema(Unit.MEMORY, positive=True)),
]
Share = Annotated[Percent, PlainValidator(_reader(Unit.SHARE, make=_same)), WithJsonSchema(quantity_schema(Unit.SHARE))]
Amount = Annotated[
    CpuAmount, PlainValidator(_read_amount), WithJsonSchema(quantity_schema(Unit.SHARE, Unit.PROCESSORS))
]
PositiveAmount = Annotated[
    CpuAmount,
    PlainValidator(_reader(Unit.SHARE, Unit.PROCESSORS, positive=True, make=_amount)),
    WithJsonSchema(quantity_schema(Unit.SHARE, Unit.PROCESSORS, positive=True)),
]
Reserve = Annotated[
    CpuAmount | Measured,
    PlainValidator(_read_reserve),
    WithJsonSchema({"anyOf": [{"const": "measured"}, quantity_schema(Unit.SHARE, Unit.PROCESSORS)]}),
]


_WORDS = ("at_most", "at_least")


@lru_cache(maxsize=4096)
def _index(name: str) -> PerformanceIndex | None:
    return find_index(name)


@lru_cache(maxsize=4096)
def _threshold(index: PerformanceIndex, text: str) -> Threshold:
    _, value = parse_quantity(text, index.unit)
    return AtMost(value=value) if index.smaller_is_better else AtLeast(value=value)


def read_thresholds(value: Any) -> dict[str, Threshold]:
    """The thresholds by index.

    Raises:
        ValidationError: with every wrong index, word and quantity at its own path.
    """
    if type(value) is not dict:
        raise PydanticCustomError("rarms_map", "not a map", {})
    made: dict[str, Threshold] = {}
    wrong: list[InitErrorDetails] = []
    for name, says in value.items():
        index = _index(name)
        if index is None:
            wrong.append(_error((name,), PydanticCustomError("rarms_index", "unknown index", {"name": name}), says))
        elif not (problems := _problems(index, says)):
            made[name] = _threshold(index, says[index.direction])
        else:
            wrong += problems
    if wrong:
        raise ValidationError.from_exception_data("apt", wrong)
    return made


def _problems(index: PerformanceIndex, says: Any) -> list[InitErrorDetails]:
    """Everything wrong with what one index says."""
    if type(says) is not dict:
        return [_error((index.name,), PydanticCustomError("rarms_map", "not a map", {}), says)]
    found = [
        _error((index.name, key), PydanticCustomError("extra_forbidden", "unknown key", {}), text)
        for key, text in says.items()
        if key not in _WORDS
    ]
    other = _WORDS[index.smaller_is_better]
    if other in says:
        facts = {"index": index.name, "direction": index.direction, "smaller": index.smaller_is_better}
        found.append(
            _error((index.name, other), PydanticCustomError("rarms_direction", "wrong way", facts), says[other])
        )
    elif index.direction not in says:
        found.append(_error((index.name, index.direction), PydanticCustomError("missing", "missing", {}), says))
    if index.direction in says and not _is_quantity(index, says[index.direction]):
        found.append(_error((index.name, index.direction), quantity_error((index.unit,)), says[index.direction]))
    return found


def _is_quantity(index: PerformanceIndex, text: Any) -> bool:
    try:
        return type(text) is str and bool(_threshold(index, text))
    except NotAQuantity:
        return False


def _error(path: tuple[str, ...], error: PydanticCustomError, value: Any) -> InitErrorDetails:
    return InitErrorDetails(type=error, loc=path, input=value)


def _schema() -> dict[str, Any]:
    family = percentile_index("p95_response_time")
    assert family is not None
    return {
        "type": "object",
        "properties": {index.name: _schema_of(index) for index in INDEXES.values()},
        "patternProperties": {
            PERCENTILE_PATTERN: _schema_of(family)
            | {"description": "A percentile of the response times of all jobs that answered, as in p95_response_time."}
        },
        "additionalProperties": False,
    }


def _schema_of(index: PerformanceIndex) -> dict[str, Any]:
    return {
        "type": "object",
        "description": index.description,
        "properties": {index.direction: quantity_schema(index.unit)},
        "required": [index.direction],
        "additionalProperties": False,
    }


Thresholds = Annotated[dict[str, Threshold], PlainValidator(read_thresholds), WithJsonSchema(_schema())]
