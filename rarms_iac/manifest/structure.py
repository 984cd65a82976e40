"""Findings on structure, units and names: what the JSON Schema says too, in a user's words."""

import json
import re
from typing import Any

from rarms_iac.manifest.case import Case, Path
from rarms_iac.manifest.document.texts import FORMS
from rarms_iac.manifest.places import dotted
from rarms_iac.manifest.shape import choices_at, described, keys_at
from rarms_iac.manifest.usual_units import nearest_unit
from rarms_iac.model.diagnostics import Diagnostic, Finding, Place, Severity
from rarms_iac.model.indexes import INDEXES
from rarms_iac.model.names import NAME_PATTERN, TASK_PATTERN
from rarms_iac.model.wording import did_you_mean, in_a_row, question

UNKNOWN_KEY = Finding(code="RARMS015", severity=Severity.ERROR, summary="Unknown key")
MISSING_KEY = Finding(code="RARMS016", severity=Severity.ERROR, summary="A key is missing")
WRONG_KIND = Finding(code="RARMS017", severity=Severity.ERROR, summary="The wrong kind of value")
NOT_A_CHOICE = Finding(code="RARMS018", severity=Severity.ERROR, summary="Not one of the values allowed here")
NOT_A_QUANTITY = Finding(code="RARMS019", severity=Severity.ERROR, summary="Not a quantity with a unit that fits")
NOT_A_NAME = Finding(code="RARMS020", severity=Severity.ERROR, summary="Not a name")
OUT_OF_RANGE = Finding(code="RARMS021", severity=Severity.ERROR, summary="A number out of range")
NOT_TOGETHER = Finding(code="RARMS022", severity=Severity.ERROR, summary="Keys that do not go together")
UNKNOWN_INDEX = Finding(code="RARMS023", severity=Severity.ERROR, summary="Unknown performance index")
WRONG_WAY = Finding(code="RARMS024", severity=Severity.ERROR, summary="A threshold that points the wrong way")
FOREIGN_BLOCK = Finding(code="RARMS025", severity=Severity.ERROR, summary="A block of another provider")
NOTHING_THERE = Finding(code="RARMS026", severity=Severity.ERROR, summary="Nothing where something is needed")
WRONG_FORM = Finding(code="RARMS027", severity=Severity.ERROR, summary="A text in the wrong form")
NO_SUCH_DAY = Finding(code="RARMS028", severity=Severity.ERROR, summary="A day that is not in the calendar")
NOT_READ = Finding(code="RARMS029", severity=Severity.ERROR, summary="A value that cannot be read")

AND_MORE = Finding(code="RARMS030", severity=Severity.ERROR, summary="More errors than are shown")

_KINDS = {
    "string_type": "a text",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "dict_type": "a map",
    "rarms_map": "a map",
    "model_type": "a map",
    "model_attributes_type": "a map",
    "list_type": "a list",
}


def shown(value: Any) -> str:
    """A value as a message shows it, short."""
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= 60 else text[:57] + "..."


def _sentence(*parts: str) -> str:
    return " ".join(part for part in parts if part)


def _unknown_key(case: Case) -> Diagnostic:
    *around, key = case.path
    known = keys_at(tuple(around))
    advice = question(did_you_mean(str(key), known)) or f"Keys that may stand here: {', '.join(known)}."
    return UNKNOWN_KEY.at(case.places.key(*case.path), f"{case.name}: there is no key {shown(key)} here.", advice)


def probably_meant(case: Case) -> Path | None:
    """The key that was probably meant by one that does not exist; None of every other error."""
    if case.kind != "extra_forbidden":
        return None
    *around, key = case.path
    meant = did_you_mean(str(key), keys_at(tuple(around)))
    return None if meant is None else (*around, meant)


def _missing(case: Case) -> Diagnostic:
    *around, key = case.path
    inside = f"{dotted(tuple(around))} needs" if around else "A manifest needs"
    match choices_at(case.path):
        case [only]:
            advice = f"Write {key}: {only}."
        case _:
            advice = _sentence(f"Write {key}:", described(case.path)).rstrip(":")
    return MISSING_KEY.at(case.place, f"{inside} the key {key}.", advice)


def _wrong_kind(case: Case) -> Diagnostic:
    needs = _KINDS[case.kind]
    if case.value is None:
        return WRONG_KIND.at(
            case.place,
            f"{case.name} needs {needs}; here is nothing (null).",
            "Write a value, or remove the key; null removes a value only in an overlay.",
        )
    advice = described(case.path) or f"Write {needs}."
    if case.kind == "string_type" and isinstance(case.value, bool | int | float):
        advice = f'Put it into quotes: "{shown(case.value)}".'
    return WRONG_KIND.at(case.place, f"{case.name} needs {needs}; here is {_kind_of(case.value)}.", advice)


def _kind_of(value: Any) -> str:
    match value:
        case bool():
            return f"{shown(value)} (true or false)"
        case int() | float():
            return f"the number {shown(value)}"
        case str():
            return f"the text {shown(value)}"
        case dict():
            return "a map"
        case _:
            return "a list"


def _choice(case: Case) -> Diagnostic:
    known = choices_at(case.path)
    says = "nothing (null)" if case.value is None else shown(case.value)
    return NOT_A_CHOICE.at(
        case.place,
        f"{case.name} is {says}; it can be {in_a_row(known, 'or')}.",
        question(did_you_mean(case.value, known) if isinstance(case.value, str) else None)
        or f"Write {in_a_row(known, 'or')}.",
    )


def _tag(case: Case) -> Diagnostic:
    """An alternative that is chosen by `kind`."""
    if not isinstance(case.value, dict):
        return WRONG_KIND.at(
            case.place, f"{case.name} needs a map; here is {_kind_of(case.value)}.", "Write a map with the key kind."
        )
    path = (*case.path, "kind")
    known = choices_at(path)
    if "kind" not in case.value:
        return MISSING_KEY.at(
            case.places.value(*path), f"{case.name} needs the key kind.", f"Write kind: {in_a_row(known, 'or')}."
        )
    said = case.value["kind"]
    suggestion = did_you_mean(said, known) if isinstance(said, str) else None
    return NOT_A_CHOICE.at(
        case.places.value(*path),
        f"{dotted(path)} is {shown(said)}; it can be {in_a_row(known, 'or')}.",
        question(suggestion) or f"Write {in_a_row(known, 'or')}.",
    )


def _one_of(known: tuple[str, ...]) -> str:
    return in_a_row(known, "or")


def _quantity(case: Case) -> Diagnostic:
    units: tuple[str, ...] = case.facts["units"]
    fit, also = ", ".join(units), case.facts["also"]
    example = " or ".join(case.facts["examples"]) + (f", or the word {also}" if also else "")
    advice = f"Write a number with one of the units {fit}, as in {example}."
    match case.value:
        case bool() | None | dict() | list():
            detail = f"{case.name} needs a number with a unit; here is {_thing(case.value)}."
        case int() | float():
            detail = f"{case.name} is the bare number {shown(case.value)}; it needs a unit: {fit}."
        case str() as text:
            detail, better = _not_read(case.name, text, units, positive=case.facts["positive"])
            meant = did_you_mean(text, (also,)) if also else None
            advice = question(meant) or better or advice
        case _:
            detail = f"{case.name} needs a number with a unit."
    return NOT_A_QUANTITY.at(case.place, detail, advice)


def _thing(value: Any) -> str:
    return "nothing (null)" if value is None else _kind_of(value)


def _not_read(name: str, text: str, units: tuple[str, ...], *, positive: bool) -> tuple[str, str]:
    """What is wrong with a text that is no such quantity, and what to write; empty where only the form helps."""
    found = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(.*?)\s*", text[:100])
    if any(character.isdigit() and not character.isascii() for character in text):
        return f"{name} is {shown(text)}; only the digits 0 to 9 are read.", ""
    if found is None:
        return f"{name} is {shown(text)}, which is not a number with a unit.", ""
    number, unit = found.groups()
    if not unit:
        return f"{name} is the bare number {shown(text)}; it needs a unit: {', '.join(units)}.", ""
    if unit in units:
        if positive and not number.strip("0."):
            return f"{name} is {shown(text)}; it must be more than nothing.", ""
        return f"{name} is {shown(text)}; a number has at most 15 digits on each side, and one space after it.", ""
    better = nearest_unit(unit, units)
    detail = f"{name} is {shown(text)}; {shown(unit)} is not a unit that fits: {', '.join(units)}."
    return detail, question(f"{number} {better}") if better else ""


def _pattern(case: Case) -> Diagnostic:
    pattern = case.facts["pattern"]
    what, form = FORMS[pattern]
    finding = NOT_A_NAME if pattern in (NAME_PATTERN, TASK_PATTERN) else WRONG_FORM
    better = _as_name(str(case.value)) if pattern == NAME_PATTERN else None
    return finding.at(
        case.place, f"{_where(case)}{shown(case.value)} is not {what}.", _sentence(form, question(better))
    )


def _where(case: Case) -> str:
    around = dotted(case.path[:-1]) if case.is_key else case.name
    return f"{around}: " if around else ""


def _as_name(text: str) -> str | None:
    """The name that is most like this text; None if too little of it is left."""
    name = re.sub(r"-+", "-", re.sub(r"[^a-z0-9]", "-", text.lower())).strip("-")[:63].strip("-")
    return name if len(name) * 2 > len(text) else None


def _range(case: Case) -> Diagnostic:
    bound = "at least" if case.kind == "greater_than_equal" else "at most"
    limit = case.facts.get("ge", case.facts.get("le"))
    return OUT_OF_RANGE.at(
        case.place, f"{case.name} is {shown(case.value)}; it must be {bound} {limit}.", described(case.path)
    )


def _too_short(case: Case) -> Diagnostic:
    return NOTHING_THERE.at(
        case.place,
        f"{case.name} is empty; it needs at least one.",
        described(case.path) or "Write one, or remove the key.",
    )


def _blank(case: Case) -> Diagnostic:
    return NOTHING_THERE.at(
        case.place, f"{case.name} is an empty text.", described(case.path) or "Write one, or remove the key."
    )


def _exactly_one(case: Case) -> Diagnostic:
    names, written = case.facts["names"], case.facts["written"]
    if not written:
        return MISSING_KEY.at(
            case.place, f"{case.name} needs one of the keys {_one_of(names)}.", f"Write {_one_of(names)}."
        )
    return NOT_TOGETHER.at(
        case.places.key(*case.path, written[-1]),
        f"{case.name} has {' and '.join(written)}; only one of them can hold.",
        f"Remove {_one_of(tuple(reversed(written)))}.",
    )


def _together(case: Case) -> Diagnostic:
    key, needs = case.facts["key"], case.facts["needs"]
    if case.facts["missing"]:
        return MISSING_KEY.at(case.place, f"{case.name} says {needs}, and needs the key {key}.", f"Write {key}.")
    return NOT_TOGETHER.at(
        case.places.key(*case.path, key),
        f"{case.name} has {key}, which is read only with {needs}.",
        f"Write {needs}, or remove {key}.",
    )


def _index(case: Case) -> Diagnostic:
    name = str(case.path[-1])
    known = (*INDEXES, "p50_response_time", "p95_response_time", "p99_response_time", "p99.9_response_time")
    advice = f"Indexes are {', '.join(INDEXES)}, and percentiles such as p95_response_time."
    return UNKNOWN_INDEX.at(
        case.places.key(*case.path),
        f"{case.name}: there is no performance index {shown(name)}.",
        question(did_you_mean(name, known)) or advice,
    )


def _direction(case: Case) -> Diagnostic:
    index, word = case.facts["index"], case.facts["direction"]
    better = "smaller" if case.facts["smaller"] else "larger"
    return WRONG_WAY.at(
        case.places.key(*case.path),
        f"{case.name}: of {index}, {better} is better, so {case.path[-1]} would ask for the worse.",
        f"Write {word}.",
    )


def _foreign_block(case: Case) -> Diagnostic:
    block, provider = case.facts["block"], case.facts["provider"]
    return FOREIGN_BLOCK.at(
        case.places.key(*case.path),
        f"{case.name} is read only on a host with provider: {block}; this one has provider: {provider}.",
        f"Remove it, or write provider: {block}.",
    )


def _no_such_day(case: Case) -> Diagnostic:
    return NO_SUCH_DAY.at(case.place, f"{case.name} is {case.value}; there is no such day.", "Check month and day.")


def and_more(number: int, after: Place | None) -> Diagnostic:
    """Says how many errors follow the last one shown."""
    return AND_MORE.at(after, f"{number:,} more errors follow.", "Mend those that are shown first.")


def otherwise(case: Case) -> Diagnostic:
    """Whatever has no words of its own: still a place, the value, and what the field is for."""
    return NOT_READ.at(
        case.place,
        f"{case.name} cannot be {shown(case.value)}.",
        described(case.path) or "Check the manifest reference.",
    )


WORDS = {
    **dict.fromkeys(_KINDS, _wrong_kind),
    "extra_forbidden": _unknown_key,
    "missing": _missing,
    "enum": _choice,
    "literal_error": _choice,
    "union_tag_invalid": _tag,
    "union_tag_not_found": _tag,
    "string_pattern_mismatch": _pattern,
    "greater_than_equal": _range,
    "less_than_equal": _range,
    "too_short": _too_short,
    "string_too_short": _blank,
    "rarms_quantity": _quantity,
    "rarms_exactly_one": _exactly_one,
    "rarms_together": _together,
    "rarms_index": _index,
    "rarms_direction": _direction,
    "rarms_foreign_block": _foreign_block,
    "rarms_no_day": _no_such_day,
}
