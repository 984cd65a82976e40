import json
from dataclasses import replace
from pathlib import Path

import jsonschema
import pytest

from rarms_iac.model.state import State
from rarms_iac.storage.plan_file import identified, write_plan
from rarms_iac.storage.snapshot_file import SnapshotUnreadable, read_snapshot, write_snapshot
from scripts.file_schemas import SCHEMAS, plan_schema, snapshot_schema, text_of
from tests.builders_plan import a_rich_plan, facts, partition, task

FOLDER = Path(__file__).parents[3] / "schemas"


def a_state() -> State:
    return State(facts=facts(), partitions=(partition(),), tasks=(task(),), serials={"robot": 3})


@pytest.mark.parametrize("name", sorted(SCHEMAS))
def test_the_schemas_are_made_from_the_types(name: str) -> None:
    held = (FOLDER / f"{name}.json").read_text(encoding="utf-8")

    assert held == text_of(SCHEMAS[name]()), "run: python -m scripts.file_schemas schemas"


def test_plan_files_and_snapshots_follow_schemas() -> None:
    of_plans, of_snapshots = map(jsonschema.Draft202012Validator, (plan_schema(), snapshot_schema()))

    assert list(of_plans.iter_errors(json.loads(write_plan(identified(a_rich_plan()))))) == []
    assert list(of_snapshots.iter_errors(json.loads(write_snapshot(a_state())))) == []


def test_the_schema_refuses_what_reading_refuses() -> None:
    document = json.loads(write_snapshot(a_state()))
    document["state"]["facts"]["colour"] = "red"

    with pytest.raises(jsonschema.ValidationError):
        jsonschema.Draft202012Validator(snapshot_schema()).validate(document)
    with pytest.raises(SnapshotUnreadable, match="there is no such field"):
        read_snapshot(json.dumps(document).encode())


def test_a_snapshot_reads_back_as_written() -> None:
    odd = replace(a_state(), partitions=(replace(partition(), other_notes="Prüfung\n\ud800"),))

    assert read_snapshot(write_snapshot(a_state())) == a_state()
    assert read_snapshot(write_snapshot(odd)).partitions[0].settings == odd.partitions[0].settings


def test_a_manifest_is_no_snapshot() -> None:
    with pytest.raises(SnapshotUnreadable, match=r"^it is not JSON \(Expecting value"):
        read_snapshot(b"schema: rarms/v1")


@pytest.mark.parametrize("data", [b"", b"\xff", b"[]", b"{}", b'{"format_version": "rarms-snapshot/2"}'])
def test_what_is_no_snapshot_says_why(data: bytes) -> None:
    with pytest.raises(SnapshotUnreadable) as refused:
        read_snapshot(data)

    assert refused.value.message
