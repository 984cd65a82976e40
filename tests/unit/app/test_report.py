"""`rarms report` and `rarms export`, from data logs in files to pages, plots and tables."""

import html
import json
import shlex
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.app.data_logs import path_of, subject_of
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.report import not_yet_proven
from rarms_iac.app.requests import ManifestSource, today_utc
from rarms_iac.model.indexes import index_named
from rarms_iac.planner.planning_findings import ON_NEIGHBOURS
from rarms_iac.storage.append import LogLine
from rarms_iac.storage.datalog import files as log_files
from rarms_iac.storage.datalog.decisions import Proven, ProvenIndex
from rarms_iac.storage.datalog.files import append_setting, append_to_log, configuration_path
from rarms_iac.storage.datalog.identity import header_of, identity_of
from rarms_iac.storage.datalog.log import Recorded
from rarms_iac.storage.datalog.named_files import Files
from tests.builders import at_most
from tests.builders_measured import HELD, PROOF, PROVEN, TAKEN, a_bench
from tests.robots import a_measured_setting, face_detection
from tests.unit.cli.running import rarms
from tests.unit.views.test_json import check

MANIFEST = """\
schema: rarms/v1
application: { name: robot }
policy: { interference: busy-loop }
hosts:
  onboard: { provider: simulated, logical_processors: 2, memory: 4 GiB }
components:
  vision:
    criticality: 40
    apt: { mean_response_time: { at_most: 100 ms } }
    memory: 512 MiB
    cpu: { reserve: measured }
    simulation: { work: 60 ms }
interference:
  busy-loop: { kind: busy_loop }
"""


def a_proof(seen: ProvenIndex, **changes: object) -> Proven:
    return replace(PROVEN, indexes=(seen,), **changes)  # type: ignore[arg-type]  # fields, said by tests


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A manifest with the data log of its component, as it is now."""
    manifest = tmp_path / "rarms.yaml"
    manifest.write_text(MANIFEST, encoding="utf-8")
    system = load_manifest(ManifestSource(manifest=str(manifest), today=today_utc())).system
    subject = subject_of(system, system.hosts["onboard"], ("vision",), "busy-loop")
    path = path_of(tmp_path, subject)
    header = header_of(subject, identity_of(subject, Files(tmp_path).of(subject), {}), a_bench())
    for reserve in (20, 40, 60, 80):
        setting = a_measured_setting("vision", reserve, face_detection, samples=2000)
        append_setting(path, header, Recorded(setting=setting, provenance=replace(TAKEN)))
    return manifest


def test_page_is_written_and_says_reserve_of_plan(robot: Path) -> None:
    page = robot.parent / "out.html"

    ran = rarms("report", "-f", str(robot), "-o", str(page))
    planned = rarms("plan", "-f", str(robot), "--json")

    assert (ran.code, ran.out) == (0, "")
    assert "Wrote" in ran.err
    reported = json.loads(rarms("report", "-f", str(robot), "--json").out)
    [measurement] = reported["measurements"]
    assert measurement["decides"]
    reserves = [
        attribute["after"]
        for host in json.loads(planned.out)["hosts"]
        for change in host["changes"]
        for attribute in change["attributes"]
        if attribute["name"] == "reserve"
    ]
    assert reserves == [measurement["reserve"]]
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")


def test_stale_log_is_named_and_not_drawn(robot: Path, tmp_path: Path) -> None:
    fresh = rarms("report", "-f", str(robot), "--text")
    robot.write_text(MANIFEST.replace("60 ms", "70 ms"), encoding="utf-8")

    ran = rarms("report", "-f", str(robot), "--text")
    page = rarms("report", "-f", str(robot), "--out", str(tmp_path / "page.html"))

    assert (ran.code, page.code) == (0, 0)
    assert "stale: vision.simulation.work: 60 ms -> 70 ms" in ran.out
    assert len(ran.lines) < len(fresh.lines) - 5
    assert "<summary>What it showed then</summary>" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_report_reads_each_log_once(robot: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[Path] = []
    log_in = log_files.log_in

    def counted(lines: Iterable[LogLine], path: Path) -> object:
        read.append(path)
        return log_in(lines, path)

    monkeypatch.setattr(log_files, "log_in", counted)

    answer = rarms("report", "--out", str(robot.parent / "report.html"), "-f", str(robot))

    assert answer.code == 0, answer.err
    assert read
    assert len(read) == len(set(read))


def test_a_damaged_log_is_named(robot: Path) -> None:
    [log] = robot.parent.glob("measurements/*/*/*.jsonl")
    log.write_bytes(b"what is this\n" + log.read_bytes())

    ran = rarms("report", "-f", str(robot), "--text")

    assert ran.code == 4
    assert "error[RARMS107]" in ran.err


@pytest.mark.parametrize("name", ["out.csv", "out.XLSX"])
def test_an_export_is_written(robot: Path, name: str) -> None:
    target = robot.parent / name

    ran = rarms("export", str(target), "vision", "-f", str(robot), "--samples")

    assert ran.code == 0
    assert target.read_bytes()[:2] in {b"PK", b"co"}


def test_words_that_make_no_sense_are_refused(robot: Path) -> None:
    assert rarms("export", "out.pdf", "-f", str(robot)).code == 64
    assert rarms("report", "-f", str(robot), "--text", "-o", "x").code == 64


@pytest.mark.parametrize("command", [("report",), ("report", "--text"), ("export", "out.csv")])
def test_a_component_that_is_misspelt_is_asked_back(robot: Path, command: tuple[str, ...]) -> None:
    ran = rarms(*command, "visoin", "-f", str(robot))

    assert ran.code == 64
    assert """The manifest has no component "visoin". Did you mean "vision"?""" in " ".join(ran.err.split())


def status(robot: Path) -> str:
    message = rarms("report", "-f", str(robot), "--text").out
    return message[message.index("\nonboard: ", message.index("Headroom")) :].splitlines()[1]


def test_report_says_whether_what_it_shows_is_applied(robot: Path) -> None:
    never = status(robot)
    assert rarms("apply", "-f", str(robot), "--auto-approve").code == 0
    applied = status(robot)
    text = robot.read_text(encoding="utf-8")
    robot.write_text(text.replace("at_most: 100 ms", "at_most: 170 ms"), encoding="utf-8")
    chosen = status(robot)

    assert never.startswith("onboard: Not applied yet: partition/vision")
    assert applied == "onboard: Applied: the host is as the manifest wants it."
    manifest = shlex.quote(str(robot))
    assert chosen == (
        f"onboard: Not applied yet: partition/vision. `rarms plan -f {manifest}` shows what is to be done, "
        f"`rarms apply -f {manifest}` does it."
    )
    page = rarms("report", "-f", str(robot), "-o", "-").out
    assert (
        f"partition/vision. <code>rarms plan -f {manifest}</code> shows what is to be done, "
        f"<code>rarms apply -f {manifest}</code> does it."
    ) in html.unescape(page)
    document = rarms("report", "-f", str(robot), "--json").out
    check(document)
    assert json.loads(document)["statuses"] == [
        {
            "host": "onboard",
            "is_planned": True,
            "differs": [{"address": "partition/vision", "message": "not applied yet"}],
            "commands": [
                {"verb": verb, "arguments": [], "options": [], "text": f"rarms {verb}"} for verb in ("plan", "apply")
            ],
        }
    ]


def test_the_page_has_findings_as_fields(robot: Path) -> None:
    text = robot.read_text(encoding="utf-8")
    robot.write_text(text.replace("at_most: 100 ms", "at_most: 1 ms"), encoding="utf-8")

    document = json.loads(rarms("report", "-f", str(robot), "--json").out)
    page = rarms("report", "-f", str(robot), "-o", "-").out

    assert [status["is_planned"] for status in document["statuses"]] == [False]
    [finding] = document["findings"]
    assert finding["values"]["components"] == ["vision"]
    assert f"error[{finding['code']}]" in page
    for name in finding["values"]:
        assert f"<dt>{name}</dt>" in page
    for command in finding["commands"]:
        assert f"<code>{command['text']} -f " in page, "in the advice"


def test_what_was_proven_last_stands_in_the_report(robot: Path) -> None:
    path = configuration_path(robot.parent, "onboard", "vision")
    append_to_log(path, a_proof(replace(HELD, value=98.7)))
    append_to_log(path, a_proof(replace(HELD, value=113.0, lower=None, upper=None, met=False, verdict="missed")))

    page = rarms("report", "-f", str(robot), "-o", "-").out

    assert "113 ms" in page
    assert "missed" in page
    assert "98.7 ms" not in page


def test_proof_says_what_changed_since(robot: Path) -> None:
    path = configuration_path(robot.parent, "onboard", "vision")
    append_to_log(path, a_proof(replace(HELD, threshold=at_most(120))))

    page, text = (rarms("report", "-f", str(robot), *words).out for words in (["-o", "-"], ["--text"]))

    assert "; outdated: the threshold is at most 100 ms now; speech is gone; its partition reserves " in page
    assert "met (outdated)" in " ".join(text.split())
    now = int(page.partition("its partition reserves ")[2].partition("(")[2].partition(" ")[0])
    append_to_log(path, a_proof(HELD, beside=(), reserve=now))
    assert "outdated" not in rarms("report", "-f", str(robot), "-o", "-").out


@pytest.mark.parametrize(
    ("proof", "changes", "stays"),
    [
        (True, {}, False),
        (True, {"met": False, "verdict": "missed"}, True),
        (True, {"outdated": ("speech is gone",)}, True),
        (True, {"interference": None}, True),
        (False, {}, True),
    ],
)
def test_neighbour_note_goes_where_proof_held(proof: bool, changes: dict[str, Any], stays: bool) -> None:
    note = ON_NEIGHBOURS.at(None, "It depends.", "Prove it.", component="vision", indexes=("p99_response_time",))
    proven = replace(PROOF, index=index_named("p99_response_time"))

    found = not_yet_proven([note], [replace(proven, **changes)] if proof else [])

    assert found == ((note,) if stays else ())
