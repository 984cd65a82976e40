import json
from pathlib import Path

import jsonschema
import pytest

from scripts.file_schemas import data_log_schema
from tests.unit.storage.datalog.test_files import a_file


def test_every_line_of_a_log_is_as_the_schema_says_and_another_is_not(tmp_path: Path) -> None:
    validator = jsonschema.Draft202012Validator(data_log_schema())
    lines = [json.loads(line) for line in a_file(tmp_path, 10, 70).read_text(encoding="ascii").splitlines()]

    for line in lines:
        validator.validate(line)
    with pytest.raises(jsonschema.ValidationError):
        validator.validate({**lines[1], "reserve": 0})
