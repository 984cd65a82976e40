import json
from pathlib import Path

import jsonschema
import pytest

from rarms_iac.storage.shipped import FindingPage, shipped
from rarms_iac.views.json_output import json_of
from scripts.output_schema import output_schema
from tests.builders_plan import a_rich_plan, create, host_plan, plan, task

SCHEMA = Path(__file__).parents[3] / "schemas" / "output.json"


def check(text: str) -> None:
    """Fails where the text is not as the shipped schema says."""
    schema = json.loads(shipped("schemas/output.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator(schema).validate(json.loads(text))


def test_the_schema_is_made_from_the_types() -> None:
    assert SCHEMA.read_text(encoding="utf-8") == output_schema(), "run: make generated"


def test_a_plan_is_as_the_schema_says() -> None:
    schema = jsonschema.Draft202012Validator(json.loads(shipped("schemas/output.json").read_text(encoding="utf-8")))

    assert [list(schema.iter_errors(json.loads(json_of(each)))) for each in (a_rich_plan(), plan())] == [[], []]


def test_the_schema_refuses_another_shape() -> None:
    document = json.loads(json_of(plan()))
    del document["counts"]

    with pytest.raises(jsonschema.ValidationError):
        check(json.dumps(document))


def test_a_plan_says_the_same_as_its_text() -> None:
    document = json.loads(json_of(a_rich_plan()))

    onboard = document["hosts"][0]
    speech = onboard["changes"][1]
    assert document["format_version"] == "rarms-output/4"
    assert document["counts"] == {"add": 2, "change": 2, "remove": 1, "adopt": 0, "release": 0, "held_back": 1}
    assert speech["attributes"] == [{"name": "processors", "before": 1, "after": 2, "forces": "restart"}]
    assert speech["reason"]["place"]["line"] == 31
    assert onboard["steps"][1]["undo"] == {"level": "none", "operation": None, "message": "it is not made again"}


def test_registry_values_say_their_type() -> None:
    document = json.loads(json_of(plan(host_plan(changes=[create(task())]))))

    names = {attribute["name"]: attribute["after"] for attribute in document["hosts"][0]["changes"][0]["attributes"]}
    assert names == {"Priority": "dword:5", "Scheduling Category": "sz:Medium"}


def test_a_lone_surrogate_does_not_make_invalid_json() -> None:
    text = json_of(FindingPage(subject="\ud800", page=""))

    assert json.loads(text)["subject"] == "?"
    assert text.isascii()
