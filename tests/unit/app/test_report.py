"""`rarms report` and `rarms export`, from data logs in files to pages, plots and tables."""

import html
import json
import shlex
from collections.abc import Iterable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.app.data_logs import path_of, subject_of
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.report import not_yet_proven
from rarms_iac.app.report_measurements import ReportedLog
from rarms_iac.app.report_model import Report
from rarms_iac.app.requests import ManifestSource, today_utc
from rarms_iac.model.outcomes import Achievement
from rarms_iac.model.system import Component, System
from rarms_iac.planner.planning_findings import ON_NEIGHBOURS
from rarms_iac.statistics.curves import curves_of, least_reserve
from rarms_iac.storage.datalog import files as log_files
from rarms_iac.storage.datalog.decisions import Proven, ProvenIndex
from rarms_iac.storage.datalog.files import append_setting, append_to_log, configuration_path
from rarms_iac.storage.datalog.identity import header_of, identity_of
from rarms_iac.storage.datalog.log import Recorded
from rarms_iac.storage.datalog.named_files import Files
from rarms_iac.storage.records import LogLine
from rarms_iac.views.reports.page import cards_of, data_of
from rarms_iac.views.reports.tables import levels_table, totals_table
from rarms_iac.views.status import fit_text
from rarms_iac.views.table import show_cell
from tests.builders import a_component, a_cpu, a_host, a_partition, a_run, a_system, at_most
from tests.builders_measured import HELD, PROVEN, TAKEN, a_bench, a_log, a_proof, a_series, a_setting, a_subject
from tests.robots import a_log_of, a_measured_setting, a_robot, face_detection, path_planning, report_of_logs, the_logs
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


def an_entry(seen: ProvenIndex, **changes: object) -> Proven:
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
    assert "<summary>Earlier results</summary>" in (tmp_path / "page.html").read_text(encoding="utf-8")


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
    assert """The manifest does not have the component "visoin". Did you mean "vision"?""" in " ".join(ran.err.split())


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
    assert applied == "onboard: Applied: the host is as in the manifest."
    manifest = shlex.quote(str(robot))
    assert chosen == (
        f"onboard: Not applied yet: partition/vision. `rarms plan -f {manifest}` shows the changes, "
        f"`rarms apply -f {manifest}` makes them."
    )
    page = rarms("report", "-f", str(robot), "-o", "-").out
    assert (
        f"partition/vision. <code>rarms plan -f {manifest}</code> shows the changes, <code>rarms apply "
        f"-f {manifest}</code> makes them."
    ) in html.unescape(page)
    document = rarms("report", "-f", str(robot), "--json").out
    check(document)
    report = json.loads(document)
    [host] = report["hosts"]
    assert (host["name"], [each["address"] for each in host["drifted"]]) == ("onboard", ["partition/vision"])
    assert report["is_planned"]
    assert [each["text"] for each in report["commands"]] == ["rarms plan", "rarms apply"]


def test_the_page_has_findings_as_fields(robot: Path) -> None:
    text = robot.read_text(encoding="utf-8")
    robot.write_text(text.replace("at_most: 100 ms", "at_most: 1 ms"), encoding="utf-8")

    document = json.loads(rarms("report", "-f", str(robot), "--json").out)
    page = rarms("report", "-f", str(robot), "-o", "-").out

    assert not document["is_planned"]
    [finding] = document["findings"]
    assert finding["values"]["components"] == ["vision"]
    assert f"error[{finding['code']}]" in page
    for name in finding["values"]:
        assert f"<dt>{name}</dt>" in page
    for command in finding["commands"]:
        assert f"<code>{command['text']} -f " in page, "in the advice"


def test_what_was_proven_last_stands_in_the_report(robot: Path) -> None:
    path = configuration_path(robot.parent, "onboard", "vision")
    append_to_log(path, an_entry(replace(HELD, value=98.7)))
    append_to_log(path, an_entry(replace(HELD, value=113.0, lower=None, upper=None, met=False, verdict="missed")))

    page = rarms("report", "-f", str(robot), "-o", "-").out

    assert "113 ms" in page
    assert "missed" in page
    assert "98.7 ms" not in page


def test_proof_says_what_changed_since(robot: Path) -> None:
    path = configuration_path(robot.parent, "onboard", "vision")
    append_to_log(path, an_entry(replace(HELD, threshold=at_most(120))))

    page, text = (rarms("report", "-f", str(robot), *words).out for words in (["-o", "-"], ["--text"]))

    assert "; outdated: the threshold is at most 100 ms now; speech is gone; its partition reserves " in page
    assert "met (outdated)" in " ".join(text.split())
    now = int(page.partition("its partition reserves ")[2].partition("(")[2].partition(" ")[0])
    append_to_log(path, an_entry(HELD, beside=(), reserve=now))
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
    found = not_yet_proven([note], [a_proof(index="p99_response_time", **changes)] if proof else [])

    assert found == ((note,) if stays else ())


def measured(name: str, apt_ms: int | None = 100, criticality: int = 10) -> Component:
    apt = {} if apt_ms is None else {"mean_response_time": at_most(apt_ms)}
    return a_component(name, criticality=criticality, reserve="measured", run=a_run(), apt=apt)


def with_reserve(system: System, name: str, reserve: str) -> System:
    changed = replace(system.components[name], cpu=a_cpu(reserve=reserve))
    return replace(system, components={**system.components, name: changed})


def test_a_measurement_says_what_the_planner_takes() -> None:
    system = a_robot()

    report = report_of_logs(system, the_logs(system))

    for logged, name in zip(the_logs(system), ("face-detection", "speech-recognition"), strict=False):
        component = system.components[name]
        assert component.run is not None
        wanted = least_reserve(curves_of(logged.log.settings, {name: component.run}, {name: component.apt}))
        assert next(shown for shown in report.measurements if shown.name == name).reserve == wanted is not None


def levels_in(report: Report) -> list[dict[str, str]]:
    """The table of levels as people read it."""
    table = levels_table(report)
    return [
        {column.title: show_cell(cell, column.unit) for column, cell in zip(table.columns, row, strict=True)}
        for row in table.rows
    ]


def test_fixed_reserve_shows_its_thresholds() -> None:
    system = with_reserve(a_robot(), "face-detection", "60 %")
    row = next(row for row in levels_in(report_of_logs(system, [])) if row["component"] == "face-detection")

    assert row["threshold"] == "mean <= 100 ms"
    assert (row["expected"], row["verdict"]) == ("-", "fixed by the manifest")


def test_members_show_what_their_partition_gets() -> None:
    """One would be content with less; what is reserved is what the other needs."""
    slow, quick = measured("slow", 100), measured("quick", 400)
    system = a_system(components=[slow, quick], partitions=[a_partition("slow", components=["quick", "slow"])])
    settings = [
        a_setting(reserve, a_series("quick", [each] * 300), a_series("slow", [each] * 600))
        for reserve, each in ((20, 300.0), (59, 110.0), (60, 90.0))
    ]
    logged = ReportedLog(path="x", log=a_log(settings, a_subject(quick, slow)))

    rows = levels_in(report_of_logs(system, [logged]))

    assert [(row["component"], row["CR"]) for row in rows] == [
        ("quick", "60 % of its 2 VPs"),
        ("slow", "60 % of its 2 VPs"),
    ]


def test_total_counts_measured_and_fixed_components() -> None:
    system = a_robot()

    [fit] = report_of_logs(system, the_logs(system)).capacities

    assert fit.reserved_lp == Fraction(2 * (60 + 16), 100) + Fraction(2, 10)
    assert fit.fits
    assert fit_text(fit) == (
        "1.72 LP of 2 LP reserved (86 % of onboard). Headroom of onboard: 0.28 LP (14 % of onboard)."
    )


def test_a_total_above_the_capacity_is_said_so() -> None:
    system = with_reserve(a_robot(), "video-streaming", "60 %")

    [fit] = report_of_logs(system, the_logs(system)).capacities

    assert not fit.fits
    assert fit_text(fit).endswith("Over onboard by 0.72 LP (36 % of onboard).")


def test_total_with_unachieved_level_is_unknown() -> None:
    system = a_robot()
    component = system.components["face-detection"]
    impossible = replace(component, apt={"mean_response_time": at_most(1)})
    system = replace(system, components={**system.components, component.name: impossible})

    report = report_of_logs(system, the_logs(system))
    [fit] = report.capacities

    assert fit_text(fit) == (
        "At least 0.52 LP of 2 LP reserved (26 % of onboard). "
        "Headroom of onboard: not known: face-detection is not achieved."
    )
    cards = data_of(report, cards_of(report))["cards"]
    assert isinstance(cards, list)
    assert [card["decides"] for card in cards if card["name"] == "face-detection"] == [True], "its line counts"


def test_what_is_kept_for_host_is_no_capacity() -> None:
    system = a_system(hosts=[a_host(keep_processor="10 %")], components=[measured("vision")])

    [fit] = report_of_logs(system, []).capacities

    assert fit.capacity_lp == Fraction(18, 10)


def test_stale_log_decides_nothing() -> None:
    system = a_system(components=[measured("vision")])
    stale = replace(
        a_log_of(system.components["vision"], face_detection), stale=("vision.run.until.samples: 200 -> 300",)
    )

    report = report_of_logs(system, [stale])

    assert [(measurement.decides, measurement.stale) for measurement in report.measurements] == [(False, stale.stale)]
    assert [(each.component, each.achievement) for each in report.verdicts] == [("vision", Achievement.UNMEASURED)]


def test_log_of_another_load_is_there_to_compare() -> None:
    system = a_system(components=[measured("vision")])
    logged = a_log_of(system.components["vision"], face_detection)
    header = logged.log.header
    other = replace(header, setup=replace(header.setup, interference="browsers"))

    report = report_of_logs(
        system,
        [ReportedLog(path="browsers.jsonl", log=replace(logged.log, header=other), is_expected=False), logged],
    )

    assert [(measurement.interference, measurement.decides) for measurement in report.measurements] == [
        ("busy-loop", True),
        ("browsers", False),
    ]


def test_first_of_equal_loads_decides() -> None:
    system = a_system(components=[replace(measured("vision"), interference=("busy-loop", "bursts-20"))])
    logged = a_log_of(system.components["vision"], face_detection)
    header = logged.log.header
    other = replace(header, setup=replace(header.setup, interference="bursts-20"))

    beside_bursts = ReportedLog(path="bursts.jsonl", log=replace(logged.log, header=other))
    report = report_of_logs(system, [beside_bursts, logged])

    assert [each.interference for each in report.measurements if each.decides] == ["busy-loop"]
    assert levels_in(report)[0]["load"] == "busy-loop"


def test_fixed_reserve_counts_instead_of_log() -> None:
    system = with_reserve(a_robot(), "face-detection", "40 %")

    report = report_of_logs(system, the_logs(system))

    shown = next(measurement for measurement in report.measurements if measurement.name == "face-detection")
    assert (shown.decides, shown.fixed) == (False, ("face-detection",))
    assert [part.name for part in report.capacities[0].fixed] == ["face-detection", "video-streaming"]


def test_members_own_logs_do_not_count() -> None:
    both = [measured("vision", criticality=20), measured("planning")]
    system = a_system(components=both, partitions=[a_partition("vision", components=["vision", "planning"])])
    together = a_log(
        [a_setting(50, a_series("planning", [50.0] * 600), a_series("vision", [60.0] * 600))],
        a_subject(both[1], both[0]),
    )

    report = report_of_logs(
        system,
        [
            a_log_of(both[0], face_detection),
            a_log_of(both[1], path_planning),
            ReportedLog(path="both", log=together),
        ],
    )

    assert {measurement.name: measurement.decides for measurement in report.measurements} == {
        "planning+vision": True,
        "vision": False,
        "planning": False,
    }
    assert [measurement.reserve for measurement in report.measurements if measurement.decides] == [50]


def test_log_of_removed_component_is_left_out() -> None:
    gone = measured("gone")

    assert report_of_logs(a_system(), [a_log_of(gone, face_detection)]).measurements == ()


def test_setting_without_answer_gives_no_point() -> None:
    vision = measured("vision")
    log = a_log([a_setting(10, a_series(responses=[None] * 5)), a_setting(50)], a_subject(vision))

    [shown] = report_of_logs(a_system(components=[vision]), [ReportedLog(path="log", log=log)]).measurements[0].indexes

    assert [(point.reserve, point.value is None, point.failed) for point in shown.points] == [
        (10, True, 5),
        (50, False, 0),
    ]
    assert shown.points[0].verdict == "too many failed samples"
    assert [row.reserve for row in shown.rows] == [50]


def test_summary_names_unmeasured_components() -> None:
    system = a_robot()

    rows = levels_in(report_of_logs(system, the_logs(system)[:1]))

    assert [(row["component"], row["threshold"], row["reservation"], row["CR"]) for row in rows] == [
        ("face-detection", "mean <= 100 ms", "1.2 LP", "60 % of its 2 VPs"),
        ("video-streaming", "none", "0.2 LP", ""),
        ("speech-recognition", "", "not known", ""),
    ]
    assert rows[-1]["verdict"] == "not measured"


def empty(report: Report) -> bool:
    return not (report.measurements or report.verdicts)


def test_system_without_thresholds_and_logs_has_empty_report() -> None:
    assert empty(report_of_logs(a_system(), []))


def with_open_threshold() -> Report:
    """Two measured components; the percentile of one has too few samples for a verdict."""
    steady, late = measured("steady", criticality=20), measured("late", 120)
    late = replace(late, apt={**late.apt, "p95_response_time": at_most(120)})
    settings = [a_setting(reserve, a_series("late", [90.0, 91.0] * 40)) for reserve in (50, 100)]
    log = ReportedLog(path="late", log=a_log(settings, a_subject(late)))
    system = a_system(components=[steady, late])
    return report_of_logs(system, [a_log_of(steady, face_detection), log])


def test_no_view_has_reservation_while_threshold_is_open() -> None:
    report = with_open_threshold()

    assert [(each.component, each.achievement) for each in report.verdicts] == [
        ("steady", Achievement.MET),
        ("late", Achievement.OPEN),
    ]
    rows = [(row["component"], row["reservation"], row["CR"], row["verdict"]) for row in levels_in(report)]
    assert rows == [
        ("steady", "1.2 LP", "60 % of its 2 VPs", "met"),
        ("late", "not known", "", "met"),
        ("late", "not known", "", "inconclusive"),
    ]
    [fit] = report.capacities
    assert (fit.headroom_lp, fit.fits) == (None, None)
    assert fit_text(fit) == (
        "At least 1.2 LP of 2 LP reserved (60 % of onboard). Headroom of onboard: not known: late is inconclusive."
    )
    [total] = totals_table(report).rows
    assert total[3:] == ("at least", Fraction(12, 10), "late", None, "not known"), "the sheet"


def test_component_without_load_log_is_not_totalled() -> None:
    vision = replace(measured("vision"), interference=("busy-loop", "bursts-20"))

    report = report_of_logs(a_system(components=[vision]), [a_log_of(vision, face_detection)])

    assert [row["verdict"] for row in levels_in(report)] == ["not measured with bursts-20"]
    assert fit_text(report.capacities[0]).endswith("not known: vision is not measured with bursts-20.")
