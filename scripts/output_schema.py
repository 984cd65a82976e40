"""The JSON Schema of what `--json` prints: `python -m scripts.output_schema > schemas/output.json`."""

import sys
from typing import get_args

from rarms_iac.views.answers import Answer
from rarms_iac.views.json_output import FORMAT_VERSION
from scripts.file_schemas import text_of
from scripts.schema_of_types import output_schema_of


def output_schema() -> str:
    """Return the text of `schemas/output.json`."""
    answers = get_args(Answer)
    schema = output_schema_of(answers)
    for answer in answers:
        definition = schema["$defs"][answer.__name__]
        definition["properties"] = {"format_version": {"const": FORMAT_VERSION}, **definition["properties"]}
        definition["required"] = ["format_version", *definition["required"]]
    return text_of({"title": f"What rarms prints with --json ({FORMAT_VERSION})", **schema})


if __name__ == "__main__":
    sys.stdout.buffer.write(output_schema().encode())
