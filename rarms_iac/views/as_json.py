"""The one machine-readable form of everything rarms says (`schemas/output.json`)."""

import json
from collections.abc import Mapping

FORMAT_VERSION = "rarms-output/1"


def document(kind: str, content: Mapping[str, object]) -> str:
    """A whole answer as JSON in ASCII, keys in our order, ending with a line end."""
    return json.dumps({"format_version": FORMAT_VERSION, "kind": kind, **content}, indent=2) + "\n"
