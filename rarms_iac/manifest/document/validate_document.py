"""Plain values -> the document, or what breaks its structure, with path and value; `messages.py` has the words."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, cast

from pydantic_core import ValidationError

from rarms_iac.manifest.document.quantities import broken_thresholds
from rarms_iac.manifest.document.reader import TAG, manifest_reader
from rarms_iac.manifest.document.rules import BrokenRule, broken_rules
from rarms_iac.manifest.document.schema import Path, manifest_schema
from rarms_iac.manifest.text.tree import dotted
from rarms_iac.model.diagnostics import Place, Places
from rarms_iac.model.system import System

MOST_ERRORS = 1000
"""Errors shown of one document: who made more mends a generator, and would wait a minute for 400,000 of them."""

PART_SIZES = (1000, 100, 10)
"""Entries of each map and list that are looked at together where the whole has too many errors."""

TOO_MANY_TO_LIST = 5000
"""pydantic finds 400,000 errors in half a second, and needs ten more and 500 MB to list them."""


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


class NotAManifest(ValueError):
    """The structure is wrong; of more than `MOST_ERRORS` errors the first ones, and how many follow."""

    def __init__(self, errors: Sequence[StructureError], following: int) -> None:
        super().__init__(", ".join(f"{error.name}: {error.kind}" for error in errors[:20]))
        self.errors = errors
        self.following = following


def validate_document(document: Any, places: Places) -> System:
    """Return the System of plain values.

    Raises:
        NotAManifest: fields are wrong, or keys that need or exclude each other are.
    """
    broken = list(broken_rules(document))
    try:
        made = manifest_reader().validate_python(document)
    except ValidationError as problem:
        listed = _with_listable_errors(problem, document).errors(include_url=False, include_input=False)
        cases = [case for error in listed for case in _cases(error, document)] + broken
        total = len(cases) + problem.error_count() - len(listed)
    else:
        if not broken:
            return cast(System, made)
        cases, total = broken, len(broken)
    shown = cases[:MOST_ERRORS]
    raise NotAManifest([_structure_error(case, document, places) for case in shown], total - len(shown))


def _cases(error: Any, document: Any) -> Iterator[BrokenRule]:
    if error["type"] == "rarms_thresholds":
        for path, kind, facts in broken_thresholds(_value(document, error["loc"])):
            yield (*error["loc"], *path), kind, facts
    else:
        yield error["loc"], error["type"], error.get("ctx", {})


def _with_listable_errors(problem: ValidationError, document: Any) -> ValidationError:
    """Return the errors of the first part of the document that has any, where the whole has too many to be listed."""
    for most in PART_SIZES:
        if problem.error_count() <= TOO_MANY_TO_LIST:
            break
        problem = next(_problems_of_parts(document, most), problem)
    return problem


def _problems_of_parts(document: Any, most: int) -> Iterator[ValidationError]:
    for start in range(0, _longest(document), most):
        try:
            manifest_reader().validate_python(_part(document, range(start, start + most)))
        except ValidationError as problem:
            yield problem


def _part(value: Any, numbers: range) -> Any:
    """Of every map the entries of these numbers, and what it may need: its first entry, and keys that are fields.

    Of every list all entries up to the last of these: an error names an entry by its number.
    """
    if isinstance(value, dict):
        keys = (key for number, key in enumerate(value) if number in numbers or not number or key in _field_names())
        return {key: _part(value[key], numbers) for key in keys}
    if isinstance(value, list):
        return [_part(item, numbers) for item in value[: numbers.stop]]
    return value


def _longest(value: Any) -> int:
    """Entries of the longest map or list in this value."""
    if isinstance(value, dict | list):
        inner = value.values() if isinstance(value, dict) else value
        return max(len(value), max(map(_longest, inner), default=0))
    return 0


@cache
def _field_names() -> frozenset[str]:
    blocks = (manifest_schema(), *manifest_schema()["$defs"].values())
    return frozenset(name for block in blocks for name in block.get("properties", {}))


def _structure_error(case: BrokenRule, document: Any, places: Places) -> StructureError:
    location, kind, facts = case
    path, is_key = _path(location)
    return StructureError(
        kind=kind,
        path=path,
        facts=facts,
        value=path[-1] if is_key else _value(document, path),
        is_key=is_key,
        places=places,
    )


def _path(location: Path) -> tuple[Path, bool]:
    """Return the path in the text, and whether the key itself is meant."""
    steps = tuple(step for step in location if not (isinstance(step, str) and step.startswith(TAG)))
    return (steps[:-1], True) if steps[-1:] == ("[key]",) else (steps, False)


def _value(document: Any, path: Path) -> Any:
    for step in path:
        try:
            document = document[step]
        except (KeyError, IndexError, TypeError):
            return None
    return document
