"""Errors of structure, units and names -> findings in a user's words, at the exact place; never pydantic's own text."""

import json
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from fractions import Fraction
from typing import Any

from rarms_iac.manifest.document.marks import FORMS
from rarms_iac.manifest.document.schema import Path, choices_at, describe, keys_for, keys_of_map, shape_at
from rarms_iac.manifest.document.validate_document import NotAManifest, StructureError
from rarms_iac.manifest.text.tree import dotted
from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.model.indexes import INDEXES, percentile_index
from rarms_iac.model.names import NAME_PATTERN, nearest_name
from rarms_iac.texts.findings import MISSING, UNKNOWN_KEY, UNKNOWN_NAME, WRONG_VALUE, remainder
from rarms_iac.texts.messages import did_you_mean, in_a_row, is_invisible, name_character, question
from rarms_iac.texts.quantities import plain

_OTHER_SPELLINGS = {
    "B": ("b",),
    "KiB": ("k", "ki", "kb", "kib"),
    "MiB": ("m", "mi", "mb", "mib"),
    "GiB": ("g", "gi", "gb", "gib"),
    "TiB": ("t", "ti", "tb", "tib"),
    "us": ("µs", "μs", "usec"),
    "ms": ("msec", "millis", "milliseconds"),
    "s": ("sec", "secs", "second", "seconds"),
    "min": ("minute", "minutes"),
    "h": ("hour", "hours"),
    "%": ("percent", "pct"),
    "LP": ("lps", "cpu", "cpus", "vcpu", "vcpus", "core", "cores", "processor", "processors"),
    "/s": ("hz", "fps", "per second"),
}


def nearest_unit(unit: str, fitting: Iterable[str]) -> str | None:
    """Return the unit that was probably meant: `MB` and `mib` are MiB, `sec` is s."""
    written = unit.lower()
    return next(
        (known for known in fitting if written == known.lower() or written in _OTHER_SPELLINGS.get(known, ())), None
    )


_KINDS = {
    "string_type": "a text",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "dict_type": "a map",
    "list_type": "a list",
}


def findings_of_structure(problem: NotAManifest) -> list[Diagnostic]:
    """Return a finding an error, in a user's words; and how many follow that are not shown."""
    errors = problem.errors
    # A key that is missing because it is misspelt is reported once: where it is misspelt.
    misspelt = {meant for error in errors if (meant := _meant_key(error)) is not None}
    shown = [
        _with_invisible(_MESSAGES.get(error.kind, _not_read)(error), error)
        for error in errors
        if not (error.kind == "missing" and error.path in misspelt)
    ]
    if problem.following:
        detail = f"{problem.following:,} more errors follow."
        shown.append(replace(remainder(shown[-1], problem.following), detail=detail))
    return shown


def _with_invisible(found: Diagnostic, error: StructureError) -> Diagnostic:
    """Name the first character of a wrong text or key that a reader does not see."""
    text = str(error.path[-1]) if error.kind in _WRONG_KEYS else error.value
    hidden = next(filter(is_invisible, text), None) if isinstance(text, str) else None
    if hidden is None:
        return found
    return replace(found, detail=f"{found.detail} A{name_character(hidden)[1:]} is {_position_of(text, hidden)}.")


def _position_of(text: str, character: str) -> str:
    before, _, after = text.partition(character)
    if re.search(r"[0-9.]\s*$", before) and re.match(r"\s*[A-Za-z%/\u00b5\u03bc]", after):
        return "before the unit"
    if not before.strip():
        return f"before {_show(after.strip())}"
    return f"in {_show(text)}" if after.strip() else f"after {_show(before.strip())}"


def _show(value: Any) -> str:
    """Return a value as a message shows it: short, and with invisible characters spelt out."""
    text = json.dumps(value, ensure_ascii=False, default=str)
    text = text if len(text) <= 60 else text[:57] + "..."
    return "".join(f"<U+{ord(sign):04X}>" if is_invisible(sign) else sign for sign in text)


def _show_written(error: StructureError) -> str:
    """Return the value of an error as the manifest has it: 3.10, where the value is the number 3.1."""
    is_number = isinstance(error.value, bool | int | float) and not error.is_key
    return (error.places.text(*error.path) if is_number else "") or _show(error.value)


def _kind_of(error: StructureError) -> str:
    match error.value:
        case None:
            return "null"
        case bool():
            return f"{_show_written(error)} (true or false)"
        case int() | float():
            return f"the number {_show_written(error)}"
        case str():
            return f"the text {_show(error.value)}"
        case dict():
            return "a map"
        case _:
            return "a list"


def _fact(value: Any) -> str | bool | int | float:
    if isinstance(value, str):
        return value[:60]
    return value if isinstance(value, bool | int | float) else _show(value)


def _wrong(error: StructureError, template: str, advice: str, **facts: Any) -> Diagnostic:
    """Return a wrong value; its path, its kind and the value itself are facts of every template."""
    about: dict[str, Any] = {"_it": _show_written(error), "_kind": _kind_of(error)}
    return WRONG_VALUE.at(error.place, template, advice, path=error.name, value=_fact(error.value), **about, **facts)


def _unknown_key(error: StructureError) -> Diagnostic:
    *around, key = error.path
    known = shape_at(tuple(around)).keys
    advice = question(did_you_mean(str(key), known)) or f"The keys allowed here are {', '.join(known)}."
    if str(key)[:1].isdigit():  # of `{ at_most: 0,1 s }` YAML makes two keys
        advice = "Write a decimal point instead of a comma: { at_most: 0.1 s }."
    return UNKNOWN_KEY.at(
        error.places.key(*error.path),
        "{path}: the key {_show} is unknown here.",
        advice,
        path=error.name,
        key=str(key),
        _show=_show(key),
    )


def _meant_key(error: StructureError) -> Path | None:
    """Return the key that was probably meant by one that does not exist; None of every other error."""
    if error.kind != "extra_forbidden":
        return None
    *around, key = error.path
    meant = did_you_mean(str(key), shape_at(tuple(around)).keys)
    return None if meant is None else (*around, meant)


def _missing(error: StructureError) -> Diagnostic:
    *around, key = error.path
    owner = dotted(tuple(around)) or "A manifest"
    match choices_at(error.path):
        case [only]:
            advice = f"Write {key}: {only}."
        case _:
            advice = f"Write {key}: {describe(error.path)}".rstrip(": ")
    return MISSING.at(error.place, "{path} needs the key {key}.", advice, path=owner, key=str(key))


def _wrong_kind(error: StructureError) -> Diagnostic:
    needed = _KINDS[error.kind]
    advice = describe(error.path) or f"Write {needed}."
    if error.value is None:
        advice = "Write a value, or remove the key. Only in an overlay, null removes a value."
    elif needed == "a map" and (maps := _maps_with(error.path, error.value)):
        advice = f"Write {maps}."
    elif error.kind == "string_type" and isinstance(error.value, bool | int | float):
        advice = f'Put it in quotes: "{_show_written(error)}".'
    elif error.kind == "int_type" and isinstance(error.value, str) and re.fullmatch(r"[0-9]{1,15}", error.value):
        advice = f"Remove the quotes: {error.value}."
    return _wrong(error, "{path} must be {needed}, but it is {_kind}.", advice, needed=needed)


def _choice(error: StructureError) -> Diagnostic:
    known = choices_at(error.path)
    maps = tuple(f"a map with the key {key}" for key in keys_of_map(error.path))
    meant = question(did_you_mean(error.value, known) if isinstance(error.value, str) else None)
    allowed = in_a_row((*known, *maps), "or")
    advice = meant or f"Write {_maps_with(error.path, error.value) or allowed}."
    return _wrong(error, "{path} is {_it}. It must be {_allowed}.", advice, allowed=known, _allowed=allowed)


MOST_MAPS = 3
"""So many ways to write a value as a map are shown; where there are more, the value fits none for sure."""


def _maps_with(path: Path, value: Any) -> str:
    """Return the value as the map that must stand there: `{every: 40 ms}`.

    Several maps are joined: `{reserve: 40 %} or {limit: 40 %}`.
    """
    if isinstance(value, bool) or not isinstance(value, str | int):
        return ""
    keys = keys_for(path, value)
    return in_a_row([f"{{{key}: {value}}}" for key in keys], "or") if 0 < len(keys) <= MOST_MAPS else ""


def _tag(error: StructureError) -> Diagnostic:
    """Return an alternative that is chosen by `kind`."""
    if not isinstance(error.value, dict):
        return _wrong(error, "{path} must be a map, but it is {_kind}.", "Write a map with the key kind.")
    path = (*error.path, "kind")
    if "kind" in error.value:
        return _choice(replace(error, path=path, value=error.value["kind"]))
    advice = f"Write kind: {in_a_row(choices_at(path), 'or')}."
    return MISSING.at(error.places.value(*path), "{path} needs the key kind.", advice, path=error.name, key="kind")


def _quantity(error: StructureError) -> Diagnostic:
    units: tuple[str, ...] = error.facts["units"]
    word = error.facts["also"]
    example = " or ".join(error.facts["examples"]) + (f", or the word {word}" if word else "")
    template, better = "{path} is {_it}{_problem}.", ""
    problem = ", a number without a unit"
    match error.value:
        case bool() | None | dict() | list():
            template = "{path} must be a number with a unit, but it is {_kind}."
        case int() | float():
            better = _amount_meant(_show_written(error), units)
        case text:
            problem, better = _quantity_problem(str(text), units, positive=error.facts["positive"])
            meant = did_you_mean(str(text), (word,)) if word else None
            better = question(meant) or better
    advice = better or f"Write a number with the unit {in_a_row(units, 'or')}. Example: {example}."
    return _wrong(error, template, advice, units=units, _problem=problem)


def _quantity_problem(text: str, units: tuple[str, ...], *, positive: bool) -> tuple[str, str]:
    """Return the fault of a text that is not such a quantity, and the correction; empty where only the form helps."""
    if any(map(is_invisible, text)):
        seen = "".join(" " if sign.isspace() else "" if is_invisible(sign) else sign for sign in text[:100])
        found = re.fullmatch(r"([0-9]+(?:\.[0-9]+)?)\s*(\S+)", seen.strip())
        unit = nearest_unit(found[2], units) if found else None
        return "", question(f"{found[1]} {unit}") if found and unit else ""
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(.*?)\s*", text[:100])
    if any(character.isdigit() and not character.isascii() for character in text):
        return ". Only the digits 0 to 9 are allowed", ""
    if match is None:
        return ", which is not a number with a unit", ""
    if comma := re.fullmatch(r"(\d+),(\d+) ?([A-Za-z%/]+)", text[:100].strip()):
        whole, decimals, unit = comma.groups()
        return ", but the decimal separator is a point", question(
            f"{whole}.{decimals} {nearest_unit(unit, units) or unit}"
        )
    number, unit = match.groups()
    if not unit:
        return ", a number without a unit", _amount_meant(number, units)
    if unit == "m" and "LP" in units:  # Kubernetes: thousandths of a processor
        return ', but "m" is not a valid unit here', question(f"{plain(Fraction(number) / 1000)} LP")
    if unit not in units:
        better = nearest_unit(unit, units)
        if not better:
            return f", but {_show(unit)} is not a valid unit here", ""  # the advice lists those that fit
        fitting = ", ".join(units)
        return f", but {_show(unit)} is not a valid unit here. Valid units are {fitting}", question(
            f"{number} {better}"
        )
    if positive and not number.strip("0."):
        return ". It must be more than zero", ""
    return ". A number has at most 15 digits on each side of the point, and one space before its unit", ""


def _amount_meant(number: str, units: tuple[str, ...]) -> str:
    """Return the question for a number without a unit where an amount of processor time is asked for; else nothing."""
    if "LP" not in units or not re.fullmatch(r"[0-9]+(\.[0-9]+)?", number) or not number.strip("0."):
        return ""
    return question(f"{number} LP" if Fraction(number) < 1 else f"{number} % or {number} LP")


def _pattern(error: StructureError) -> Diagnostic:
    pattern = error.facts["pattern"]
    kind, form = FORMS[pattern]
    better = _as_name(str(error.value)) if pattern == NAME_PATTERN else None
    around = dotted(error.path[:-1]) if error.is_key else error.name
    prefix = f"{around}: " if around else ""
    advice = f"{form} {question(better)}".rstrip()
    return _wrong(error, "{_prefix}{_it} is not {kind}.", advice, kind=kind, _prefix=prefix)


def not_a_robot(file: str, robot: str) -> Diagnostic:
    """Return the last overlay, whose file without its ending is the robot's name, has one that is not a name."""
    better = _as_name(robot)
    return WRONG_VALUE.at(
        Place(file=file, line=1, column=1),
        "The robot has the name of the last overlay's file, and {_show} is not {_shown}.",
        f"Rename the file. {FORMS[NAME_PATTERN][1]} {question(better)}".rstrip(),
        file=file,
        robot=robot,
        _show=_show(robot),
        _shown=FORMS[NAME_PATTERN][0],
    )


def _as_name(text: str) -> str | None:
    """Return the name that is most like this text; None if too little of it is left."""
    name = nearest_name(text)
    return name if len(name) * 2 > len(text) else None


def _range(error: StructureError) -> Diagnostic:
    bound = "at least" if error.kind == "greater_than_equal" else "at most"
    limit = error.facts.get("ge", error.facts.get("le"))
    template = "{path} is {_it}. It must be {_bound} {limit}."
    return _wrong(error, template, describe(error.path), limit=limit, _bound=bound)


def _empty(error: StructureError) -> Diagnostic:
    is_text = error.kind == "string_too_short"
    template = "{path} is an empty text." if is_text else "{path} is empty. It needs at least one entry."
    return _wrong(error, template, describe(error.path) or "Write one, or remove the key.")


def _exactly_one(error: StructureError) -> Diagnostic:
    names = error.facts["names"].split()
    written = [name for name in names if name in error.value]
    if not written:
        advice = f"Write {in_a_row(names, 'or')}."
        return MISSING.at(
            error.place, "{path} needs one of the keys {keys:or}.", advice, path=error.name, keys=tuple(names)
        )
    return UNKNOWN_KEY.at(
        error.places.key(*error.path, written[-1]),
        "{path} has {keys:all}. Only one of them is allowed.",
        f"Remove {in_a_row(tuple(reversed(written)), 'or')}.",
        path=error.name,
        keys=tuple(written),
    )


def _together(error: StructureError) -> Diagnostic:
    key, needs = error.facts["key"], error.facts["needs"]
    facts = {"path": error.name, "key": key, "needs": needs}
    if error.facts["missing"]:
        return MISSING.at(error.place, "{path} has {needs}, so it needs the key {key}.", f"Write {key}.", **facts)
    place, template = error.places.key(*error.path, key), "{path} has {key}, which has an effect only with {needs}."
    return UNKNOWN_KEY.at(place, template, f"Write {needs}, or remove {key}.", **facts)


def _index(error: StructureError) -> Diagnostic:
    name = str(error.path[-1])
    advice = f"The indexes are {', '.join(INDEXES)}, and percentiles such as p95_response_time."
    return UNKNOWN_NAME.at(
        error.places.key(*error.path),
        "{path}: the performance index {_show} is unknown.",
        question(_index_meant(name)) or advice,
        path=error.name,
        index=name,
        _show=_show(name),
    )


def _index_meant(name: str) -> str | None:
    """Return the index that a wrong name probably means, such as `mean_response_time` of `mean`; None: it has none."""
    known = (*INDEXES, "p50_response_time", "p95_response_time", "p99_response_time", "p99.9_response_time")
    full = f"{name.removesuffix('_response_time')}_response_time"
    if full in known:
        return full
    if full == "p100_response_time":
        return "maximum_response_time"
    return _same_percentile(full) or did_you_mean(name, known)


def _same_percentile(name: str) -> str:
    """Return the name of the same percentile: `p99_response_time` of `p99.0_response_time`; empty: it has none."""
    match = re.fullmatch(r"p0*([0-9]{1,2})(?:\.([0-9]{1,15}))?(?:th)?_response_time", name)
    if match is None:
        return ""
    whole, decimals = match[1], (match[2] or "").rstrip("0")
    same = f"p{whole}{'.' if decimals else ''}{decimals}_response_time"
    return same if percentile_index(same) else ""


def _direction(error: StructureError) -> Diagnostic:
    index, word = error.facts["index"], error.facts["direction"]
    better = "smaller" if error.facts["smaller"] else "larger"
    return WRONG_VALUE.at(
        error.places.key(*error.path),
        "{path}: a {_better} {index} is better, but {_shown} sets the opposite bound.",
        f"Write {word}.",
        path=error.name,
        index=index,
        direction=word,
        _better=better,
        _shown=error.path[-1],
    )


def _foreign_block(error: StructureError) -> Diagnostic:
    block, provider = error.facts["block"], error.facts["provider"]
    place, host = error.places.key(*error.path), error.places.key(*error.path[:-1])
    overlay = error.places.value(*error.path[:-1], "provider").file
    is_from_overlay = place.file == host.file != overlay
    return UNKNOWN_KEY.at(
        place,
        "{path} is allowed only with provider: {block}, but this host has provider: {provider}.",
        f"Write {block}: null in {overlay}." if is_from_overlay else f"Remove it, or write provider: {block}.",
        path=error.name,
        block=block,
        provider=provider,
    )


def _no_such_day(error: StructureError) -> Diagnostic:
    return _wrong(error, "{path} is {value}. This day does not exist.", "Check the month and the day.")


def _not_read(error: StructureError) -> Diagnostic:
    """Return an error without words of its own: still a place, the value, and what the field is for."""
    advice = describe(error.path) or "See docs/manifest.md."
    return _wrong(error, "{path} cannot be {_it}.", advice)


_WRONG_KEYS = {"extra_forbidden", "rarms_index"}
"""Errors of a key, which is the last step of their path."""

_MESSAGES: Mapping[str, Callable[[StructureError], Diagnostic]] = {
    **dict.fromkeys(_KINDS, _wrong_kind),
    "extra_forbidden": _unknown_key,
    "missing": _missing,
    "literal_error": _choice,
    "rarms_kind": _tag,
    "string_pattern_mismatch": _pattern,
    "greater_than_equal": _range,
    "less_than_equal": _range,
    "too_short": _empty,
    "string_too_short": _empty,
    "rarms_quantity": _quantity,
    "rarms_exactly_one": _exactly_one,
    "rarms_together": _together,
    "rarms_index": _index,
    "rarms_direction": _direction,
    "rarms_foreign_block": _foreign_block,
    "value_error": _no_such_day,
}
