"""`rarms status`, `rarms history` and `rarms simulate change`, and what drift and plan say of an intruder."""

import json
import re
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

import rarms_iac
from rarms_iac.app.status import Overview
from rarms_iac.model.journal import JournalRecord, StepRecorded, StepStatus
from rarms_iac.planner.infeasibility import causes
from rarms_iac.providers.journaled import JournaledHost
from rarms_iac.storage import disk
from rarms_iac.views.console import render
from rarms_iac.views.status import status_text
from tests.builders_measured import a_proof
from tests.crashing import Crash, CrashingDisk
from tests.unit.cli.running import rarms

MANIFEST = """schema: rarms/v1
application: { name: robot }
policy: { interference: busy-loop }
hosts:
  onboard:
    { provider: simulated, logical_processors: 2, memory: 4 GiB, keep_for_host: { processor: 10 %, memory: 0 B } }
components:
  vision: { criticality: 9, memory: 512 MiB, cpu: { reserve: 40 % } }
  speech: { criticality: 5, memory: 512 MiB, cpu: { reserve: 20 % } }
"""
MEASURED = """  planner:
    criticality: 3
    memory: 512 MiB
    apt: { mean_response_time: { at_most: 100 ms } }
    simulation: { work: 5 ms }
"""


@pytest.fixture(autouse=True)
def _a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("rarms.yaml").write_text(MANIFEST, encoding="utf-8")


def test_status_names_what_is_missing_first() -> None:
    before = rarms("status")
    assert rarms("apply", "--auto-approve").code == 0
    after = rarms("status")

    assert "0 LP of 2 LP reserved, 0.2 LP kept for the host, 1.8 LP free" in before.out
    assert "Next: `rarms plan` shows the changes that are not applied yet." in before.out
    assert "Host onboard  [############........]\n" in after.out
    assert "\n  1.2 LP of 2 LP reserved, 0.2 LP kept for the host, 0.6 LP free.\n" in after.out
    assert "vision 0.8 LP 40 % of its 2 VPs running" in " ".join(after.out.split())
    assert "Everything is applied, and no component has a threshold to prove." in after.out
    assert rarms().out == after.out


def test_proof_confirms_a_provisional_reservation() -> None:
    Path("rarms.yaml").write_text(MANIFEST.partition("  vision:")[0] + MEASURED, encoding="utf-8")
    for words in (("measure", "--quick"), ("apply", "--auto-approve"), ("prove", "--load-host", "--samples", "200")):
        ran = rarms(*words)
        assert ran.code == 0, ran.out + ran.err

    shown = rarms("status").out

    assert "Provisional, confirmed by the proof: planner." in shown
    assert "Everything is applied, and every threshold was proven." in shown


def test_start_reservation_is_in_status_not_in_drift(monkeypatch: pytest.MonkeyPatch) -> None:
    more = MANIFEST.replace("reserve: 40 % }", "reserve: 40 %, starting: { reserve: 60 %, for: 30 s } }")
    Path("rarms.yaml").write_text(more, encoding="utf-8")
    steps = rarms_iac.plan(rarms_iac.load("rarms.yaml")).hosts[0].steps
    (number,) = [at for at, step in enumerate(steps) if step.wait_ms]
    record = JournaledHost.record

    def killed_after_start(host: JournaledHost, entry: JournalRecord) -> None:
        record(host, entry)
        if isinstance(entry, StepRecorded) and entry.number == number - 1 and entry.status is StepStatus.CHANGED:
            raise Crash

    with monkeypatch.context() as killed:
        killed.setattr(JournaledHost, "record", killed_after_start)
        with pytest.raises(Crash):
            rarms("apply", "--auto-approve")
    shown, drift = " ".join(rarms("status").out.split()), json.loads(rarms("drift", "--json").out)
    assert rarms("apply", "--auto-approve").code == 0

    assert "vision 1.2 LP 60 % of its 2 VPs running; start reservation, 0.8 LP afterwards" in shown
    assert [each["address"] for each in drift["hosts"][0]["drifted"]] == ["partition/speech"], "it is not started yet"
    assert "vision 0.8 LP 40 % of its 2 VPs running" in " ".join(rarms("status").out.split())


def test_unfinished_run_is_no_foreign_change() -> None:
    with disk.use(CrashingDisk(30)), pytest.raises(Crash):
        rarms("apply", "--auto-approve")

    status, drifted = rarms("status").out, rarms("drift")

    assert "off; not applied yet" in status, "the run was cut off once a partition was made"
    assert "changed on the host" not in status
    assert drifted.code == 5
    assert "Drift: 0 changed on the host, 2 not applied yet." in drifted.out
    assert "Its remaining steps are listed as not applied" in " ".join(drifted.err.split())


def test_rarms_alone_without_manifest_says_how_to_begin() -> None:
    Path("rarms.yaml").unlink()

    answer = rarms()

    assert answer.code == 64
    assert "Write a first manifest: `rarms init`." in answer.err


def test_status_lists_what_is_not_measured() -> None:
    Path("rarms.yaml").write_text(MANIFEST + MEASURED, encoding="utf-8")

    unmeasured = rarms("status")

    assert "Not measured: planner" in unmeasured.out
    assert "Next: `rarms measure`" in unmeasured.out


def test_damaged_host_is_unknown() -> None:
    assert rarms("apply", "--auto-approve").code == 0
    Path(".rarms/hosts/onboard.json").write_text("no host", encoding="utf-8")

    answer = rarms("status")

    assert answer.code == 1
    assert "Host onboard could not be read:" in answer.out
    assert answer.lines[-1] == "Unknown: onboard could not be read."
    assert json.loads(rarms("status", "--json").out)["unknown"] == ["onboard"]


def test_host_without_rights_keeps_no_command_from_others() -> None:
    hidden = (
        "  hidden: { provider: simulated, logical_processors: 2, memory: 4 GiB, simulated: { administrator: false } }"
    )
    assert rarms("apply", "--auto-approve").code == 0
    Path("rarms.yaml").write_text(MANIFEST.replace("components:", f"{hidden}\ncomponents:"), encoding="utf-8")

    hosts = {host["name"]: host for host in json.loads(rarms("status", "--json").out)["hosts"]}

    assert len(hosts["hidden"]["problems"]) == 1
    assert hosts["onboard"]["problems"] == []
    assert [partition["name"] for partition in hosts["onboard"]["partitions"]] == ["speech", "vision"]


def test_status_for_programs_has_partitions_with_their_components() -> None:
    assert rarms("apply", "--auto-approve").code == 0

    (host,) = json.loads(rarms("status", "--json").out)["hosts"]

    assert (host["name"], host["totals"]["capacity_lp"], host["totals"]["reserved_lp"]) == ("onboard", 1.8, 1.2)
    assert [(part["name"], part["components"], part["reserve"], part["drift"]) for part in host["partitions"]] == [
        ("speech", ["speech"], 20, None),
        ("vision", ["vision"], 40, None),
    ]


def test_history_tells_who_and_when() -> None:
    assert rarms("apply", "--auto-approve").code == 0
    assert rarms("undo", "--auto-approve").code == 0
    assert rarms("apply", "--auto-approve").code == 0

    (runs,) = json.loads(rarms("history", "--json").out)["hosts"].values()
    shown = rarms("history").out

    assert [(run["run"], run["ending"]) for run in runs] == [("apply", "done"), ("undo", "done"), ("apply", "done")]
    assert all(run["started_at"].endswith(" UTC") and "process" in run["started_by"] for run in runs)
    assert [line.split()[-1] for line in shown.splitlines()[2:]] == ["done", "done", "undone"]


def test_intruder_is_told_by_drift_and_by_plan() -> None:
    assert rarms("apply", "--auto-approve").code == 0
    assert rarms("simulate", "change", "vision", "--reserve", "11").code == 0
    assert rarms("simulate", "change", "speech", "--remove").code == 0

    drift, planned = rarms("drift"), json.loads(rarms("plan", "--json").out)

    assert drift.code == 2
    assert re.search(r"reserve +0.22 LP +0.8 LP", drift.out)
    outside = [finding["address"] for finding in planned["findings"] if finding["code"] == "RARMS311"]
    assert sorted(outside) == ["partition/speech", "partition/vision"]
    assert "Next: `rarms drift`" in rarms("status").out


def test_manifest_change_is_no_foreign_change() -> None:
    assert rarms("apply", "--auto-approve").code == 0
    Path("rarms.yaml").write_text(MANIFEST.replace("40 %", "50 %"), encoding="utf-8")

    assert json.loads(rarms("plan", "--json").out)["findings"] == []


def test_drift_needs_no_data_logs() -> None:
    assert rarms("apply", "--auto-approve").code == 0
    Path("rarms.yaml").write_text(MANIFEST + MEASURED, encoding="utf-8")
    quiet = rarms("drift")
    assert rarms("simulate", "change", "vision", "--off").code == 0
    changed = rarms("drift")

    assert (quiet.code, changed.code) == (0, 2)
    assert "The manifest was not compared: RARMS" in quiet.out
    assert re.search("vision +it was changed on the host", changed.out)


def test_drift_compares_a_manifest_whose_findings_are_accepted() -> None:
    late = MEASURED.replace("mean_response_time", "p95_response_time").replace("100 ms", "60 ms")
    accept = "busy-loop, accept: { RARMS313: { at: [component/planner], reason: known } }"
    Path("rarms.yaml").write_text(MANIFEST.replace("busy-loop", accept) + late, encoding="utf-8")
    assert rarms("measure").code == 0
    assert rarms("apply", "--auto-approve").code == 0

    drift = rarms("drift")

    assert drift.code == 0
    assert "RARMS313" in rarms("plan", "--json").out
    assert "not compared" not in drift.out


def test_undo_outdates_only_proofs_it_took_back() -> None:
    small = MANIFEST.partition("  vision:")[0] + MEASURED
    Path("rarms.yaml").write_text(small, encoding="utf-8")
    for command in (["measure"], ["apply", "--auto-approve"], ["prove", "--load-host"], ["destroy", "--auto-approve"]):
        assert rarms(*command).code == 0
    destroyed = rarms("status")
    assert rarms("undo", "--auto-approve").code == 0
    stands_again = rarms("status")
    assert rarms("simulate", "change", "planner", "--off").code == 0
    for command in (["apply", "--auto-approve"], ["prove", "--load-host"], ["undo", "--auto-approve"]):
        assert rarms(*command).code == 0
    taken_back = rarms("status")

    assert "Proven:" not in destroyed.out, "nothing is applied"
    assert "1 of 1 threshold met" in stands_again.out
    assert "planner is outdated" not in stands_again.out
    undone = json.loads(rarms("history", "--json").out)["hosts"]["onboard"][-1]["started_at"]
    assert f"planner is outdated: its layout on onboard was undone at {undone}." in " ".join(taken_back.out.split())
    page = rarms("report", "-o", "-")
    assert f"outdated: its layout on onboard was undone at {undone}" in page.out


def test_manual_partition_is_started_before_proving() -> None:
    by_hand = "partitions: { planner: { start: manual } }\n"
    Path("rarms.yaml").write_text(MANIFEST.partition("  vision:")[0] + MEASURED + by_hand, encoding="utf-8")
    for command in (["measure"], ["apply", "--auto-approve"]):
        assert rarms(*command).code == 0
    off, refused = rarms("status"), rarms("prove", "--load-host")
    assert rarms("start", "planner", "--auto-approve").code == 0

    assert "Next: `rarms start planner` starts the partitions for the proof." in off.out
    assert refused.code == 3
    assert "`rarms start planner`" in refused.err
    assert "Next: `rarms prove`" in rarms("status").out


def test_infeasible_manifest_is_planned_next() -> None:
    Path("rarms.yaml").write_text(MANIFEST.replace("40 %", "80 %"), encoding="utf-8")
    planned, answer = rarms("plan"), rarms("status")

    assert planned.code == 4
    assert "No layout: RARMS014 (Reservations exceed the platform)." in answer.out
    assert "Next: `rarms plan` shows why no layout exists, and changes that help." in answer.out
    assert [finding["code"] for finding in json.loads(rarms("status", "--json").out)["problems"]] == ["RARMS014"]


def test_missing_partition_cannot_be_simulated() -> None:
    answer = rarms("simulate", "change", "nobody", "--off")

    assert answer.code == 64
    assert 'On onboard, robot does not have the partition "nobody".' in answer.err


def test_real_host_is_not_simulated() -> None:
    real = MANIFEST.replace("provider: simulated", "provider: hyperv, connect: { ssh: somebody@nowhere.invalid }")
    Path("rarms.yaml").write_text(real, encoding="utf-8")

    answer = rarms("simulate", "change", "vision", "--off")

    assert answer.code == 64
    assert "None of the chosen hosts is simulated: onboard. Change a real host with its own tools." in answer.err


def test_the_status_says_when_thresholds_were_proven_last() -> None:
    proofs = [
        a_proof(component=name, met=met, verdict="met" if met else "missed", upper=None, reserve=40, when=when)
        for name, met, when in (
            ("vision", True, "2026-01-31T12:00:00Z"),
            ("speech", True, "2026-02-01T12:00:00Z"),
            ("logger", False, "2026-02-02T12:00:00Z"),
        )
    ]
    overview = Overview(application="robot", hosts=(), proofs=tuple(proofs), stale={}, verdicts=(), next_command=None)

    shown = " ".join(render(status_text(overview)).split())

    assert (
        "2 of 3 thresholds met with all components running under busy-loop, the first proven at "
        "2026-01-31 12:00:00 UTC, the last at 2026-02-01 12:00:00 UTC."
    ) in shown
    missed = "missed (2026-02-02 12:00:00 UTC, on onboard with 40 % of its VPs under busy-loop)."
    assert f"logger, mean_response_time at most 100 ms: {missed}" in shown


def test_unproven_robot_shows_no_foreign_proof() -> None:
    Path("rarms.yaml").write_text(MANIFEST.partition("  vision:")[0] + MEASURED, encoding="utf-8")
    for robot in ("robot-12", "robot-13"):
        Path(f"{robot}.yaml").write_text(f"application: {{ description: {robot} }}\n", encoding="utf-8")
    first = ("--overlay", "robot-12.yaml")
    assert rarms("measure", *first, "--samples", "60").code == 0
    assert rarms("apply", *first, "--auto-approve").code == 0
    assert rarms("prove", "--without-load", *first).code in {0, 4}

    own = rarms("status", *first)
    other = rarms("status", "--overlay", "robot-13.yaml")

    assert "of 1 threshold" in own.out
    assert "of 1 threshold" not in other.out


def test_runs_say_which_robot_they_were_for() -> None:
    Path("robot-12.yaml").write_text("application: { description: robot-12 }\n", encoding="utf-8")
    robot = ("--overlay", "robot-12.yaml")
    assert rarms("apply", *robot, "--auto-approve").code == 0
    assert rarms("undo", *robot, "--auto-approve").code == 0

    shown, recorded = " ".join(rarms("history", *robot).out.split()), rarms("history", *robot, "--json").out
    last = " ".join(rarms("status", *robot).out.split())

    assert shown.count("robot on robot-12") == 2
    assert [run["robot"] for run in json.loads(recorded)["hosts"]["onboard"]] == ["robot-12", "robot-12"]
    assert "on robot-12, done" in last


def test_too_few_samples_recommend_enough() -> None:
    near = MEASURED.replace("work: 5 ms", "work: 120 ms, blocked: 20 ms, varies: 40 %").replace("100 ms", "300 ms")
    near = near.replace("    memory", "    processors: 1\n    cpu: { reserve: 0.41 LP }\n    memory")
    short = MANIFEST[: MANIFEST.index("  vision")].replace("busy-loop }", "busy-loop, measuring: { proof: 20 s } }")
    Path("rarms.yaml").write_text(short + near, encoding="utf-8")
    assert rarms("apply", "--auto-approve").code == 0
    assert rarms("prove", "--load-host").code == 4

    (proof,) = json.loads(rarms("status", "--json").out)["proofs"]

    assert proof["proven"]["samples_needed"]
    assert f"Next: `rarms prove --samples {proof['proven']['samples_needed']}` runs all" in " ".join(
        rarms("status").out.split()
    )


def test_test_partitions_of_a_killed_measurement_stand_apart() -> None:
    Path("rarms.yaml").write_text(MANIFEST + MEASURED, encoding="utf-8")
    words = ("measure", "planner", "--from", "50%", "--to", "50%", "--samples", "20")
    host: dict[str, Any] = {}
    for at in range(80, 200, 10):
        with disk.use(CrashingDisk(at)), suppress(Crash):
            rarms(*words)
        status = json.loads(rarms("status", "--json").out)
        (host,) = status["hosts"]
        if sum(test["reserved_lp"] for test in host["test_partitions"]) == 2:  # P2 has what is kept for the host, too
            break

    assert [(test["name"], test["application"]) for test in host["test_partitions"]] == [
        ("rarms-p1", "robot"),
        ("rarms-p2", "robot"),
    ]
    assert (host["partitions"], host["totals"]["reserved_lp"], host["totals"]["free_lp"]) == ([], 0, 1.8)
    text = rarms("status").out
    assert "test partition, not counted" in " ".join(text.split())
    assert "Next: `rarms start`" in text


def test_a_missing_journal_is_reported() -> None:
    never_applied = (rarms("undo", "--auto-approve").code, rarms("history").out)
    assert rarms("apply", "--auto-approve").code == 0
    Path(".rarms/hosts/onboard.journal.jsonl").unlink()

    undone, history, status = rarms("undo", "--auto-approve"), rarms("history"), rarms("status")

    assert never_applied == (0, "Host onboard  no plan was applied here\n")
    missing = "The journal of onboard is missing: no run is recorded, but speech and vision have a mark of rarms."
    assert undone.code == 1
    assert "error[RARMS190]" in undone.err
    for text in (undone.err, history.out, status.out):
        assert missing in " ".join(text.split())
    assert json.loads(rarms("history", "--json").out)["unrecorded"] == {"onboard": ["speech", "vision"]}
    assert rarms("start", "vision", "--auto-approve").code == 0


@pytest.mark.parametrize("words", [("status",), ("drift",), ("graph",), ("explain", "vision")])
def test_only_a_plan_searches_for_ways_out(words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    def searched(*_: object) -> None:
        raise AssertionError

    assert rarms("apply", "--auto-approve").code == 0
    Path("rarms.yaml").write_text(MANIFEST.replace("40 %", "80 %"), encoding="utf-8")
    monkeypatch.setattr(causes, "explain_infeasibility", searched)

    answer = rarms(*words)

    assert "RARMS014" in answer.out + answer.err
    assert "`rarms plan`" in answer.out + answer.err
    assert "RARMS199" in rarms("plan").err
