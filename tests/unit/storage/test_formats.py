"""Frozen values become JSON and come back, strictly."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import date
from enum import StrEnum
from fractions import Fraction
from pathlib import Path
from typing import Literal

import jsonschema
import pytest

from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, Place, Severity
from rarms_iac.model.facets import Readings
from rarms_iac.model.host import Host
from rarms_iac.model.operations import Operation, set_to
from rarms_iac.model.plan import Plan
from rarms_iac.model.quantities import CpuAmount, LogicalProcessors, Percent, ProcessorTime, ShareOfHost
from rarms_iac.model.series import HeardMessages
from rarms_iac.model.state import State
from rarms_iac.model.system import Measured
from rarms_iac.storage.codec import NotDecodable, decode, decode_union, encode
from rarms_iac.storage.json_text import canonical, digest, parse_json, short
from rarms_iac.storage.plan_file import identified, plan_id, write_plan
from rarms_iac.storage.snapshot_file import SnapshotUnreadable, read_snapshot, write_snapshot
from scripts.file_schemas import SCHEMAS, plan_schema, snapshot_schema, text_of
from tests import builders
from tests.builders_plan import a_rich_plan, because, create, facts, host_plan, partition, plan, settings, task


class Colour(StrEnum):
    RED = "red"


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    amount: Fraction
    colour: Colour
    day: date | None
    cpu: CpuAmount | Measured | None
    sizes: tuple[int, ...] = ()
    pair: tuple[str, bool] = ("a", True)
    words: frozenset[str] = frozenset()
    inside: Mapping[str, "Box"] = field(default_factory=dict)
    kind: Literal["box"] = "box"


BOX = Box(
    amount=Fraction(7, 3),
    colour=Colour.RED,
    day=date(2027, 1, 31),
    cpu=ShareOfHost(Percent(Fraction(70))),
    sizes=(3, 1),
    words=frozenset({"b", "a"}),
    inside={"x": Box(amount=Fraction(1), colour=Colour.RED, day=None, cpu=Measured.MEASURED)},
)


def test_a_value_comes_back_as_it_was() -> None:
    assert decode(Box, encode(BOX)) == BOX


def test_what_is_written_is_what_a_reader_expects() -> None:
    assert encode(BOX) == {
        "amount": "7/3",
        "colour": "red",
        "day": "2027-01-31",
        "cpu": {"ShareOfHost": {"percent": "70"}},
        "sizes": [3, 1],
        "pair": ["a", True],
        "words": ["a", "b"],
        "inside": {
            "x": {
                "amount": "1",
                "colour": "red",
                "day": None,
                "cpu": "measured",
                "sizes": [],
                "pair": ["a", True],
                "words": [],
                "inside": {},
                "kind": "box",
            }
        },
        "kind": "box",
    }


@pytest.mark.parametrize(
    "amount", [ProcessorTime(LogicalProcessors(Fraction(7, 5))), ShareOfHost(Percent(Fraction(1)))]
)
def test_a_union_without_kinds_names_its_member(amount: CpuAmount) -> None:
    assert decode_union(CpuAmount, encode(amount, CpuAmount)) == amount


def test_a_union_with_kinds_is_told_by_them() -> None:
    step = set_to("vision", reserve=40, limit=100, weight=100)

    assert decode_union(Operation, encode(step)) == step
    with pytest.raises(NotDecodable, match="not one of create_partition, erase_mark"):
        decode_union(Operation, {"kind": "explode", "partition": "vision"})


def test_readings_keep_their_types() -> None:
    readings: Readings = {"exists": True, "reserve": 1, "name": "1"}

    back = decode_union(Readings, encode(readings, Readings))

    assert {name: type(value) for name, value in back.items()} == {"exists": bool, "reserve": int, "name": str}


def test_stamps_may_be_behind_the_clock() -> None:
    heard = HeardMessages(input="/camera", inputs=3, ahead_ms=-0.4)

    assert decode(HeardMessages, encode(heard)) == heard


def test_a_host_of_the_manifest_comes_back() -> None:
    assert decode(Host, encode(builders.a_host())) == builders.a_host()


@pytest.mark.parametrize(
    ("data", "path"),
    [
        ({"amount": "1", "colour": "red", "day": None}, "cpu"),
        ({"amount": "1", "colour": "blue", "day": None, "cpu": None}, "colour"),
        ({"amount": 1, "colour": "red", "day": None, "cpu": None}, "amount"),
        ({"amount": "1/0", "colour": "red", "day": None, "cpu": None}, "amount"),
        ({"amount": "1", "colour": "red", "day": "soon", "cpu": None}, "day"),
        ({"amount": "1", "colour": "red", "day": None, "cpu": {"Other": {}}}, "cpu"),
        ({"amount": "1", "colour": "red", "day": None, "cpu": None, "sizes": [1, True]}, "sizes[1]"),
        ({"amount": "1", "colour": "red", "day": None, "cpu": None, "pair": ["a"]}, "pair"),
        ({"amount": "1", "colour": "red", "day": None, "cpu": None, "inside": {"x": 3}}, "inside.x"),
        ({"amount": "1", "colour": "red", "day": None, "cpu": None, "smell": 1}, "smell"),
        ({"amount": "1", "colour": "red", "day": None, "cpu": None, "kind": "bag"}, "kind"),
        ([], ""),
    ],
)
def test_misfit_is_refused_with_path(data: object, path: str) -> None:
    with pytest.raises(NotDecodable) as refused:
        decode(Box, data)

    assert refused.value.path == path


@pytest.mark.parametrize("text", ['{"a":1,"a":2}', "NaN", "{", "[" * 100_000, "1" * 5000, ""])
def test_text_that_is_no_plain_json_is_refused(text: str) -> None:
    with pytest.raises(NotDecodable):
        parse_json(text)


def test_canonical_json_does_not_depend_on_order() -> None:
    assert canonical({"b": 1, "a": Fraction(1, 3)}) == '{"a":"1/3","b":1}' == canonical({"a": Fraction(1, 3), "b": 1})
    assert digest({"a": "é"}) == digest({"a": "é"}) != digest({"a": "e"})
    assert short(digest(BOX)) == digest(BOX)[:12]
    assert canonical(Colour.RED) == '"red"'


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
    with pytest.raises(SnapshotUnreadable, match="this field is unknown"):
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


def made_from(folder: str) -> Plan:
    """The plan as it is made when the manifest lies in this folder, seen from where `rarms` is called."""
    place = Place(file=f"{folder}rarms.yaml", line=3, column=5)
    note = Diagnostic(
        code="RARMS086",
        severity=Severity.NOTE,
        summary="An entry is not used",
        detail="It is not named.",
        advice=prose("Measure with it: ", command("measure", f=folder or ".")),
        place=place,
    )
    change = create(partition(settings()), because(file=place.file))
    return replace(plan(host_plan(changes=[change])), manifest=place.file, findings=(note,))


@pytest.mark.parametrize("folder", ["robot/", "../robot/", "/srv/robot/"])
def test_same_plan_has_same_id_from_every_folder(folder: str) -> None:
    assert plan_id(made_from(folder)) == plan_id(made_from(""))


def test_another_line_of_the_manifest_is_another_plan() -> None:
    moved = create(partition(settings()), because(line=32))

    assert plan_id(plan(host_plan(changes=[moved]))) != plan_id(made_from(""))
