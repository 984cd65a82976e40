"""`rarms undo` lists its steps, warns of values that rarms had not set, and can keep those of the manifest."""

import json
from pathlib import Path

import pytest

from rarms_iac.storage import disk
from tests.crashing import Crash, CrashingDisk
from tests.unit.cli.running import Ran, rarms
from tests.unit.cli.test_status import MANIFEST

RESTORED = "partition/vision reserve 0.8 -> 0.04 LP (40 -> 2 % of each of 2 processors)"
WARNING = "partition/vision on onboard: rarms did not set reserve 0.04 LP; the last apply set 0.8 LP."


@pytest.fixture(autouse=True)
def _a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("rarms.yaml").write_text(MANIFEST, encoding="utf-8")


def repaired(changed: str = MANIFEST) -> None:
    """An apply repaired a foreign change of vision, and did what else the changed manifest asks for."""
    assert rarms("apply", "--auto-approve").code == 0
    assert rarms("simulate", "change", "vision", "--reserve", "2").code == 0
    Path("rarms.yaml").write_text(changed, encoding="utf-8")
    assert rarms("apply", "--auto-approve").code == 0


def reserves() -> dict[str, str]:
    found = rarms("status").out.split()
    return {name: found[found.index(name) + 1] for name in ("vision", "speech")}


def said(answer: Ran) -> str:
    return " ".join(answer.err.split())


def test_undo_lists_its_steps_and_foreign_values() -> None:
    repaired()

    undone = rarms("undo", "--auto-approve")

    assert undone.code == 0
    assert RESTORED in said(undone)
    assert undone.err.count("RARMS402") == 1
    assert WARNING in said(undone)
    assert "To keep 0.8 LP, run `rarms undo --keep` instead." in said(undone)
    assert reserves()["vision"] == "0.04"


def test_own_values_are_no_foreign_ones() -> None:
    assert rarms("apply", "--auto-approve").code == 0
    Path("rarms.yaml").write_text(MANIFEST.replace("reserve: 40 %", "reserve: 50 %"), encoding="utf-8")
    assert rarms("apply", "--auto-approve").code == 0

    undone = rarms("undo", "--auto-approve")

    assert "reserve 1 -> 0.8 LP" in said(undone)
    assert "RARMS402" not in undone.err


def test_keep_leaves_what_the_apply_repaired() -> None:
    repaired(MANIFEST.replace("reserve: 20 %", "reserve: 30 %"))

    kept = rarms("undo", "--keep", "--auto-approve")

    assert kept.code == 0
    assert "partition/vision stays as applied" in said(kept)
    assert "RARMS402" not in kept.err
    assert reserves() == {"vision": "0.8", "speech": "0.4"}


@pytest.mark.parametrize(
    ("typed", "code", "vision"), [("keep\n", 0, "0.8"), ("yes\n", 0, "0.04"), ("k\n", 3, "0.8"), ("\n", 3, "0.8")]
)
def test_question_offers_to_keep(typed: str, code: int, vision: str) -> None:
    repaired()

    asked = rarms("undo", stdin=typed, at_a_terminal=True)

    assert "`keep` undoes it but keeps the values of the manifest. Type `yes` or `keep`:" in said(asked)
    assert (asked.code, reserves()["vision"]) == (code, vision)


def test_only_the_setting_that_others_changed_is_named() -> None:
    repaired(MANIFEST.replace("criticality: 9, memory: 512 MiB", "criticality: 9, memory: 640 MiB"))

    undone = rarms("undo", "--auto-approve")

    assert undone.err.count("RARMS402") == 1
    assert WARNING in said(undone)


def test_keep_is_refused_where_another_needs_the_room() -> None:
    Path("rarms.yaml").write_text(MANIFEST.replace("reserve: 20 %", "reserve: 50 %"), encoding="utf-8")
    repaired(MANIFEST)

    refused = rarms("undo", "--keep", "--auto-approve")

    assert refused.code == 64
    assert "partition/speech may need the capacity that partition/vision would keep" in said(refused)
    assert "Run `rarms undo`, then `rarms apply`" in said(refused)
    assert [rarms(command, "--auto-approve").code for command in ("undo", "apply")] == [0, 0]
    assert reserves()["vision"] == "0.8"


def test_steps_that_are_left_of_undo_are_listed() -> None:
    repaired(MANIFEST.replace("reserve: 20 %", "reserve: 30 %"))
    with disk.use(CrashingDisk(12)), pytest.raises(Crash):
        rarms("undo", "--auto-approve")

    finished = rarms("undo", "--auto-approve", "--json")

    assert finished.code == 0
    assert "The last change is undone first" in said(finished)
    assert "0.04 -> 0.8" not in said(finished), "that would be the undo of the undo"
    assert json.loads(finished.lines[-1])["ending"] == "done"


def test_limit_of_a_new_partition_is_shown() -> None:
    Path("rarms.yaml").write_text(MANIFEST.replace("reserve: 40 %", "reserve: 40 %, limit: 50 %"), encoding="utf-8")

    assert "0.8 LP 512 MiB limit 1 LP" in " ".join(rarms("plan").out.split())


@pytest.mark.parametrize(
    ("partitions", "limits", "reason"),
    [
        ("", ("2 LP", ""), "the partition vision has 2 VPs and can use no more than 2 LP"),
        ("components: [vision, speech]", ("1 LP", ""), "it shares the partition front with speech without a limit"),
        ("components: [vision, speech], cpu: { limit: 1.5 LP }", ("1 LP", ""), "the partition front has its own limit"),
        ("components: [vision, speech]", ("1 LP", "0.5 LP"), ""),
        ("", ("1 LP", ""), ""),
    ],
)
def test_limit_without_effect_is_a_note(partitions: str, limits: tuple[str, str], reason: str) -> None:
    text = MANIFEST
    for fixed, limit in zip(("reserve: 40 %", "reserve: 20 %"), limits, strict=True):
        text = text.replace(fixed, f"{fixed}, limit: {limit}" if limit else fixed)
    text += f"partitions: {{ front: {{ {partitions} }} }}\n" if partitions else ""
    Path("rarms.yaml").write_text(text, encoding="utf-8")

    planned = rarms("plan", "--verbose")

    assert planned.code == 0
    assert ("note[RARMS401]" in planned.out) is bool(reason)
    assert reason in " ".join(planned.out.split())
