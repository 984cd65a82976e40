import json
from pathlib import Path

import jsonschema
import pytest

from rarms_iac.storage.datalog.json_schema import data_log_schema, schema_text
from tests.unit.storage.datalog.test_files import a_file

HELD = Path(__file__).parents[4] / "schemas" / "datalog.json"


def test_the_schema_is_made_from_the_code() -> None:
    written = HELD.read_text(encoding="utf-8")
    assert written == schema_text(), "run: python -m rarms_iac.storage.datalog.json_schema schemas"


def test_every_line_of_a_log_is_as_the_schema_says_and_another_is_not(tmp_path: Path) -> None:
    validator = jsonschema.Draft202012Validator(data_log_schema())
    lines = [json.loads(line) for line in a_file(tmp_path, 10, 70).read_text(encoding="ascii").splitlines()]

    for line in lines:
        validator.validate(line)
    with pytest.raises(jsonschema.ValidationError):
        validator.validate({**lines[1], "reserve": 0})
