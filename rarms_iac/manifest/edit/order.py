"""The order of the keys of a manifest, and which values are quantities: as its blocks have them.

Maps that the user names (hosts, components, ...) keep the user's order.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from itertools import chain
from typing import Any

from rarms_iac.manifest.document.schema import alternatives, manifest_schema


@dataclass(frozen=True, slots=True)
class ValueShape:
    """What the formatter knows of a value: its known keys in order, or what stands under any name."""

    keys: Mapping[str, "ValueShape"] = field(default_factory=dict)
    each: "ValueShape | None" = None  # the shape of every value of a map that the user names
    is_quantity: bool = False

    def of(self, key: str) -> "ValueShape":
        """Return the shape of the value under this key."""
        return self.keys.get(key) or self.each or VALUE


VALUE = ValueShape()


@cache
def manifest_shape() -> ValueShape:
    """Return the whole manifest; an overlay has the same shape."""
    return _shape([manifest_schema()])


def _shape(schemas: list[dict[str, Any]]) -> ValueShape:
    """Return what may stand where one of these schemas holds."""
    keys: dict[str, list[dict[str, Any]]] = {}
    named: list[dict[str, Any]] = []
    is_quantity = False
    for schema in chain.from_iterable(map(alternatives, schemas)):
        for key, value in schema.get("properties", {}).items():
            keys.setdefault(key, []).append(value)
        any_name = schema.get("additionalProperties")
        named += [*schema.get("patternProperties", {}).values(), *([any_name] if isinstance(any_name, dict) else [])]
        is_quantity |= "examples" in schema  # as `quantity_schema` has them
    if named:
        return ValueShape(each=_shape([*named, *(value for values in keys.values() for value in values)]))
    return ValueShape(keys={key: _shape(values) for key, values in keys.items()}, is_quantity=is_quantity)
