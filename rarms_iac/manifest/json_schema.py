"""The JSON Schema of the manifest, for editors and for every program that is not rarms."""

import json
from functools import cache
from typing import Any

from rarms_iac.manifest.document.manifest import ManifestDocument

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


@cache
def manifest_schema() -> dict[str, Any]:
    """The schema that `schemas/manifest.json` holds; callers do not change it."""
    made: dict[str, Any] = _tidied(ManifestDocument.model_json_schema(by_alias=True))
    return {"$schema": _DIALECT, **made}


def as_text(schema: dict[str, Any]) -> str:
    """A schema as the files in `schemas/` hold it."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def _tidied(node: Any) -> Any:
    """Without what pydantic adds for its own sake, and with patterns that mean the same in every language."""
    if isinstance(node, list):
        return [_tidied(item) for item in node]
    if not isinstance(node, dict):
        return node
    # A `title` that is a text is pydantic's; as the name of a property it would be a map.
    kept = {
        key: _tidied(value)
        for key, value in node.items()
        if not (key == "title" and isinstance(value, str)) and not (key == "default" and value is None)
    }
    pattern = kept.get("pattern")
    if isinstance(pattern, str):
        kept["pattern"] = _to_the_very_end(pattern)
    return kept


def _to_the_very_end(pattern: str) -> str:
    # `$` also matches before a line end in some languages; a name with a line end is no name.
    return f"{pattern}(?!\\n)" if pattern.endswith("$") else pattern
