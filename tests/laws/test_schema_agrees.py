"""rarms and a JSON Schema library never disagree on the structure of a manifest."""

import copy
import random
from typing import Any

import jsonschema
from hypothesis import given, note, settings
from hypothesis import strategies as st

from rarms_iac.manifest.document.schema import manifest_schema
from rarms_iac.manifest.document.validate_document import NotAManifest, validate_document
from rarms_iac.manifest.text.positions import FirstLine
from rarms_iac.manifest.text.reading import read_text
from tests.effort import examples
from tests.unit.manifest.examples import EVERYTHING

DOCUMENT = read_text(EVERYTHING.encode(), "rarms.yaml", ".").value
SCHEMA = jsonschema.Draft202012Validator(manifest_schema())

ODD = [
    *(None, True, False, 0, 1, 2, 3, -1, 7, 8, 9, 1.5, 10_000, 10_001, 10**12),
    *("", "x", "a\n", "Bad_Name", "a-", "0", "true", "closed", "measured", "simulated", "hyperv", "linux", "High"),
    *("88 ms", "88ms", "88  ms", " 88 ms", "88 ms\n", "0 ms", "0.0 s", "-1 ms", "1e3 ms", "512 MiB", "512 MB", "0 B"),
    *(
        "70 %",
        "1.4 LP",
        "24 /s",
        "0 %",
        "0 LP",
        "88",
        "８８ ms",
        "٣ ms",
        "1234567890123456 ms",
        "a:b",
        "a.b:c",
        "user@host",
    ),
    *("rarms/v1", "busy_loop", "command", "pattern"),
    *("json_lines", "Audio", "Pro Audio", "1Audio", "é", "TERM", "KILL", "RARMS041", "p95_response_time"),
    *([], [1], ["a"], ["a", "a"], {}, {"a": 1}, {"at_most": "1 ms"}, {"at_least": "1 %"}, {"every": "33 ms"}),
    *({"samples": 3}, {"samples": 3, "elapsed": "3 s"}, {"from_env": "X"}, {"kind": "browser"}, {"field": "x"}),
]
KEYS = [
    "x",
    "7",
    "X",
    "a b",
    "",
    "name\n",
    "con",
    "RARMS041",
    "p95_response_time",
    "p0_response_time",
    "p05_response_time",
]
FIELDS = sorted({name for block in manifest_schema()["$defs"].values() for name in block.get("properties", {})})


def _containers(value: Any) -> list[Any]:
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    found = [container for child in inner for container in _containers(child)]
    return [value, *found] if isinstance(value, dict | list) else found


def _mutate(document: Any, dice: random.Random) -> None:
    """Changes one spot: drops, replaces, adds, renames or moves something."""
    container = dice.choice(_containers(document))
    keys = list(container) if isinstance(container, dict) else list(range(len(container)))
    key = dice.choice(keys) if keys else None
    what = dice.choice(["drop", "odd", "odd", "add", "rename", "swap"])
    if isinstance(container, dict) and what == "add":
        container[dice.choice([*KEYS, *FIELDS])] = copy.deepcopy(dice.choice(ODD))
    elif key is None:
        return
    elif what == "drop":
        del container[key]
    elif what == "rename" and isinstance(container, dict):
        container[dice.choice([*KEYS, *FIELDS])] = container.pop(key)
    elif what == "swap":
        container[key] = copy.deepcopy(dice.choice(_containers(document)))
    else:
        container[key] = copy.deepcopy(dice.choice(ODD))


def _rarms_takes(document: Any) -> bool:
    try:
        validate_document(document, FirstLine("rarms.yaml"))
    except NotAManifest as problem:
        # What month has 31 days is beyond JSON Schema, and no matter of structure.
        note(str(problem))
        return all(error.kind == "rarms_no_day" for error in problem.errors)
    return True


@settings(max_examples=examples(300))
@given(st.integers(min_value=0, max_value=2**32), st.integers(min_value=1, max_value=3))
def test_rarms_and_a_schema_library_agree(seed: int, mutations: int) -> None:
    document = copy.deepcopy(DOCUMENT)
    dice = random.Random(seed)
    for _ in range(mutations):
        _mutate(document, dice)
    complaints = [f"{error.json_path}: {error.message[:200]}" for error in SCHEMA.iter_errors(document)]
    note(str(complaints[:3]))

    assert _rarms_takes(document) == (not complaints)
