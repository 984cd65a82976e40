"""The JSON Schemas of plan files and snapshots: `python -m rarms_iac.storage.planfile.json_schema schemas`."""

import json
import sys
from pathlib import Path

from rarms_iac.model.plan import Plan
from rarms_iac.model.state import State
from rarms_iac.storage.json_schema import Schema, schema_of
from rarms_iac.storage.planfile.snapshot import FORMAT as SNAPSHOT_FORMAT


def plan_schema() -> Schema:
    """The schema that `schemas/plan.json` holds: a plan and its seal."""
    schema = schema_of(Plan)
    plan = schema["$defs"].pop("Plan")
    plan["properties"]["seal"] = {
        "type": "string",
        "pattern": "^[0-9a-f]{64}$",
        "description": "Digest of all the rest: a file that was edited is refused.",
    }
    return {"$schema": schema["$schema"], **plan, "required": [*plan["required"], "seal"], "$defs": schema["$defs"]}


def snapshot_schema() -> Schema:
    """The schema that `schemas/snapshot.json` holds."""
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
    """A schema as its file holds it."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


SCHEMAS = {"plan": plan_schema, "snapshot": snapshot_schema}

if __name__ == "__main__":
    for name, made in SCHEMAS.items():
        (Path(sys.argv[1]) / f"{name}.json").write_text(text_of(made()), encoding="utf-8", newline="\n")
