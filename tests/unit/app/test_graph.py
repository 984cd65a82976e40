"""`rarms graph --candidates`: what could be combined, as the data logs say."""

import json
from datetime import date
from pathlib import Path

import pytest

from rarms_iac.app.graph import recorded_answers
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import ManifestSource
from rarms_iac.planner.combining.candidates import candidates_of
from rarms_iac.planner.combining.oracle import WHOLE, Coi
from tests.builders_measured import a_setting
from tests.measuring import leave_log, steady
from tests.unit.cli.running import rarms
from tests.unit.views.test_json import check

MANIFEST = """\
schema: rarms/v1
application: { name: robot }
hosts:
  onboard: { provider: simulated, platform: two-core, logical_processors: 2, memory: 4 GiB }
components:
  path:
    criticality: 10
    apt: { mean_response_time: { at_most: 100 ms } }
    memory: 64 MiB
    simulation: { work: 10 ms }
  speech:
    criticality: 20
    apt: { mean_response_time: { at_most: 100 ms } }
    memory: 64 MiB
    simulation: { work: 20 ms }
  vision:
    criticality: 30
    apart: [path]
    apt: { mean_response_time: { at_most: 100 ms } }
    memory: 64 MiB
    simulation: { work: 30 ms }
"""


@pytest.fixture
def here(tmp_path: Path) -> Path:
    """Three measured components, two of which must be apart."""
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    for name, reserve in {"path": 20, "speech": 30, "vision": 50}.items():
        leave(tmp_path, [name], {reserve - 1: 150.0, reserve: 90.0})
    return tmp_path


def leave(folder: Path, names: list[str], means: dict[int, float]) -> None:
    settings = [a_setting(reserve, *(steady(name, mean) for name in names)) for reserve, mean in means.items()]
    leave_log(folder, names, settings)


def labels(folder: Path) -> list[str]:
    answer = rarms("graph", "--candidates", "-f", str(folder))
    assert answer.code == 0, answer.err
    return [line for line in answer.lines if "[" in line]


def test_compounds_show_their_useful_interval(here: Path) -> None:
    assert labels(here) == [
        '  n0["path<br/>20 % of its VPs"]',
        '  n1["speech<br/>30 % of its VPs"]',
        '  n2["vision<br/>50 % of its VPs"]',
        '  n3["path+speech<br/>28 to 49 % of its VPs, predicted: 49 % of its VPs, to be measured"]',
        '  n4["speech+vision<br/>48 to 79 % of its VPs, predicted: 57 % of its VPs, to be measured"]',
    ]


def test_what_was_measured_of_a_compound_is_told(here: Path) -> None:
    leave(here, ["path", "speech"], {34: 150.0, 35: 90.0})
    leave(here, ["speech", "vision"], {79: 150.0})

    assert labels(here)[3:] == [
        '  n3["path+speech<br/>35 % of its VPs"]',
        '  n4["speech+vision<br/>no gain: needs at least 80 % of its VPs"]',
    ]


def test_interval_begins_where_parts_missed(here: Path) -> None:
    leave(here, ["speech"], {21: 150.0, 29: 100.0, 30: 90.0})

    assert '30 % of its VPs"]' in labels(here)[1]
    assert "path+speech<br/>20 to" in labels(here)[3], (
        "speech missed for sure at 21 % only, and there are two processors"
    )


def test_the_picture_and_json_show_the_same_graph(here: Path) -> None:
    picture = rarms("graph", "--candidates", "-f", str(here)).lines
    assert "  n0 -.-> n3" in picture, "path is a part of path+speech, which is dashed until it is measured"

    table = rarms("graph", "--candidates", "-f", str(here), shown_at_a_terminal=True).out
    assert "path + speech" in table
    assert "n0" not in table, "a terminal gets a table, which keeps to its width"

    answer = rarms("graph", "--candidates", "--json", "-f", str(here))
    check(answer.out)
    shown = {load["name"]: load for load in json.loads(answer.out)["candidates"]}
    assert shown["speech+vision"]["parts"] == ["speech", "vision"]
    assert (shown["speech+vision"]["low"], shown["speech+vision"]["high"]) == (48, 79)
    assert shown["speech+vision"]["predicted"] == 57
    assert shown["speech"]["predicted"] is None


def test_a_recorded_answer_names_the_members_that_missed(here: Path) -> None:
    names = ["path", "speech"]
    below, enough = (
        a_setting(30, steady("path", 150.0), steady("speech", 90.0)),
        a_setting(45, steady("path", 90.0), steady("speech", 90.0)),
    )
    leave_log(here, names, [below, enough])
    manifest = load_manifest(ManifestSource(manifest=str(here), today=date(2026, 11, 21)))
    cois = [
        Coi(name=name, members=(name,), criticality=reserve, processors=2, reserve=reserve)
        for name, reserve in {"path": 20, "speech": 30}.items()
    ]
    candidates = candidates_of(cois, lambda _names: True, most=WHOLE)

    answers = recorded_answers(manifest, manifest.system.hosts["onboard"], candidates, {})

    assert {answer.reserve: answer.worse for answer in answers} == {30: ("path",), 45: ()}
