"""Output as JSON text; `schemas/output.json` says what it looks like."""

import json
from typing import TYPE_CHECKING

from rarms_iac.storage.codec import Json, encode

if TYPE_CHECKING:
    from rarms_iac.views.output.kinds import Output


def as_json(output: "Output") -> str:
    """The whole answer in ASCII, keys in our order, ending with a line end."""
    return json.dumps(_encodable(encode(output)), indent=2) + "\n"


def as_json_line(output: "Output") -> str:
    """The same on one line, where several follow each other."""
    return json.dumps(_encodable(encode(output))) + "\n"


def _encodable(value: Json) -> Json:
    """The value without lone surrogates: strict parsers refuse their escapes."""
    match value:
        case str():
            return value.encode("utf-8", "replace").decode("utf-8")
        case list():
            return [_encodable(item) for item in value]
        case dict():
            return {key: _encodable(item) for key, item in value.items()}
        case _:
            return value
