import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import jsonschema
import pytest
from hypothesis import given

from rarms_iac.manifest.text.tree import first_line
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, Findings, Place, Related, Severity
from rarms_iac.texts.findings import Finding
from rarms_iac.views.console import render
from rarms_iac.views.finding_forms import (
    BadOutput,
    OutputFormat,
    OutputTarget,
    as_github,
    as_junit,
    as_sarif,
    file_uri,
    findings_as,
    parse_outputs,
)
from rarms_iac.views.json_output import json_of
from tests.unit.views.test_findings_text import diagnostics

EXCEEDED = Finding(code="RARMS014", severity=Severity.ERROR, summary="Reservations exceed the platform")
RESTART = Finding(code="RARMS041", severity=Severity.WARNING, summary="A change restarts a partition")
PLACE = Place(file="manifests/my robot.yaml", line=31, column=5, path="hosts.onboard", length=4)
ERROR = EXCEEDED.at(
    PLACE,
    "It needs 120 %.",
    prose("Relax an APT: ", command("select", "vision", at="100 ms"), "."),
    address="host/onboard",
    related=(Related(place=PLACE, message="here"),),
    needed_percent=120,
)
COMMAND = {
    "verb": "select",
    "arguments": ["vision"],
    "options": [{"name": "--at", "value": "100 ms"}],
    "text": "rarms select vision --at '100 ms'",
}
WARNING = RESTART.at(None, "It stops.", "Wait.", address="partition/vision")
FIRST_LINE = first_line("rarms.yaml")
SARIF_SCHEMA = Path(__file__).parents[4] / "shared" / "sarif" / "sarif-schema-2.1.0.json"


def test_json_is_versioned_and_whole() -> None:
    document = json.loads(json_of(Findings(findings=(ERROR, WARNING), accepted=(WARNING,))))

    assert document["format_version"] == "rarms-output/4"
    assert document["counts"] == {"errors": 1, "warnings": 1, "notes": 0}
    assert document["findings"][0] == {
        "code": "RARMS014",
        "severity": "error",
        "summary": "Reservations exceed the platform",
        "detail": "It needs 120 %.",
        "advice": "Relax an APT: `rarms select vision --at '100 ms'`.",
        "values": {"needed_percent": 120},
        "commands": [COMMAND],
        "address": "host/onboard",
        "place": {"file": "manifests/my robot.yaml", "line": 31, "column": 5, "length": 4, "path": "hosts.onboard"},
        "related": [
            {
                "place": {
                    "file": "manifests/my robot.yaml",
                    "line": 31,
                    "column": 5,
                    "length": 4,
                    "path": "hosts.onboard",
                },
                "message": "here",
            }
        ],
    }
    assert document["findings"][1]["place"] is None
    assert [finding["code"] for finding in document["accepted"]] == ["RARMS041"]


def test_sarif_points_at_place_with_escaped_relative_uri() -> None:
    run = json.loads(as_sarif([ERROR], page=lambda _code: "# The page"))["runs"][0]

    location = run["results"][0]["locations"][0]["physicalLocation"]
    assert location["artifactLocation"]["uri"] == "manifests/my%20robot.yaml"
    assert location["region"] == {"startLine": 31, "startColumn": 5, "endColumn": 9}
    assert run["columnKind"] == "unicodeCodePoints"


def test_sarif_has_rules_and_suppressions() -> None:
    run = json.loads(as_sarif([ERROR, ERROR], page=lambda code: f"# {code}", accepted=[WARNING]))["runs"][0]

    assert [rule["id"] for rule in run["tool"]["driver"]["rules"]] == ["RARMS014", "RARMS041"]
    assert run["tool"]["driver"]["rules"][0]["help"]["markdown"] == "# RARMS014"
    assert [("suppressions" in result, result["ruleIndex"]) for result in run["results"]] == [
        (False, 0),
        (False, 0),
        (True, 1),
    ]


@pytest.mark.parametrize(
    ("file", "uri"),
    [
        ("rarms.yaml", "rarms.yaml"),
        ("a b/ü#?%.yaml", "a%20b/%C3%BC%23%3F%25.yaml"),
        ("a:b.yaml", "a%3Ab.yaml"),
        ("../robot.yaml", "../robot.yaml"),
    ],
)
def test_uris_are_relative_and_escaped(file: str, uri: str) -> None:
    assert file_uri(file) == uri


def test_an_absolute_path_is_a_file_uri(tmp_path: Path) -> None:
    assert file_uri(str(tmp_path / "x.yaml")).startswith("file:///")


@pytest.mark.needs("shared")
def test_sarif_obeys_the_published_schema() -> None:
    schema: dict[str, Any] = json.loads(SARIF_SCHEMA.read_text(encoding="utf-8"))
    validator = jsonschema.Draft4Validator(schema)

    for text in (
        as_sarif([ERROR, WARNING], page=lambda _code: None, accepted=[WARNING]),
        as_sarif([], page=lambda _code: None),
        str(findings_as(OutputFormat.SARIF, [ERROR, WARNING], {}, places=FIRST_LINE)),
    ):
        assert list(validator.iter_errors(json.loads(text))) == []


def test_junit_maps_severities() -> None:
    suite = ET.fromstring(as_junit([ERROR, WARNING], accepted=[WARNING])).find("testsuite")

    assert suite is not None
    assert (suite.get("tests"), suite.get("failures"), suite.get("skipped")) == ("3", "1", "1")
    failed, told, skipped = suite
    assert (failed.get("file"), failed.get("line")) == ("manifests/my robot.yaml", "31")
    where, what, advice = (failed.findtext("failure") or "").splitlines()
    assert (where, what) == ("manifests/my robot.yaml:31:5, hosts.onboard", "It needs 120 %.")
    assert advice == "Relax an APT: `rarms select vision --at '100 ms'`."
    assert told.findtext("system-out") == "warning: It stops.\nWait."
    assert skipped.find("skipped") is not None


def test_junit_without_findings_has_a_case_that_passes() -> None:
    root = ET.fromstring(as_junit([]))

    assert root.get("tests") == "1"
    assert [case.get("name") for case in root.iter("testcase")] == ["No findings"]


def test_github_annotates_and_escapes() -> None:
    finding = EXCEEDED.at(PLACE, "120 %:\nno, really", "::error::x")

    assert as_github([finding]) == (
        "::error file=manifests/my robot.yaml,line=31,endLine=31,col=5,endColumn=8,"
        "title=RARMS014 Reservations exceed the platform::120 %25:%0Ano, really%0A<U+003A>:error::x\n"
    )


def test_github_properties_escape_colon_and_comma() -> None:
    place = Place(file="a,b:c%.yaml", line=1, column=1)

    assert "file=a%2Cb%3Ac%25.yaml," in as_github([EXCEEDED.at(place, "x", "y")])


def test_github_calls_note_notice_and_needs_no_place() -> None:
    note = Finding(code="RARMS086", severity=Severity.NOTE, summary="Not used").at(None, "x", "y")

    assert as_github([note]) == "::notice title=RARMS086 Not used::x%0Ay\n"


@given(diagnostics)
def test_hostile_text_breaks_no_form(diagnostic: Diagnostic) -> None:
    assert json.loads(json_of(Findings(findings=(diagnostic,))))["findings"][0]["code"] == diagnostic.code
    assert (
        json.loads(as_sarif([diagnostic], page=lambda _code: None))["runs"][0]["results"][0]["ruleId"]
        == diagnostic.code
    )
    assert ET.fromstring(as_junit([diagnostic])).get("tests") == "1"
    commands = as_github([diagnostic])
    assert commands.count("\n") == 1
    assert re.match(r"::(error|warning|notice) ", commands)
    for text in (
        json_of(Findings(findings=(diagnostic,))),
        as_sarif([diagnostic], page=lambda _code: None),
        as_junit([diagnostic]),
        commands,
    ):
        assert text.encode("utf-8")


@pytest.mark.parametrize("form", list(OutputFormat))
def test_every_form_renders_nothing_and_something(form: OutputFormat) -> None:
    assert "RARMS014" in render(findings_as(form, [ERROR], {}, places=FIRST_LINE))
    assert "RARMS014" not in render(findings_as(form, [], {}, places=FIRST_LINE))


def test_without_a_wish_text_goes_to_standard_output() -> None:
    assert parse_outputs([]) == (OutputTarget(format=OutputFormat.TEXT, path=None),)


def test_several_outputs_come_from_one_run() -> None:
    assert parse_outputs(["sarif=findings.sarif", "text", "junit=a=b.xml"]) == (
        OutputTarget(format=OutputFormat.SARIF, path="findings.sarif"),
        OutputTarget(format=OutputFormat.TEXT, path=None),
        OutputTarget(format=OutputFormat.JUNIT, path="a=b.xml"),
    )


def test_a_dash_is_standard_output() -> None:
    assert parse_outputs(["json=-"]) == (OutputTarget(format=OutputFormat.JSON, path=None),)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (["sraif"], 'Did you mean "sarif"'),
        (["SARIF=x"], "text, json, sarif, junit, github"),
        ([""], "is not an output format"),
        (["sarif="], "does not have a file"),
        (["text", "json"], "two outputs have the same target standard output"),
        (["json=x", "sarif=x"], "two outputs have the same target x"),
    ],
)
def test_impossible_output_is_refused_with_alternatives(values: list[str], message: str) -> None:
    with pytest.raises(BadOutput, match=message):
        parse_outputs(values)
