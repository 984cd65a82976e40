"""The JSON Schemas of manifests, data logs, plan files and snapshots: `python -m scripts.file_schemas schemas`."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rarms_iac.manifest.document.schema import manifest_schema, overlay_schema
from rarms_iac.model.setting import SettingEvidence
from rarms_iac.model.state import State
from rarms_iac.storage.datalog.files import HEADER_FIELD, REMEASUREMENT_FIELD
from rarms_iac.storage.datalog.log import FORMAT, Header, Provenance, Remeasurement
from rarms_iac.storage.plan_file import PlanFile
from rarms_iac.storage.snapshot_file import FORMAT as SNAPSHOT_FORMAT
from scripts.schema_of_types import Schema, schema_of

_NUMBERS: Schema = {"type": "array", "items": {"type": "number"}}
_SOMETIMES = frozenset({"evidence", "spent_ms", "processors", "used_processors"})
"""Fields of a setting that are there where they were seen or recorded."""
_DIGEST_OF_HEADER: Schema = {"type": "string", "pattern": "^[0-9a-f]{16}$", "description": "Digest of its header."}
_SEAL: dict[str, Schema] = {
    "length": {"type": "integer", "description": "Bytes of the line's object without its last two fields."},
    "checksum": {"type": "string", "pattern": "^[0-9a-f]{64}$", "description": "SHA-256 of the same."},
}


def data_log_schema() -> Schema:
    """Return the schema that `schemas/datalog.json` holds: each line is a header, a setting or a remeasurement."""
    header = schema_of(Header)
    definitions: dict[str, Any] = dict(header["$defs"])
    for part in (Provenance, Remeasurement, SettingEvidence):
        definitions |= schema_of(part)["$defs"]
    first = definitions["Header"]
    first["properties"] = {**first["properties"], "format_version": {"const": FORMAT}, **_SEAL}
    first["required"] = [*first["required"], "format_version", *_SEAL]
    definitions["Series"] = _series()
    definitions["Setting"] = _setting()
    definitions["RemeasurementLine"] = _remeasurement_line()
    return {
        "$schema": header["$schema"],
        "title": f"A line of a data log ({FORMAT})",
        "anyOf": [{"$ref": f"#/$defs/{name}"} for name in ("Header", "Setting", "RemeasurementLine")],
        "$defs": dict(sorted(definitions.items())),
    }


def _remeasurement_line() -> Schema:
    return {
        "description": "A remeasurement begins or has ended; of several with one seed the last holds.",
        "type": "object",
        "properties": {
            HEADER_FIELD: _DIGEST_OF_HEADER,
            REMEASUREMENT_FIELD: {"$ref": "#/$defs/Remeasurement"},
            **_SEAL,
        },
        "required": [HEADER_FIELD, REMEASUREMENT_FIELD, *_SEAL],
        "additionalProperties": False,
    }


def _setting() -> Schema:
    properties = {
        HEADER_FIELD: _DIGEST_OF_HEADER,
        "reserve": {"type": "integer", "minimum": 1, "maximum": 100, "description": "CR: per cent of P1's processors."},
        "beside": {"type": "integer", "description": "What P2 reserved meanwhile."},
        "seed": {"type": "integer", "description": "That chance was drawn from, where the host draws it."},
        "series": {"type": "array", "items": {"$ref": "#/$defs/Series"}},
        "evidence": {"$ref": "#/$defs/SettingEvidence"},
        "spent_ms": {"type": "number", "description": "The host's time that it took, with what was no sample."},
        "processors": {"type": "integer", "minimum": 1, "description": "P1's virtual processors."},
        "used_processors": {"type": "integer", "description": "The most that P1 was seen to use at once."},
        "provenance": {"$ref": "#/$defs/Provenance"},
        **_SEAL,
    }
    return {
        "description": "One reservation with every sample.",
        "type": "object",
        "properties": properties,
        "required": [name for name in properties if name not in _SOMETIMES],
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
            "began_ms": {
                **_NUMBERS,
                "description": "When each job began; of a periodic job, when it was due; may be below 0.",
            },
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
            "unsettled": {"type": "string", "description": "Why it gives no verdict: its host had not settled."},
            "starts": {
                "type": "array",
                "items": {"type": "integer", "minimum": 0},
                "description": "Numbers of the samples, from 0, with which its load began anew; absent: it did not.",
            },
        },
        "required": ["component", "elapsed_ms", "cpu_ms", "began_ms", "response_ms"],
        "additionalProperties": False,
    }


def plan_schema() -> Schema:
    """Return the schema that `schemas/plan.json` holds."""
    schema = schema_of(PlanFile)
    file = schema["$defs"].pop("PlanFile")
    return {"$schema": schema["$schema"], **file, "$defs": schema["$defs"]}


def snapshot_schema() -> Schema:
    """Return the schema that `schemas/snapshot.json` holds."""
    schema = schema_of(State)
    return {
        "$schema": schema["$schema"],
        "description": "What a host looks like, as `rarms snapshot` writes it; of a Hyper-V host it keeps what "
        "observe.ps1 printed (docs/scripts.md).",
        "type": "object",
        "properties": {"format_version": {"const": SNAPSHOT_FORMAT}, "state": {"$ref": schema["$ref"]}},
        "required": ["format_version", "state"],
        "additionalProperties": False,
        "$defs": schema["$defs"],
    }


def text_of(schema: Schema) -> str:
    """Return a schema as its file holds it."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


SCHEMAS: dict[str, Callable[[], Schema]] = {
    "manifest": manifest_schema,
    "overlay": overlay_schema,
    "datalog": data_log_schema,
    "plan": plan_schema,
    "snapshot": snapshot_schema,
}

if __name__ == "__main__":
    for name, made in SCHEMAS.items():
        (Path(sys.argv[1]) / f"{name}.json").write_text(text_of(made()), encoding="utf-8", newline="\n")
