"""The JSON of a result: the result itself, as `storage.codec.encode_output` writes it (`schemas/output.json`)."""

import json
from typing import TYPE_CHECKING

from rarms_iac.storage.codec import encode_output

if TYPE_CHECKING:
    from rarms_iac.views.answers import Answer

FORMAT_VERSION = "rarms-output/4"


def json_of(answer: "Answer", *, indent: int | None = 2) -> str:
    """Write an answer in ASCII, keys in the order of its type.

    Args:
        indent: of each level; None: all on one line, where several answers follow each other.

    Returns:
        It, ending with a line end.
    """
    document = {"format_version": FORMAT_VERSION}
    encoded = encode_output(answer)
    assert isinstance(encoded, dict)  # each answer is a dataclass
    return json.dumps({**document, **encoded}, indent=indent) + "\n"
