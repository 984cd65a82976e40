"""pydantic's errors -> findings in a user's words, at the exact place; never pydantic's own text."""

from collections.abc import Callable
from functools import cache
from typing import Any

from pydantic import ValidationError

from rarms_iac.manifest import structure
from rarms_iac.manifest.case import Case, Path
from rarms_iac.manifest.document.manifest import ManifestDocument
from rarms_iac.manifest.document.rules import TOO_MANY_TO_LIST
from rarms_iac.manifest.json_schema import manifest_schema
from rarms_iac.model.diagnostics import Diagnostic, Places

_TAGGED = (("interference", "*"), ("components", "*", "run", "arrival"), ("components", "*", "run", "environment", "*"))
"""Where pydantic puts the name of an alternative into the path; it is not in the text."""


MOST = 1000
"""Errors told of one document: who made more mends a generator, and would wait a minute for 400,000 of them."""


def in_words(problem: ValidationError, document: Any, places: Places) -> list[Diagnostic]:
    """Every error of the document as a finding; of more than `MOST`, the first ones and how many follow."""
    number = problem.error_count()
    errors = _listable(problem, document).errors(include_url=False, include_input=False)
    cases = [_case(error, document, places) for error in errors[:MOST]]
    # A key that is missing because it is misspelt is told once: where it is misspelt.
    misspelt = {meant for case in cases if (meant := structure.probably_meant(case)) is not None}
    told = [_told(case) for case in cases if not (case.kind == "missing" and case.path in misspelt)]
    more = number - len(cases)
    return [*told, structure.and_more(more, told[-1].place)] if more else told


def _listable(problem: ValidationError, document: Any) -> ValidationError:
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
        kept = (key for number, key in enumerate(value) if number < most or key in _fields())
        return {key: _first(value[key], most) for key in kept}
    if isinstance(value, list):
        return [_first(item, most) for item in value[:most]]
    return value


@cache
def _fields() -> frozenset[str]:
    blocks = (manifest_schema(), *manifest_schema()["$defs"].values())
    return frozenset(name for block in blocks for name in block.get("properties", {}))


def _told(case: Case) -> Diagnostic:
    say: Callable[[Case], Diagnostic] = structure.WORDS.get(case.kind, structure.otherwise)
    return say(case)


def _case(error: Any, document: Any, places: Places) -> Case:
    path, is_key = _path(error["loc"])
    return Case(
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
