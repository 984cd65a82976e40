import json
from dataclasses import replace
from pathlib import Path

import jsonschema
import pytest

from rarms_iac.storage.datalog.files import append_setting
from rarms_iac.storage.datalog.log import Recorded
from scripts.file_schemas import data_log_schema
from tests.builders_measured import TAKEN, a_header, a_setting
from tests.unit.storage.datalog.test_files import a_file


def test_log_lines_follow_the_schema(tmp_path: Path) -> None:
    validator = jsonschema.Draft202012Validator(data_log_schema())
    path = a_file(tmp_path, 10, 70)
    whole = replace(a_setting(80), processors=2, used_processors=1, spent_ms=12.5)
    append_setting(path, a_header(), Recorded(setting=whole, provenance=TAKEN))
    lines = [json.loads(line) for line in path.read_text(encoding="ascii").splitlines()]

    for line in lines:
        validator.validate(line)
    with pytest.raises(jsonschema.ValidationError):
        validator.validate({**lines[1], "reserve": 0})
