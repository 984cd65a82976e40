"""What a plan says of its choice of hosts: in its text, in its JSON and in its file."""

import json
from pathlib import Path

import pytest

from rarms_iac.app.plan_files import read_plan_file
from tests.unit.cli.running import rarms
from tests.unit.views.test_json import check

HOST = """\
  {name}:
    provider: simulated
    logical_processors: 1
    memory: 1 GiB
"""
COMPONENT = """\
  {name}:
    criticality: 1
    run: {{ command: [python3, "{name}.py"], samples: {{ from: per_run }}, until: {{ samples: 20 }} }}
    memory: 64 MiB
    cpu: {{ reserve: {reserve} % }}
    processors: 1
"""
OPTIMAL = "The choice of hosts is optimal"


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    hosts = "".join(HOST.format(name=name) for name in ("one", "three", "two"))
    reserves = {"a": 60, "b": 50, "c": 40, "d": 30, "e": 20}
    components = "".join(COMPONENT.format(name=name, reserve=share) for name, share in reserves.items())
    text = f"schema: rarms/v1\n\napplication:\n  name: fleet\n\nhosts:\n{hosts}\ncomponents:\n{components}"
    (tmp_path / "rarms.yaml").write_text(text, encoding="utf-8", newline="\n")
    return tmp_path


def test_placement_is_in_json_and_plan_file(fleet: Path) -> None:
    answer = rarms("plan", "--json", "-f", str(fleet), "--out", str(fleet / "plan.json"))

    check(answer.out)
    placement = json.loads(answer.out)["placement"]
    read = read_plan_file(str(fleet / "plan.json")).placement
    assert read is not None
    assert placement == {
        "verdict": "optimal",
        "reserved_lp": read.reserved / 100,
        "reserved_bound_lp": 2.0,
        "moves": 0,
        "moves_bound": 0,
    }


def test_plan_show_and_explain_say_optimal(fleet: Path) -> None:
    planned = rarms("plan", "-v", "-f", str(fleet), "--out", str(fleet / "plan.json"))
    shown = rarms("show", "-v", str(fleet / "plan.json"))
    explained = rarms("explain", "a", "-f", str(fleet))

    for answer in (planned, shown, explained):
        assert OPTIMAL in " ".join(answer.out.split()), answer.err
