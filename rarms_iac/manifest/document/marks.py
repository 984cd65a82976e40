"""The meaning of the marks of `model/keys.py`: forms of texts, quantities with a unit, and thresholds."""

from collections.abc import Callable, Iterable, Iterator
from enum import StrEnum
from functools import lru_cache
from itertools import islice
from typing import Annotated, Any, TypeVar

from pydantic import Field, PlainValidator, StringConstraints, ValidationError, WithJsonSchema
from pydantic_core import InitErrorDetails, PydanticCustomError

from rarms_iac.manifest.document.rules import BrokenRule
from rarms_iac.model.indexes import (
    INDEXES,
    PERCENTILE_PATTERN,
    PerformanceIndex,
    find_index,
    percentile_index,
    threshold_of,
)
from rarms_iac.model.keys import Form, Quantity, Shape, Within
from rarms_iac.model.quantities import (
    OF_HOST,
    LogicalProcessors,
    NotAQuantity,
    Percent,
    ProcessorTime,
    ShareOfHost,
    Unit,
    parse_quantity,
    units_of,
)
from rarms_iac.model.system import Threshold
from rarms_iac.texts.messages import in_a_row
from rarms_iac.texts.quantities import show_milliseconds, show_percent, write_bytes

M = TypeVar("M")


def find_mark(kind: type[M], marks: tuple[Any, ...]) -> M | None:
    """Return the mark of this kind."""
    return next((mark for mark in marks if isinstance(mark, kind)), None)


FORMS: dict[str, tuple[str, str]] = {
    Form.NAME: (
        "a name",
        "Names have 1 to 63 lowercase letters a-z, digits and hyphens, and start and end with a letter or digit.",
    ),
    Form.TASK: (
        "the name of a task class",
        "Task classes have 1 to 63 letters, digits and spaces, and start with a letter.",
    ),
    Form.THREAD: ("the name of a thread", "Thread names have no comma. `*` stands for any characters."),
    Form.VARIABLE: (
        "the name of an environment variable",
        "Variable names have letters, digits and underscores, and do not start with a digit.",
    ),
    Form.CALL: ("a function", "Write module:function, for example components.path_planning:plan."),
    Form.SSH: ("an address for ssh", "Write user@host, or a name of your ssh configuration."),
    Form.HOST: ("the name of a host", "Write its name or address, for example cell.plant.example."),
    Form.SSH_FILE: (
        "a file of ssh",
        "Write the path without quotes. It may have letters, digits, blanks and ~/._%+:@-.",
    ),
    Form.ABSOLUTE_FOLDER: ("an absolute path", "Write the absolute path on the robot, for example /opt/robot."),
    Form.SLICE: (
        "the name of a control group",
        (
            "Control group names have lowercase letters, digits, hyphens and underscores, and start with a letter or "
            "digit."
        ),
    ),
    Form.STRESSOR: ("a stressor", "Write a name from stress-ng --stressors, for example timer."),
    Form.TOPIC: (
        "a topic",
        "Write the full name from rostopic list or ros2 topic list, for example /camera/image_raw.",
    ),
    Form.OPERATION: (
        "an operation",
        "Write the operation in lowercase letters and underscores, for example start_partition.",
    ),
    Form.LEAST_VERSION: ("a least version", "Write >= and the version, for example '>=0.2'."),
    Form.CODE: ("a finding's id", "Write RARMS and three digits, for example RARMS041."),
    Form.DAY: ("a day", "Write year-month-day, for example 2027-01-31."),
}
"""What each form is called, and how it is written."""

_EXAMPLES = {
    Unit.TIME: "88 ms",
    Unit.MEMORY: "512 MiB",
    Unit.SHARE: "70 %",
    Unit.PROCESSORS: "1.4 LP",
    Unit.RATE: "24 /s",
}


def limits_of(marks: Iterable[Any]) -> Iterator[Any]:
    """Yield pydantic's limits of a text or number, or of the number of entries of a list or map."""
    for mark in marks:
        match mark:
            case Within(least, most):
                yield Field(strict=True, ge=least, le=most)
            case Shape.FILLED | Shape.ONE_OR_SEVERAL:
                yield Field(min_length=1)
            case Form():
                yield StringConstraints(pattern=mark.value)
                # `$` also matches before a line end in some languages; a name does not end with one.
                pattern = f"{mark.value}(?!\\n)"
                yield WithJsonSchema({"errorMessage": FORMS[mark][1], "pattern": pattern, "type": "string"})
            case _:
                pass


def quantity_type(quantity: Quantity, word: StrEnum | None) -> Any:
    """Return the type of a text with a unit, or this word."""
    read = PlainValidator(_quantity_reader(quantity, word))
    return Annotated[Any, read, WithJsonSchema(_quantity_schema(quantity, word))]


def _facts(kinds: tuple[Unit, ...], *, positive: bool = False, also: str = "") -> dict[str, Any]:
    examples = tuple(_EXAMPLES[kind] for kind in kinds)
    return {"units": units_of(*kinds), "examples": examples, "positive": positive, "also": also}


def _quantity_schema(quantity: Quantity, word: StrEnum | None = None) -> dict[str, Any]:
    """Return the JSON Schema of such a text; `errorMessage` is what editors show instead of the pattern."""
    kinds, positive = quantity.kinds, quantity.positive
    units = units_of(*kinds)
    forms = [f"{unit}( {OF_HOST})?" if unit == "%" and Unit.PROCESSORS in kinds else unit for unit in units]
    some = r"(?=[0-9.]*[1-9])" if positive else ""
    examples = [*([word.value] if word else ()), *(_EXAMPLES[kind] for kind in kinds)]
    number = f"{f'`{word.value}` or ' if word else ''}a number{' above 0' if positive else ''}"
    message = (
        f"Write {number} with the unit {in_a_row(units, 'or')}, for example "
        f"{' or '.join(f'`{example}`' for example in examples)}."
    )
    text = {
        "errorMessage": message,
        "examples": examples,
        "pattern": rf"^{some}[0-9]{{1,15}}(\.[0-9]{{1,15}})? ?({'|'.join(forms)})$(?!\n)",
        "type": "string",
    }
    return {"anyOf": [{"const": word.value, "errorMessage": message}, text]} if word else text


def _quantity_reader(quantity: Quantity, word: StrEnum | None) -> Callable[[Any], Any]:
    """Make the function that reads a text with a unit, or this word, to its exact value.

    It raises `PydanticCustomError` for every other value; `messages.py` puts that into words.
    """
    kinds = quantity.kinds
    most = parse_quantity(quantity.most, *kinds) if quantity.most else None
    facts = _facts(kinds, positive=quantity.positive, also=word.value if word else "")

    @lru_cache(maxsize=4096)
    def parse(text: str) -> Any:
        kind, value = parse_quantity(text, *kinds)
        if quantity.positive and value <= 0:
            raise NotAQuantity(text, units_of(*kinds))
        if most is not None and kind is most[0] and value > most[1]:
            raise PydanticCustomError("less_than_equal", "more than is allowed here", {"le": quantity.most})
        if Unit.PROCESSORS in kinds:
            return ShareOfHost(Percent(value)) if kind is Unit.SHARE else ProcessorTime(LogicalProcessors(value))
        return int(value) if kind is Unit.MEMORY else value

    def read(value: Any) -> Any:
        if word is not None and value == word.value:
            return word
        if type(value) is str:
            try:
                return parse(value)
            except NotAQuantity:
                pass
        raise PydanticCustomError("rarms_quantity", "not a quantity", facts)

    return read


def write_quantity(value: Any, quantity: Quantity) -> str:
    """Return a default as the manifest writes it."""
    match quantity.kinds[0]:
        case Unit.TIME:
            return show_milliseconds(value)
        case Unit.MEMORY:
            return write_bytes(value)
        case _:
            return show_percent(value.percent if isinstance(value, ShareOfHost) else value)


MOST_BROKEN = 20
"""Errors shown of the thresholds of one component: more of them come from a generator, which has few faults."""

_DIRECTIONS = ("at_most", "at_least")


_index = lru_cache(maxsize=4096)(find_index)
_threshold = lru_cache(maxsize=4096)(threshold_of)


def _read_thresholds(value: Any) -> dict[str, Threshold]:
    """Return the thresholds by index.

    Raises:
        PydanticCustomError: it is not a map.
        ValidationError: of each wrong index, word and quantity.
    """
    if type(value) is not dict:
        raise PydanticCustomError("dict_type", "not a map", {})
    broken = (each for name, written in value.items() for each in _broken(name, written))
    wrong = [
        InitErrorDetails(type=PydanticCustomError(kind, "wrong threshold", dict(facts)), loc=path, input=value)
        for path, kind, facts in islice(broken, MOST_BROKEN)
    ]
    if wrong:
        raise ValidationError.from_exception_data("thresholds", wrong)
    indexes = ((index, written) for name, written in value.items() if (index := _index(name)))
    return {index.name: _threshold(index, written[index.direction]) for index, written in indexes}


def _broken(name: str, written: Any) -> Iterator[BrokenRule]:
    if (index := _index(name)) is None:
        yield (name,), "rarms_index", {}
        return
    if type(written) is not dict:
        yield (index.name,), "dict_type", {}
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
        yield (index.name, index.direction), "rarms_quantity", _facts((index.unit,))
    elif index.unit is Unit.SHARE and _threshold(index, text).value > 100:
        yield (index.name, index.direction), "less_than_equal", {"le": "100 %"}


def _is_quantity(index: PerformanceIndex, text: Any) -> bool:
    try:
        return type(text) is str and bool(_threshold(index, text))
    except NotAQuantity:
        return False


def _thresholds_schema() -> dict[str, Any]:
    """Return the JSON Schema of `apt`: each index takes the bound that makes sense for it."""
    family = percentile_index("p95_response_time")
    assert family is not None
    return {
        "additionalProperties": False,
        "patternProperties": {
            PERCENTILE_PATTERN: _schema_of(family)
            | {
                "description": (
                    "A percentile of the response times of all jobs that answered, for example p95_response_time."
                )
            }
        },
        "properties": {index.name: _schema_of(index) for index in INDEXES.values()},
        "type": "object",
    }


def _schema_of(index: PerformanceIndex) -> dict[str, Any]:
    return {
        "additionalProperties": False,
        "description": index.description,
        "properties": {index.direction: _quantity_schema(Quantity(kinds=(index.unit,)))},
        "required": [index.direction],
        "type": "object",
    }


THRESHOLDS = Annotated[Any, PlainValidator(_read_thresholds), WithJsonSchema(_thresholds_schema())]
"""The type of `apt`."""
