"""Plain values -> the document, or what breaks its structure, with path and value; `messages.py` has the words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import islice
from typing import Any

from pydantic_core import ValidationError

from rarms_iac.manifest.document.reader import TAG, manifest_reader
from rarms_iac.manifest.document.rules import BrokenRule, broken_rules
from rarms_iac.manifest.document.schema import Path, manifest_schema
from rarms_iac.manifest.text.tree import dotted
from rarms_iac.model.diagnostics import Place, Places
from rarms_iac.model.system import System

MOST_ERRORS = 1000
"""Errors shown of one document: more of them come from a generator, which has few faults."""

MOST_LISTED = 5 * MOST_ERRORS
"""Errors that pydantic lists in no time; it needs 2 s and 300 MB for 400,000, the most that a manifest can have."""

FIRST_CUT = 16
"""Entries of each map and list that are looked at first where there are more errors; then four times as many."""


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
    listed: list[Any] = []
    total = 0
    try:
        made = manifest_reader().validate_python(document)
    except ValidationError as problem:
        total = problem.error_count()
        listed = listable_errors(problem, document).errors(include_url=False, include_input=False)
    else:
        if not broken:
            return made
    cases = [(error["loc"], error["type"], error.get("ctx", {})) for error in listed[:MOST_ERRORS]] + broken
    shown = cases[:MOST_ERRORS]
    following = len(cases) - len(shown) + total - len(listed[:MOST_ERRORS])
    raise NotAManifest([_structure_error(case, document, places) for case in shown], following)


def listable_errors(problem: ValidationError, document: Any) -> ValidationError:
    """Return the problem, or one with at least `MOST_ERRORS` of its errors where it has too many to be listed."""
    most = FIRST_CUT
    cut = problem
    while problem.error_count() > MOST_LISTED and (cut is problem or cut.error_count() < MOST_ERRORS):
        shorter = _cut(document, most)
        try:
            manifest_reader().validate_python(shorter)
        except ValidationError as found:
            cut = found
        most *= 4
    return cut


def _cut(value: Any, most: int) -> Any:
    """Return the value with the first entries of each map and list; a key that may be a field's stays, as needed."""
    if isinstance(value, dict):
        kept = dict(islice(value.items(), most))
        if len(value) > most:
            kept |= {key: value[key] for key in _field_names() & value.keys()}
        return {key: _cut(item, most) for key, item in kept.items()}
    if isinstance(value, list):
        return [_cut(item, most) for item in value[:most]]
    return value


@cache
def _field_names() -> frozenset[str]:
    return frozenset(
        name
        for block in (manifest_schema(), *manifest_schema()["$defs"].values())
        for name in block.get("properties", {})
    )


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
