"""pydantic's errors -> cases with the exact path and value in the manifest; `messages.py` puts them into words."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from pydantic import ValidationError

from rarms_iac.manifest.document.fields import TOO_MANY_TO_LIST
from rarms_iac.manifest.document.manifest import ManifestDocument
from rarms_iac.manifest.document.schema import Path, manifest_schema
from rarms_iac.manifest.text.positions import dotted
from rarms_iac.model.diagnostics import Place, Places

MOST_ERRORS = 1000
"""Errors shown of one document: who made more mends a generator, and would wait a minute for 400,000 of them."""

_TAGGED = (("interference", "*"), ("components", "*", "run", "arrival"), ("components", "*", "run", "environment", "*"))
"""Where pydantic puts the name of an alternative into the path; it is not in the text."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StructureError:
    """One error of the structure, and the value of the manifest at its place."""

    kind: str
    path: Path
    facts: Mapping[str, Any]
    value: Any
    is_key: bool
    places: Places

    @property
    def name(self) -> str:
        """The path as people write it."""
        return dotted(self.path) or "the manifest"

    @property
    def place(self) -> Place:
        """Where it stands: the key for what is wrong with a key, else the value."""
        return self.places.key(*self.path) if self.is_key else self.places.value(*self.path)


def structure_errors(problem: ValidationError, document: Any, places: Places) -> list[StructureError]:
    """The errors of the document, of more than `MOST_ERRORS` the first ones."""
    errors = _with_listable_errors(problem, document).errors(include_url=False, include_input=False)
    return [_structure_error(error, document, places) for error in errors[:MOST_ERRORS]]


def _with_listable_errors(problem: ValidationError, document: Any) -> ValidationError:
    """The errors of the document's first parts, where the whole has too many to be listed."""
    for most in (1000, 100, 10):
        if problem.error_count() <= TOO_MANY_TO_LIST:
            break
        try:
            ManifestDocument.model_validate(_first(document, most))
        except ValidationError as fewer:
            problem = fewer
        else:
            break  # they all come later
    return problem


def _first(value: Any, most: int) -> Any:
    """The first entries of every map and list; keys that are fields stay, so that none is missing."""
    if isinstance(value, dict):
        keys = (key for number, key in enumerate(value) if number < most or key in _field_names())
        return {key: _first(value[key], most) for key in keys}
    if isinstance(value, list):
        return [_first(item, most) for item in value[:most]]
    return value


@cache
def _field_names() -> frozenset[str]:
    blocks = (manifest_schema(), *manifest_schema()["$defs"].values())
    return frozenset(name for block in blocks for name in block.get("properties", {}))


def _structure_error(error: Any, document: Any, places: Places) -> StructureError:
    path, is_key = _path(error["loc"])
    return StructureError(
        kind=error["type"],
        path=path,
        facts=error.get("ctx", {}),
        value=path[-1] if is_key else _value(document, path),
        is_key=is_key,
        places=places,
    )


def _path(location: Path) -> tuple[Path, bool]:
    """The path in the text, and whether the key itself is meant."""
    path: list[str | int] = []
    skip = False
    for step in location:
        if skip and step != "[key]":
            skip = False
            continue
        if step == "[key]":
            return tuple(path), True
        path.append(step)
        skip = any(
            len(pattern) == len(path) and all(want in ("*", at) for want, at in zip(pattern, path, strict=True))
            for pattern in _TAGGED
        )
    return tuple(path), False


def _value(document: Any, path: Path) -> Any:
    for step in path:
        try:
            document = document[step]
        except (KeyError, IndexError, TypeError):
            return None
    return document
