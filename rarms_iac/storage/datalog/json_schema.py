"""The JSON Schema of a line of a data log: `python -m rarms_iac.storage.datalog.json_schema schemas` writes it."""

import json
import sys
from pathlib import Path
from typing import Any

from rarms_iac.storage.datalog.files import ITS_FIELD
from rarms_iac.storage.datalog.log import FORMAT, Header, Pass, Provenance
from rarms_iac.storage.json_schema import Schema, schema_of

_NUMBERS: Schema = {"type": "array", "items": {"type": "number"}}
_SEAL: dict[str, Schema] = {
    "length": {"type": "integer", "description": "Bytes of the line's object without its last two fields."},
    "checksum": {"type": "string", "pattern": "^[0-9a-f]{64}$", "description": "SHA-256 of the same."},
}


def data_log_schema() -> Schema:
    """The schema that `schemas/datalog.json` holds: each line is a header (the first), a setting or a pass."""
    header, provenance, one = schema_of(Header), schema_of(Provenance), schema_of(Pass)
    definitions: dict[str, Any] = {**header["$defs"], **provenance["$defs"], **one["$defs"]}
    first = definitions["Header"]
    first["properties"] = {**first["properties"], "format_version": {"const": FORMAT}, **_SEAL}
    first["required"] = [*first["required"], "format_version", *_SEAL]
    definitions["Series"] = _series()
    definitions["Setting"] = _setting()
    definitions["PassLine"] = _pass_line()
    return {
        "$schema": header["$schema"],
        "title": f"A line of a data log ({FORMAT})",
        "anyOf": [{"$ref": f"#/$defs/{name}"} for name in ("Header", "Setting", "PassLine")],
        "$defs": dict(sorted(definitions.items())),
    }


def schema_text() -> str:
    """The text of `schemas/datalog.json`."""
    return json.dumps(data_log_schema(), indent=2, ensure_ascii=False) + "\n"


def _pass_line() -> Schema:
    return {
        "description": "A pass begins or has ended; of several with one seed the last holds.",
        "type": "object",
        "properties": {ITS_FIELD: {"$ref": "#/$defs/Pass"}, **_SEAL},
        "required": [ITS_FIELD, *_SEAL],
        "additionalProperties": False,
    }


def _setting() -> Schema:
    properties = {
        "reserve": {"type": "integer", "minimum": 1, "maximum": 100, "description": "CR: per cent of P1's processors."},
        "beside": {"type": "integer", "description": "What P2 reserved meanwhile."},
        "seed": {"type": "integer", "description": "That chance was drawn from, where the host draws it."},
        "series": {"type": "array", "items": {"$ref": "#/$defs/Series"}},
        "provenance": {"$ref": "#/$defs/Provenance"},
        **_SEAL,
    }
    return {
        "description": "One reservation with every sample.",
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


def _series() -> Schema:
    whole = {"type": "array", "items": {"type": "integer", "minimum": 0}}
    return {
        "description": "All samples of a component as columns, in the order in which their jobs ended.",
        "type": "object",
        "properties": {
            "component": {"type": "string"},
            "elapsed_ms": {"type": "number"},
            "cpu_ms": {"type": ["number", "null"], "description": "Processor time that it consumed."},
            "began_ms": {**_NUMBERS, "description": "When each job began; of a periodic job, its scheduled start."},
            "response_ms": {
                "type": "array",
                "items": {"type": ["number", "null"]},
                "description": "The response time of each; null: no answer.",
            },
            "unsuccessful": {**whole, "description": "Which were unsuccessful, from 0; absent: none."},
            "count": {**_NUMBERS, "description": "How much each did; absent: one each."},
            "failures": {
                "type": "object",
                "additionalProperties": {"type": "string"},
                "description": "Why a sample failed, by its number from 0; absent: none.",
            },
        },
        "required": ["component", "elapsed_ms", "cpu_ms", "began_ms", "response_ms"],
        "additionalProperties": False,
    }


if __name__ == "__main__":
    (Path(sys.argv[1]) / "datalog.json").write_text(schema_text(), encoding="utf-8", newline="\n")
