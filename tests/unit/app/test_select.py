import json
import re
from pathlib import Path

import pytest

from rarms_iac.storage.datalog.decisions import Chosen, read_entries
from rarms_iac.storage.datalog.files import configuration_path
from tests.builders_measured import a_setting
from tests.measuring import add_setting, leave_log, steady
from tests.unit.app.test_data_logs import MEANS, edit, here, measure
from tests.unit.cli.running import rarms
from tests.unit.views.test_json import check

__all__ = ["here"]


def manifest(folder: Path) -> str:
    return (folder / "rarms.yaml").read_text(encoding="utf-8")


def test_level_is_written_and_reservation_follows(here: Path) -> None:
    measure(here, MEANS)
    before = manifest(here)

    answer = rarms("select", "vision", "--at", "110 ms", "-f", str(here))

    assert answer.code == 0, answer.err
    assert answer.lines == [
        "vision: mean_response_time at most 100 ms -> at most 110 ms",
        "  partition  reservation                 CR  measured                    load",
        "  vision         1.22 LP  61 % of its 2 VPs  105 ms (104.5 to 105.5 ms)  busy-loop",
        "  Headroom of onboard: 0.78 LP of 2 LP.",
    ]
    assert manifest(here) == before.replace("at_most: 100 ms", "at_most: 110 ms")
    (entry,) = read_entries(configuration_path(here, "two-core", "vision"))
    assert isinstance(entry, Chosen)
    assert (entry.apt, entry.reserve) == ({"mean_response_time": "at most 110 ms"}, 61)
    assert "1.22 LP" in rarms("plan", "-f", str(here)).out


def test_level_met_by_lowest_setting_advises_lower(here: Path) -> None:
    measure(here, MEANS)
    hint = "No lower reservation of vision was measured under busy-loop. `rarms measure -f"

    tried = rarms("select", "vision", "--at", "750 ms", "--dry-run", "-f", str(here))
    lowest = rarms("select", "vision", "--at", "750 ms", "-f", str(here))
    higher = rarms("select", "vision", "--at", "170 ms", "-f", str(here))

    assert [hint in answer.out for answer in (tried, lowest, higher)] == [False, True, False]


def test_unreachable_level_writes_nothing(here: Path) -> None:
    measure(here, MEANS)
    before = manifest(here)

    answer = rarms("select", "vision", "--at", "50 ms", "-f", str(here))

    assert answer.code == 4
    assert "error[RARMS106]" in answer.err
    assert manifest(here) == before


def test_measured_maximum_advises_easier_level(here: Path) -> None:
    measure(here, {**MEANS, 100: 86.0})

    answer = " ".join(rarms("select", "vision", "--at", "50 ms", "-f", str(here)).err.split())

    assert "holds with 100 % of its VPs under each load. The component can have at most 100 % of its VPs." in answer
    assert "rarms measure" not in answer


def test_easier_level_holds_for_every_load(here: Path) -> None:
    edit(here / "rarms.yaml", "hosts:", "policy: { interference: [busy-loop, bursts-20] }\n\nhosts:")
    log = measure(here, MEANS)
    add_setting(log, a_setting(100, steady("vision", 75.0)))

    hopeless = " ".join(rarms("select", "vision", "--at", "70 ms", "-f", str(here)).err.split())
    unmeasured = " ".join(rarms("select", "vision", "--at", "80 ms", "-f", str(here)).err.split())

    level = "Choose an easier level: 88.4 ms holds with 70 % of its VPs under each load."
    assert f"{level} The component can have at most 100 % of its VPs" in hopeless
    assert "88.4 ms holds with 70 % of its VPs under each load. Or measure higher settings" in unmeasured
    assert "The highest setting is 70 % of its VPs with bursts-20, and 100 % with busy-loop." in unmeasured
    assert "rarms measure vision --from 71% --to 100%" in unmeasured
    assert rarms("select", "vision", "--at", "88.4 ms", "-f", str(here)).code == 0


def test_missing_load_is_named(here: Path) -> None:
    edit(here / "rarms.yaml", "hosts:", "policy: { interference: [bursts-20, busy-loop] }\n\nhosts:")
    busy = leave_log(here, ["vision"], [a_setting(62, steady("vision", 90.0))]).with_name("busy-loop.jsonl")
    add_setting(busy, a_setting(61, steady("vision", 120.0)))

    selected = rarms("select", "vision", "--at", "95 ms", "-f", str(here)).out
    explained = " ".join(rarms("explain", "vision", "-f", str(here)).out.split())

    assert re.search(r"90 ms \(.*\)  busy-loop", selected)
    assert "No lower reservation" not in selected
    assert "load busy-loop needs the most; bursts-20 need no more" in explained
    assert "mean_response_time at 61 % of its 2 VPs 120 ms, at worst " in explained


@pytest.mark.parametrize(("at", "meant"), [("110 s", "Did you mean 110 ms?"), ("2 h", "")])
def test_absurd_level_is_a_slip(here: Path, at: str, meant: str) -> None:
    measure(here, MEANS)
    before = manifest(here)

    answer = rarms("select", "vision", "--at", at, "-f", str(here))
    message = " ".join(answer.err.split())

    assert (answer.code, manifest(here)) == (64, before)
    assert f"{at} is far outside the measured range of mean_response_time, 88 ms to 700 ms." in message
    assert meant in message
    assert ("Did you mean" in message) == bool(meant)
    assert rarms("select", "vision", "--at", "1.5 s", "-f", str(here)).code == 0, "easier than all is not a slip"


def test_a_dry_run_writes_nothing(here: Path) -> None:
    measure(here, MEANS)
    before = manifest(here)

    answer = rarms("select", "vision", "--at", "110 ms", "--dry-run", "-f", str(here))

    assert (answer.code, manifest(here)) == (0, before)
    assert "61 %" in answer.out
    assert "Nothing was written." in answer.err


def test_programs_read_the_same(here: Path) -> None:
    measure(here, MEANS)

    answer = rarms("select", "vision", "--at", "110 ms", "--json", "-f", str(here))

    check(answer.out)
    document = json.loads(answer.out)
    assert (document["kind"], document["before"], document["after"], document["unit"]) == (
        "selection",
        {"at_most": 100.0},
        {"at_most": 110.0},
        "ms",
    )
    assert document["file"]
    assert document["levels"][0]["reserve"] == 61
    assert {name: (each["free_lp"], each["host_lp"]) for name, each in document["totals"].items()} == {
        "onboard": (0.78, 2)
    }


def test_overlay_that_says_level_is_what_is_changed(here: Path) -> None:
    measure(here, MEANS)
    overlay = here / "robot-7.yaml"
    overlay.write_text(
        "components:\n  vision:\n    apt:\n      mean_response_time: { at_most: 120 ms }  # seven\n",
        encoding="utf-8",
        newline="\r\n",
    )
    before = manifest(here)

    answer = rarms("select", "vision", "--at", "110 ms", "-f", str(here), "--overlay", str(overlay))

    assert answer.code == 0, answer.err
    assert manifest(here) == before
    assert overlay.read_bytes().decode().splitlines()[-1] == "      mean_response_time: { at_most: 110 ms }  # seven"
    assert b"\r\n" in overlay.read_bytes()


def test_an_index_without_threshold_gets_one(here: Path) -> None:
    measure(here, MEANS)

    assert rarms("fmt", str(here)).code == 0
    several = rarms("select", "vision", "--at", "150 ms", "--index", "p95_response_time", "-f", str(here))
    again = rarms("select", "vision", "--at", "150 ms", "-f", str(here))

    assert several.code == 0, several.err
    assert "p95_response_time none -> at most 150 ms" in several.out
    assert "p95_response_time: { at_most: 150 ms }" in manifest(here)
    assert rarms("fmt", "--check", str(here)).code == 0
    assert again.code == 64
    assert "--index mean_response_time, --index p95_response_time" in " ".join(again.err.split())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["visoin", "--at", "90 ms"], 'Did you mean "vision"?'),
        (["vision", "--at", "90"], "not a number with the unit us, ms, s, min or h"),
        (["vision", "--at", "90 %"], "not a number with the unit us, ms, s, min or h"),
        (["vision", "--at", "90 ms", "--index", "speed"], "is unknown"),
    ],
)
def test_what_is_unclear_is_asked_back(here: Path, words: list[str], message: str) -> None:
    answer = rarms("select", *words, "-f", str(here))

    assert answer.code == 64
    assert message in " ".join(answer.err.split())


def test_fixed_reserve_does_not_follow_and_says_so(here: Path) -> None:
    edit(here / "rarms.yaml", "    memory: 512 MiB\n", "    memory: 512 MiB\n    cpu: { reserve: 40 % }\n")

    answer = rarms("select", "vision", "--at", "90 ms", "-f", str(here))

    assert answer.code == 0
    assert "The manifest fixes the reservation." in answer.out
    assert "at_most: 90 ms" in manifest(here)
