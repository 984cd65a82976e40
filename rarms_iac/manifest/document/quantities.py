"""Quantities as the manifest writes them: text with a unit in, exact values out."""

from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from functools import lru_cache
from typing import Annotated, Any

from pydantic import AfterValidator, GetCoreSchemaHandler, GetJsonSchemaHandler, PlainValidator, WithJsonSchema
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from rarms_iac.manifest.document.rules import BrokenRule
from rarms_iac.model.indexes import (
    INDEXES,
    PERCENTILE_PATTERN,
    PerformanceIndex,
    find_index,
    percentile_index,
    threshold_of,
)
from rarms_iac.model.quantities import (
    OF_HOST,
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
from rarms_iac.model.system import Measured, Threshold
from rarms_iac.model.wording import in_a_row

_EXAMPLES = {
    Unit.TIME: "88 ms",
    Unit.MEMORY: "512 MiB",
    Unit.SHARE: "70 %",
    Unit.PROCESSORS: "1.4 LP",
    Unit.RATE: "24 /s",
}


def quantity_error(kinds: tuple[Unit, ...], *, positive: bool = False, also: str = "") -> PydanticCustomError:
    """The error of a field whose value is not such a quantity; `messages.py` puts it into words."""
    facts = _facts_of_quantity(kinds, positive=positive, also=also)
    return PydanticCustomError("rarms_quantity", "not a quantity", facts)


def _facts_of_quantity(kinds: tuple[Unit, ...], *, positive: bool = False, also: str = "") -> dict[str, Any]:
    examples = tuple(_EXAMPLES[kind] for kind in kinds)
    return {"units": units_of(*kinds), "examples": examples, "positive": positive, "also": also}


def quantity_schema(*kinds: Unit, positive: bool = False, also: str = "") -> dict[str, Any]:
    """The JSON Schema of such a text; `errorMessage` is what editors show instead of the pattern."""
    units = units_of(*kinds)
    forms = [f"{unit}( {OF_HOST})?" if unit == "%" and Unit.PROCESSORS in kinds else unit for unit in units]
    some = r"(?=[0-9.]*[1-9])" if positive else ""
    examples = [also] * bool(also) + [_EXAMPLES[kind] for kind in kinds]
    number = f"{also and f'`{also}` or '}a number{' above 0' if positive else ''}"
    return {
        "type": "string",
        "pattern": rf"^{some}[0-9]{{1,15}}(\.[0-9]{{1,15}})? ?({'|'.join(forms)})$",
        "errorMessage": f"Write {number} with the unit {in_a_row(units, 'or')}, as in "
        f"{' or '.join(f'`{example}`' for example in examples)}.",
        "examples": examples,
    }


class Quantity:
    """Makes a field read a text with a unit of one of these kinds, and gives it the JSON Schema of such a text."""

    def __init__(self, *kinds: Unit, make: Callable[[Unit, Fraction], Any], positive: bool = False) -> None:
        self._kinds = kinds
        self._positive = positive
        self._make = make
        self._parse = lru_cache(maxsize=4096)(self._parse_text)

    def read(self, value: Any) -> Any:
        """The exact value of a field.

        Raises:
            PydanticCustomError: it is no text, or no such quantity.
        """
        if type(value) is str:
            try:
                return self._parse(value)
            except NotAQuantity:
                pass
        raise quantity_error(self._kinds, positive=self._positive)

    def _parse_text(self, text: str) -> Any:
        kind, value = parse_quantity(text, *self._kinds)
        if self._positive and value <= 0:
            raise NotAQuantity(text, units_of(*self._kinds))
        return self._make(kind, value)

    def __get_pydantic_core_schema__(self, _source: Any, _handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, _schema: CoreSchema, _handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return quantity_schema(*self._kinds, positive=self._positive)


def _same(_kind: Unit, value: Fraction) -> Fraction:
    return value


def _whole(_kind: Unit, value: Fraction) -> int:
    return int(value)


def _amount(kind: Unit, value: Fraction) -> CpuAmount:
    return ShareOfHost(Percent(value)) if kind is Unit.SHARE else ProcessorTime(LogicalProcessors(value))


_CPU = (Unit.SHARE, Unit.PROCESSORS)
_AMOUNT = Quantity(*_CPU, make=_amount)

Time = Annotated[Milliseconds, Quantity(Unit.TIME, make=_same)]
PositiveTime = Annotated[Milliseconds, Quantity(Unit.TIME, make=_same, positive=True)]
Memory = Annotated[Bytes, Quantity(Unit.MEMORY, make=_whole)]
PositiveMemory = Annotated[Bytes, Quantity(Unit.MEMORY, make=_whole, positive=True)]
Share = Annotated[Percent, Quantity(Unit.SHARE, make=_same)]
Amount = Annotated[CpuAmount, _AMOUNT]
PositiveAmount = Annotated[CpuAmount, Quantity(*_CPU, make=_amount, positive=True)]

LONGEST_WAIT = Milliseconds(Fraction(3_600_000))
"""One hour: longer than any guest needs to shut down, and short enough for a script to wait through."""


def _read_reserve(value: Any) -> Any:
    if value == "measured":
        return Measured.MEASURED
    try:
        return _AMOUNT.read(value)
    except PydanticCustomError:
        raise quantity_error(_CPU, also="measured") from None


def _reserve_schema() -> dict[str, Any]:
    quantity = quantity_schema(*_CPU, also="measured")
    return {"anyOf": [{"const": "measured", "errorMessage": quantity["errorMessage"]}, quantity]}


Reserve = Annotated[
    CpuAmount | Measured,
    PlainValidator(_read_reserve),
    WithJsonSchema(_reserve_schema()),
]


def _limit(fits: Callable[[Any], bool], highest: str) -> AfterValidator:
    def check(value: Any) -> Any:
        if not fits(value):
            raise PydanticCustomError("less_than_equal", "more than is allowed here", {"le": highest})
        return value

    return AfterValidator(check)


Wait = Annotated[Time, _limit(lambda time: time <= LONGEST_WAIT, "1 h")]
AmountOfHost = Annotated[
    Amount, _limit(lambda amount: not isinstance(amount, ShareOfHost) or amount.percent <= 100, "100 %")
]
Duty = Annotated[
    Percent, Quantity(Unit.SHARE, make=_same, positive=True), _limit(lambda percent: percent <= 100, "100 %")
]


_DIRECTIONS = ("at_most", "at_least")


_index = lru_cache(maxsize=4096)(find_index)
_threshold = lru_cache(maxsize=4096)(threshold_of)


def read_thresholds(value: Any) -> dict[str, Threshold]:
    """The thresholds by index.

    Raises:
        PydanticCustomError: it is no map, or `broken_thresholds` tells what is wrong in it.
    """
    if type(value) is not dict:
        raise PydanticCustomError("rarms_map", "not a map", {})
    made: dict[str, Threshold] = {}
    for name, written in value.items():
        index = _index(name)
        if index is None or any(_broken(index, written)):
            raise PydanticCustomError("rarms_thresholds", "wrong thresholds", {})
        made[name] = _threshold(index, written[index.direction])
    return made


def broken_thresholds(value: Mapping[str, Any]) -> Iterator[BrokenRule]:
    """Every wrong index, word and quantity of the thresholds, each with its own path in them."""
    for name, written in value.items():
        index = _index(name)
        if index is None:
            yield (name,), "rarms_index", {}
        else:
            yield from _broken(index, written)


def _broken(index: PerformanceIndex, written: Any) -> Iterator[BrokenRule]:
    if type(written) is not dict:
        yield (index.name,), "rarms_map", {}
        return
    yield from (((index.name, key), "extra_forbidden", {}) for key in written if key not in _DIRECTIONS)
    other = _DIRECTIONS[index.smaller_is_better]
    if other in written:
        facts = {"index": index.name, "direction": index.direction, "smaller": index.smaller_is_better}
        yield (index.name, other), "rarms_direction", facts
    elif index.direction not in written:
        yield (index.name, index.direction), "missing", {}
    if index.direction not in written:
        return
    text = written[index.direction]
    if not _is_quantity(index, text):
        yield (index.name, index.direction), "rarms_quantity", _facts_of_quantity((index.unit,))
    elif index.unit is Unit.SHARE and _threshold(index, text).value > 100:
        yield (index.name, index.direction), "less_than_equal", {"le": "100 %"}


def _is_quantity(index: PerformanceIndex, text: Any) -> bool:
    try:
        return type(text) is str and bool(_threshold(index, text))
    except NotAQuantity:
        return False


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
