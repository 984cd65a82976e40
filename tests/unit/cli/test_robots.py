"""With overlays, a mark names the robot that its partition was made for, and no other robot changes it."""

import json
import shutil
from pathlib import Path

import pytest

from tests.unit.cli.running import rarms
from tests.unit.cli.test_status import MANIFEST


@pytest.fixture(autouse=True)
def _fleet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    for robot in ("robot-7", "robot-8"):
        Path(f"{robot}.yaml").write_text(f"application: {{ description: {robot} }}\n", encoding="utf-8")


def _state(robot: str) -> Path:
    return next(path for path in Path(".rarms").rglob("*.json") if robot in path.parent.name)


def _journal(robot: str) -> Path:
    return next(path for path in Path(".rarms").rglob("*.journal.jsonl") if robot in path.parent.name)


def _overlay(name: str) -> tuple[str, str]:
    return "--overlay", f"{name}.yaml"


def test_mark_names_robot_and_next_plan_is_empty() -> None:
    assert rarms("apply", *_overlay("robot-7"), "--auto-approve").code == 0

    notes = [machine["notes"] for machine in json.loads(_state("robot-7").read_text())["machines"].values()]

    assert notes
    assert all(" robot=robot-7" in text for text in notes)
    assert "No changes" in rarms("plan", *_overlay("robot-7")).out
    assert json.loads(_journal("robot-7").read_text().partition("\n")[0])["robot"] == "robot-7"


def test_a_plan_file_knows_its_overlays() -> None:
    made = rarms("plan", *_overlay("robot-7"), "--out", "made.plan")

    assert "Overlay: robot-7.yaml\n" in made.err
    assert "Apply it with: rarms apply made.plan --overlay robot-7.yaml\n" in made.err
    assert "from rarms.yaml with robot-7.yaml" in rarms("show", "made.plan").out

    done = rarms("apply", "made.plan", *_overlay("robot-7"))
    again = rarms("apply", "made.plan")

    assert (done.code, again.code) == (0, 3)
    for answer in (done, again):
        assert "Overlay: robot-7.yaml\n" in answer.err
        assert "RARMS371" not in answer.err
    assert "--overlay robot-7.yaml`" in " ".join(again.err.split())


def test_a_changed_overlay_of_a_plan_is_noted() -> None:
    rarms("plan", *_overlay("robot-7"), "--out", "made.plan")
    Path("robot-7.yaml").write_text("application: { description: other }\n", encoding="utf-8")

    done = rarms("apply", "made.plan")

    assert done.code == 0
    assert "rarms.yaml or robot-7.yaml has changed" in " ".join(done.err.split())
    assert "rarms plan --overlay robot-7.yaml" in " ".join(done.err.split())


def test_forged_overlay_cannot_switch_off_the_key() -> None:
    Path("robot-7.yaml").write_text("policy: { signed_plans: false }\n", encoding="utf-8")
    rarms("plan", *_overlay("robot-7"), "--out", "made.plan")
    demanding = MANIFEST.replace("policy: {", "policy: { signed_plans: true,")
    Path("rarms.yaml").write_text(demanding, encoding="utf-8")

    assert rarms("apply", "made.plan").code == 3


@pytest.mark.parametrize("command", ["plan", "apply --auto-approve", "destroy --auto-approve", "stop --auto-approve"])
def test_partition_of_another_robot_is_refused(command: str) -> None:
    for robot in ("robot-7", "robot-8"):
        assert rarms("apply", *_overlay(robot), "--auto-approve").code == 0
    shutil.copy(_state("robot-7"), _state("robot-8"))
    before = _state("robot-8").read_bytes()

    answer = rarms(*command.split(), *_overlay("robot-8"))

    assert answer.code not in {0, 2}
    assert "RARMS340" in answer.err + answer.out
    assert 'has the mark of the robot "robot-7"' in " ".join((answer.err + answer.out).split())
    assert _state("robot-8").read_bytes() == before


def test_run_of_another_robot_is_not_taken_back() -> None:
    for robot in ("robot-7", "robot-8"):
        assert rarms("apply", *_overlay(robot), "--auto-approve").code == 0
    shutil.copy(_state("robot-7"), _state("robot-8"))
    shutil.copy(_journal("robot-7"), _journal("robot-8"))

    answer = rarms("undo", *_overlay("robot-8"), "--auto-approve")

    assert answer.code == 3
    assert 'of the robot "robot-7"' in " ".join(answer.err.split())
    assert "Use that robot's overlay, robot-7.yaml, as the last overlay." in " ".join(answer.err.split())


def test_a_mark_without_a_robot_is_taken_over() -> None:
    assert rarms("apply", "--auto-approve").code == 0
    assert rarms("apply", *_overlay("robot-7"), "--auto-approve").code == 0
    shutil.copy(Path(".rarms/hosts/onboard.json"), _state("robot-7"))

    plan = rarms("plan", *_overlay("robot-7"), "--verbose")

    assert 'its mark does not name the robot "robot-7"' in plan.out
    assert rarms("apply", *_overlay("robot-7"), "--auto-approve").code == 0
    assert " robot=robot-7" in _state("robot-7").read_text()


def test_overlay_with_impossible_name_is_refused() -> None:
    Path("robot-7.yaml").rename("Robot_7.yaml")

    answer = rarms("validate", *_overlay("Robot_7"))

    assert answer.code == 2
    assert "RARMS017" in answer.err + answer.out
    assert "robot-7" in answer.err + answer.out


def test_missing_overlay_is_refused_and_names_no_robot() -> None:
    answer = rarms("plan", *_overlay("missing"))

    assert (answer.code, answer.out) == (64, "")
    assert answer.err.startswith("error[RARMS001]")
