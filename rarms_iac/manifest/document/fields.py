"""What every block of the manifest shares: strict types, no unknown keys, no null, a description on every field."""

from collections.abc import Mapping
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Discriminator, Field, GetCoreSchemaHandler, GetJsonSchemaHandler, Tag
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from rarms_iac.model.names import NAME_PATTERN


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


def _alternative(value: Any) -> str:
    return "several" if isinstance(value, list) else "one"


def one_or_several(item: Any) -> Any:
    """The type of a field that takes one item, or a list of at least one."""
    single, several = Annotated[item, Tag("one")], Annotated[list[item], Field(min_length=1), Tag("several")]
    return Annotated[single | several, Discriminator(_alternative)]


by_name = KeysLike(NAME_PATTERN)
