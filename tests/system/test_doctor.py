"""`rarms doctor` on simulated hosts: facts, findings, acceptances and exit codes."""

import json
from pathlib import Path

import pytest

from tests.recorded_hosts import FOLDER, NAMES
from tests.system.test_void_hosts import ACCEPTED, Desk
from tests.unit.cli.running import rarms


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path)


def test_a_host_without_problems(desk: Desk) -> None:
    ran = desk.run("doctor")

    assert (ran.code, ran.err) == (0, "")
    assert "  scheduler   classic" in ran.lines
    assert ran.lines[-1].startswith("No problems found: the hosts can honour reservations. Next: `rarms status -f ")


@pytest.mark.parametrize(
    ("host", "policy", "code", "last"),
    [
        ("scheduler: root", "policy:\n", 2, "1 error."),
        ("scheduler: root", ACCEPTED, 0, "No findings (1 accepted)."),
        ("administrator: false", "policy:\n", 2, "1 error."),
        ("scheduler: core, smt: true", "policy:\n", 0, "1 warning."),
    ],
)
def test_errors_end_with_2_and_warnings_do_not(desk: Desk, host: str, policy: str, code: int, last: str) -> None:
    ran = desk.run("doctor", host=host, policy=policy)

    assert (ran.code, ran.lines[-1]) == (code, last)


def test_programs_get_facts_and_findings(desk: Desk) -> None:
    answer = json.loads(desk.run("doctor", "--json", host="scheduler: root, client: true").out)

    (host,) = answer["hosts"]
    assert (answer["kind"], answer["counts"]["errors"]) == ("doctor", 1)
    assert (host["facts"]["scheduler"], host["facts"]["client"], [finding["code"] for finding in host["findings"]]) == (
        "root",
        True,
        ["RARMS159"],
    )


def test_findings_come_in_every_form(desk: Desk, tmp_path: Path) -> None:
    file = tmp_path / "findings.sarif"

    ran = desk.run("doctor", "--output", f"sarif={file}", "--output", "github", host="administrator: false")

    assert ran.out.startswith("::error ")
    assert json.loads(file.read_text(encoding="utf-8"))["runs"][0]["results"][0]["ruleId"] == "RARMS158"


def test_hosts_of_one_machine_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    host = "{ provider: simulated, logical_processors: 2, memory: 4 GiB }"
    hosts = f"hosts:\n  left: {host}\n  right: {host}\n"
    Path("rarms.yaml").write_text(
        f"schema: rarms/v1\napplication: {{ name: robot }}\n{hosts}components: {{ vision: {{ criticality: 1 }} }}\n",
        encoding="utf-8",
    )
    rarms("snapshot", "--out", "seen")
    for file in Path("seen").iterdir():
        document = json.loads(file.read_text(encoding="utf-8"))
        document["state"]["facts"]["id"] = "one"
        file.write_text(json.dumps(document), encoding="utf-8")

    answer = rarms("doctor", "--snapshot", "seen/left.json", "--snapshot", "seen/right.json")

    assert answer.out.count("warning[RARMS343]") == 1
    assert "RARMS343" not in rarms("doctor", "--snapshot", "seen/left.json", "--host", "left").out


def test_acceptance_for_doctor_is_not_unused_in_plan(desk: Desk) -> None:
    policy = "policy:\n  accept:\n    RARMS234: { at: [host/onboard], reason: a laptop }\n"

    assert "RARMS096" not in desk.run("plan", policy=policy).out


MANIFEST = Path(__file__).parent.parent.parent / "manifests" / "hyperv-cell" / "rarms.yaml"
EXPECTED = {
    "client-with-root-scheduler": ["RARMS126", "RARMS159", "RARMS241", "RARMS405"],
    "duplicates-of-a-name": ["RARMS151", "RARMS234"],
    "empty-host": ["RARMS234"],
    "event-log-rolled-over": ["RARMS166", "RARMS190"],
    "inside-a-guest": ["RARMS126", "RARMS233", "RARMS249"],
    "machines-in-every-state": ["RARMS234", "RARMS245"],
    "redirected-by-windows-powershell": ["RARMS234"],
    "server-2022-with-strangers": ["RARMS234", "RARMS367"],
    "unprivileged-caller": ["RARMS126", "RARMS158", "RARMS166", "RARMS249"],
}


def codes(name: str) -> list[str]:
    ran = rarms("doctor", "-f", str(MANIFEST), "--snapshot", f"cell={FOLDER / name}.json", "--json")
    (host,) = json.loads(ran.out)["hosts"]
    return sorted({finding["code"] for finding in host["findings"]})


@pytest.mark.parametrize("name", NAMES)
def test_recorded_host_is_told_its_problems(name: str) -> None:
    assert codes(name) == EXPECTED[name]
