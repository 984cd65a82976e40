"""What every block of the manifest shares: strict types, no unknown keys, no null, a description on every field.

Keys that need or exclude each other are what no single field can say. They are checked on the plain values, so that
they are reported together with all other errors; the JSON Schemas of the blocks say the same (`exactly_one`, `if` /
`then`).
"""

import re
from collections.abc import Iterator, Mapping
from datetime import date
from typing import Annotated, Any, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    PlainValidator,
    StringConstraints,
    WithJsonSchema,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, ErrorDetails, InitErrorDetails, PydanticCustomError, ValidationError

from rarms_iac.model.host import ProviderKind
from rarms_iac.model.names import NAME_PATTERN, TASK_PATTERN


class Block(BaseModel):
    """A map with fixed keys. Validators are built once, by the outermost block."""

    model_config = ConfigDict(
        strict=True,
        extra="forbid",
        frozen=False,
        defer_build=True,
        use_attribute_docstrings=False,
        protected_namespaces=(),
    )


class _NotNull:
    """Takes `None` out of a type: a key may be absent, but `null` belongs into overlays only."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        schema: Any = handler(source)
        return schema["schema"] if schema["type"] == "nullable" else schema  # type: ignore[no-any-return]  # pydantic's schema is a dict


T = TypeVar("T")

Maybe = Annotated[T | None, _NotNull()]
"""A field that may be absent, and then is None here."""


class KeysLike:
    """Gives a map's JSON Schema the pattern of its keys."""

    def __init__(self, pattern: str) -> None:
        self.pattern = pattern

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        made = handler.resolve_ref_schema(handler(schema))
        for value in made.pop("patternProperties", {}).values():
            made["additionalProperties"] = value
        made["propertyNames"] = {"pattern": self.pattern}
        return made


def needed(description: str, **more: Any) -> Any:
    """A field that must be there."""
    return Field(description=description, **more)


def optional(description: str, default: Any = None, **more: Any) -> Any:
    """A field that may be absent; a default is written as a user would write it, and read the same way."""
    return Field(default=default, description=description, validate_default=isinstance(default, str), **more)


def exactly_one(*names: str) -> Mapping[str, Any]:
    """The JSON Schema of a block that takes one of these keys."""
    return {"oneOf": [{"required": [name]} for name in names]}


_PYTHON = "[A-Za-z_][A-Za-z0-9_]*"
VARIABLE_PATTERN = "^[A-Za-z_][A-Za-z0-9_]{0,254}$"
CALL_PATTERN = rf"^{_PYTHON}(\.{_PYTHON})*:{_PYTHON}$"
SSH_PATTERN = r"^([A-Za-z0-9_][A-Za-z0-9_.\\-]{0,127}@)?[A-Za-z0-9\[][A-Za-z0-9_.:%\[\]-]{0,254}$"
SLICE_PATTERN = "^[a-z0-9][a-z0-9_-]{0,62}$"
STRESSOR_PATTERN = "^[a-z][a-z0-9-]{0,39}$"
OPERATION_PATTERN = "^[a-z][a-z_]{0,62}$"
CODE_PATTERN = "^RARMS[0-9]{3}$"
VERSION_PATTERN = "^>= ?[0-9]{1,6}([.][0-9]{1,6}){0,2}$"
DAY_PATTERN = "^[0-9]{4}-(0[1-9]|1[0-2])-(0[1-9]|[12][0-9]|3[01])$"

FORMS: dict[str, tuple[str, str]] = {
    NAME_PATTERN: (
        "a name",
        "Names have 1 to 63 small letters a-z, digits and hyphens, and start and end with a letter or digit.",
    ),
    TASK_PATTERN: (
        "the name of a task class",
        "Task classes have 1 to 63 letters, digits and spaces, and start with a letter.",
    ),
    VARIABLE_PATTERN: (
        "the name of an environment variable",
        "Such names have letters, digits and underscores, and do not start with a digit.",
    ),
    CALL_PATTERN: ("a function", "Write module:function, as in components.path_planning:plan."),
    SSH_PATTERN: ("an address for ssh", "Write user@host, or a name of your ssh configuration."),
    SLICE_PATTERN: (
        "the name of a control group",
        "Such names have small letters, digits, hyphens and underscores, and start with a letter or digit.",
    ),
    STRESSOR_PATTERN: ("a stressor", "Write a name that stress-ng --stressors shows, as in timer."),
    OPERATION_PATTERN: ("an operation", "Write its kind in small letters and underscores, as in start_partition."),
    VERSION_PATTERN: ("a least version", "Write >= and the version, as in '>=0.2'."),
    CODE_PATTERN: ("a finding's id", "Write RARMS and three digits, as in RARMS041."),
    DAY_PATTERN: ("a day", "Write year-month-day, as in 2027-01-31."),
}
"""What a text of each pattern is called, and how it is written."""

Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
TaskName = Annotated[str, StringConstraints(pattern=TASK_PATTERN)]
Variable = Annotated[str, StringConstraints(pattern=VARIABLE_PATTERN)]
CallTarget = Annotated[str, StringConstraints(pattern=CALL_PATTERN)]
SshTarget = Annotated[str, StringConstraints(pattern=SSH_PATTERN)]
SliceName = Annotated[str, StringConstraints(pattern=SLICE_PATTERN)]
Stressor = Annotated[str, StringConstraints(pattern=STRESSOR_PATTERN)]
Operation = Annotated[str, StringConstraints(pattern=OPERATION_PATTERN)]
Code = Annotated[str, StringConstraints(pattern=CODE_PATTERN)]
LeastVersion = Annotated[str, StringConstraints(pattern=VERSION_PATTERN)]
Filled = Annotated[str, StringConstraints(min_length=1)]


_DAY = re.compile(DAY_PATTERN.removesuffix("$") + r"\Z")


def _day(text: Any) -> date:
    if not isinstance(text, str):
        raise PydanticCustomError("string_type", "not a text")
    if _DAY.match(text) is None:
        raise PydanticCustomError("string_pattern_mismatch", "not a day", {"pattern": DAY_PATTERN})
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise PydanticCustomError("rarms_no_day", "no such day") from None


Day = Annotated[date, PlainValidator(_day), WithJsonSchema({"type": "string", "pattern": DAY_PATTERN})]
"""A day of the calendar."""

by_name = KeysLike(NAME_PATTERN)


Broken = tuple[tuple[str, ...], str, dict[str, Any]]
"""Path, kind of error and its facts; `messages.py` puts them into words."""

TOO_MANY_TO_LIST = 5000
"""pydantic finds 400,000 errors in half a second, and needs ten more and 500 MB to list them."""

BLOCK_OF = {ProviderKind.HYPERV: "hyperv", ProviderKind.LINUX: "linux", ProviderKind.SIMULATED: "simulated"}


def broken_rules(document: Any) -> list[InitErrorDetails]:
    """Every broken rule of a document, whatever else is wrong with it."""
    return [
        InitErrorDetails(type=PydanticCustomError(kind, kind, facts), loc=path, input=None)
        for path, kind, facts in (*_hosts(document), *_components(document))
    ]


def with_rules(problem: ValidationError, broken: list[InitErrorDetails]) -> ValidationError:
    """The same errors, and the broken rules beside them."""
    again = [
        InitErrorDetails(type=_same_kind(error), loc=error["loc"], input=error["input"])
        for error in problem.errors(include_url=False)
    ]
    return ValidationError.from_exception_data(problem.title, [*again, *broken])


def _same_kind(error: ErrorDetails) -> PydanticCustomError:
    return PydanticCustomError(error["type"], "as before", error.get("ctx"))


def _map(value: Any, key: str) -> dict[str, Any]:
    found = value.get(key) if isinstance(value, dict) else None
    return found if isinstance(found, dict) else {}


def _hosts(document: Any) -> Iterator[Broken]:
    for name, host in _map(document, "hosts").items():
        if not isinstance(host, dict):
            continue
        provider = host.get("provider", ProviderKind.SIMULATED.value)
        for kind, block in BLOCK_OF.items():
            if block in host and provider != kind.value and provider in list(ProviderKind):
                yield ("hosts", name, block), "rarms_foreign_block", {"block": block, "provider": provider}


def _components(document: Any) -> Iterator[Broken]:
    for name, component in _map(document, "components").items():
        run = component.get("run") if isinstance(component, dict) else None
        if not isinstance(run, dict):
            continue
        path = ("components", name, "run")
        yield from _exactly_one(path, run, "command", "call")
        yield from _exactly_one((*path, "until"), run.get("until"), "samples", "elapsed")
        yield from _pattern((*path, "samples"), run.get("samples"))


def _exactly_one(path: tuple[str, ...], block: Any, *names: str) -> Iterator[Broken]:
    if isinstance(block, dict):
        written = tuple(name for name in names if name in block)
        if len(written) != 1:
            yield path, "rarms_exactly_one", {"names": names, "written": written}


def _pattern(path: tuple[str, ...], samples: Any) -> Iterator[Broken]:
    if isinstance(samples, dict) and (samples.get("from") == "pattern") != ("pattern" in samples):
        missing = "pattern" not in samples
        yield path, "rarms_together", {"key": "pattern", "needs": "from: pattern", "missing": missing}
