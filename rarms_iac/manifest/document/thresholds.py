"""`apt`: acceptable performance thresholds, a map from performance index to `at_most` or `at_least`."""

from functools import lru_cache
from typing import Annotated, Any

from pydantic import PlainValidator, WithJsonSchema
from pydantic_core import InitErrorDetails, PydanticCustomError, ValidationError

from rarms_iac.manifest.document.quantities import quantity_error, quantity_schema
from rarms_iac.model.indexes import INDEXES, PERCENTILE_PATTERN, PerformanceIndex, find_index, percentile_index
from rarms_iac.model.quantities import NotAQuantity, parse_quantity
from rarms_iac.model.system import AtLeast, AtMost, Threshold

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
