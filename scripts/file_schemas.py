"""The JSON Schemas of manifests, data logs, plan files and snapshots: `python -m scripts.file_schemas schemas`."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rarms_iac.manifest.document.schema import manifest_schema, overlay_schema
from rarms_iac.model.state import State
from rarms_iac.storage.datalog.log import FORMAT, Header, LogRecord
from rarms_iac.storage.plan_file import PlanFile
from rarms_iac.storage.snapshot_file import FORMAT as SNAPSHOT_FORMAT
from scripts.schema_of_types import Schema, schema_of

_SEAL: dict[str, Schema] = {
    "length": {"type": "integer", "description": "Bytes of the line's object without its last two fields."},
    "checksum": {"type": "string", "pattern": "^[0-9a-f]{64}$", "description": "SHA-256 of the same."},
}


def data_log_schema() -> Schema:
    """Return the schema that `schemas/datalog.json` holds: each line is a header, a setting or a remeasurement."""
    header, record = schema_of(Header), schema_of(LogRecord)
    definitions: dict[str, Any] = {**header["$defs"], **record["$defs"]}
    for name in ("Header", "LogRecord"):
        line = definitions[name]
        line["properties"] |= _SEAL
        line["required"] = [*line["required"], *_SEAL]
    definitions["Header"]["properties"]["format_version"] = {"const": FORMAT}
    definitions["Header"]["required"].append("format_version")
    definitions["Setting"]["properties"]["reserve"] |= {"minimum": 1, "maximum": 100}
    return {
        "$schema": header["$schema"],
        "title": f"A line of a data log ({FORMAT})",
        "anyOf": [{"$ref": f"#/$defs/{name}"} for name in ("Header", "LogRecord")],
        "$defs": dict(sorted(definitions.items())),
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
