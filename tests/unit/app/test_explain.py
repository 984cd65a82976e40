"""`rarms explain COMPONENT`, from manifest and data logs to rows and exit code."""

import json
from dataclasses import replace
from pathlib import Path

from rarms_iac.storage.datalog.decisions import TrailSetting, TunedPartition, append_run, tuning_path
from tests.builders_measured import TUNED, a_setting
from tests.measuring import leave_log, steady
from tests.unit.app.test_data_logs import MEANS, edit, here, measure
from tests.unit.cli.running import rarms
from tests.unit.views.test_json import check

__all__ = ["here"]

SECOND_HOST = """\
  workshop:
    provider: simulated
    platform: two-core
    logical_processors: 2
    memory: 256 MiB

components:
"""


def rows(folder: Path, name: str, code: int = 0) -> dict[str, str]:
    """Value and source by name; the terminal shows each of them, too."""
    shown = rarms("explain", name, "-f", str(folder))
    answer = rarms("explain", name, "--json", "-f", str(folder))
    assert (answer.code, shown.code) == (code, code), answer.err
    check(answer.out)
    found = json.loads(answer.out)["rows"]
    words = set(shown.out.split())
    assert all({*" ".join(row.values()).split()} <= words for row in found)
    return {row["name"]: f"{row['value']} ({row['source']})" if row["source"] else row["value"] for row in found}


def test_rows_lead_from_the_threshold_to_the_reserve(here: Path) -> None:
    measure(here, MEANS)
    edit(here / "rarms.yaml", "components:\n", SECOND_HOST)

    assert rows(here, "vision") == {
        "mean_response_time": "at most 100 ms (manifest)",
        "data log": "measurements/two-core/vision/busy-loop.jsonl (6 settings, 2026-01-01T00:00:00Z)",
        "measured on": "simulated, 2 LP without SMT (simulated, scheduler classic, build 26100)",
        "load": "busy-loop (needs the most; bursts-20 and bursts-100 need no more)",
        "mean_response_time at 62 % of its 2 VPs": "97 ms, at worst 97.4 ms: met (2000 samples)",
        "mean_response_time at 61 % of its 2 VPs": "105 ms, at worst 105.5 ms: missed (2000 samples)",
        "reservation": "1.24 LP (62 % of onboard) (the smallest whole per cent of its VPs that meets every threshold)",
        "reserve": "1.24 LP (62 % of its 2 VPs) (whole per cent of its VPs: not rounded)",
        "partition": "vision (alone)",
        "processors": "2 virtual processors (all processors of the host; their use is not measured yet)",
        "memory": "512 MiB (manifest)",
        "limit": "2 LP (100 % of its 2 VPs) (no limit: a limit would make its measurements invalid)",
        "weight": "3000 (policy.headroom is by_criticality: 100 times the criticality 30, within 100 to 10000)",
        "host": (
            "onboard (The placement is optimal: no other placement reserves less, or moves fewer partitions with the "
            "same reservation.)"
        ),
        "free on onboard": "0.76 LP of 2 LP",
        "other compounds": "none (`rarms tune` has measured nothing on two-core)",
        "on workshop": "1.24 LP (no room)",
    }


def test_fixed_reserve_that_does_not_fit_has_errors(here: Path) -> None:
    fixed = "    memory: 512 MiB\n    cpu: { reserve: 1.25 LP }\n    processors: 2\n"
    edit(here / "rarms.yaml", "    memory: 512 MiB\n", fixed)
    speech = "  speech:\n    criticality: 10\n    memory: 64 MiB\n    cpu: { reserve: 60 % }\n  vision:\n"
    edit(here / "rarms.yaml", "  vision:\n", speech)

    found = rows(here, "vision", 4)

    assert found["reservation"] == "1.25 LP (62.5 % of onboard) (manifest: vision)"
    assert found["reserve"] == "1.26 LP (63 % of its 2 VPs) (whole per cent of its VPs: rounded up by 0.01 LP)"
    assert found["host"] == "onboard (not planned until there is a layout)"
    assert found["other compounds"] == "none (its reservation is not measured)"
    assert rarms("explain", "vision", "-f", str(here)).err.count("error[RARMS014]") == 1


def test_tuning_is_next_where_nothing_fits(here: Path) -> None:
    assert "Next:" not in rarms("explain", "vision", "-f", str(here)).out
    measure(here, MEANS)
    assert "Next:" not in rarms("explain", "vision", "-f", str(here)).out

    speech = "  speech:\n    criticality: 10\n    memory: 64 MiB\n    cpu: { reserve: 60 % }\n  vision:\n"
    edit(here / "rarms.yaml", "  vision:\n", speech)

    assert "\nNext: `rarms tune " in rarms("explain", "vision", "-f", str(here)).out


def test_who_shares_partition_is_named_with_reason(here: Path) -> None:
    speech = "  speech:\n    criticality: 10\n    memory: 64 MiB\n    together: [vision]\n  vision:\n"
    edit(here / "rarms.yaml", "  vision:\n", speech)
    leave_log(here, ["speech", "vision"], [])
    edit(here / "rarms.yaml", "    memory: 512 MiB\n", "    memory: 512 MiB\n    cpu: { reserve: 40 % }\n")

    found = rows(here, "speech")

    assert found["threshold"] == "none (manifest)"
    assert found["mean_response_time of vision"] == "at most 100 ms (manifest)"
    assert found["partition"] == "vision (with vision (criticality 30))"
    assert found["together"] == "speech with vision (manifest: speech)"


def test_partition_by_hand_fixes_reserve_and_its_members(here: Path) -> None:
    speech = "  speech:\n    criticality: 10\n    memory: 64 MiB\n    cpu: { reserve: 45 % }\n  vision:\n"
    edit(here / "rarms.yaml", "  vision:\n", speech)
    measure(here, MEANS)
    manifest = (here / "rarms.yaml").read_text(encoding="utf-8")
    both = "\npartitions:\n  vision: { components: [vision, speech], cpu: { reserve: 70 % } }\n"
    (here / "rarms.yaml").write_text(manifest + both, encoding="utf-8", newline="\n")

    found = rows(here, "speech")

    assert found["reservation"] == "1.4 LP (70 % of onboard) (manifest: partition vision)"
    assert found["combined"] == "by hand (manifest: partitions; not written by a recorded tuning)"


def test_explain_of_unknown_word_suggests_one(here: Path) -> None:
    for word, meant in (("visoin", "vision"), ("RAMS014", "RARMS014")):
        unknown = rarms("explain", word, "-f", str(here))
        message = f'"{word}" is neither a component nor a finding. Did you mean "{meant}"? Components: vision.'
        assert unknown.code == 64
        assert message in " ".join(unknown.err.split())


def test_component_without_log_has_known_rows(here: Path) -> None:
    found = rows(here, "vision", 4)

    assert found["mean_response_time"] == "at most 100 ms (manifest)"
    assert found["data log"].startswith("none (vision is not measured on two-core with busy-loop yet")
    assert found["reservation"] == "not known (not measured)"
    assert (found["partition"], found["processors"]) == ("vision (alone)", "2 virtual processors")
    assert found["host"] == "onboard (not planned until its reservation is known)"
    assert found["other compounds"] == "none (`rarms tune` has measured nothing on two-core)"
    assert rarms("explain", "vision", "-f", str(here)).err.count("RARMS100") == 1


def test_unmet_apt_shows_the_best_setting(here: Path) -> None:
    measure(here, {90: 180.0, 100: 150.0})

    found = rows(here, "vision", 4)

    assert found["mean_response_time at 100 % of its 2 VPs"].startswith("150 ms, at worst ")
    assert ": missed (" in found["mean_response_time at 100 % of its 2 VPs"]
    assert found["reservation"] == "not known (no measured setting is enough)"


def test_a_maximum_is_met_so_far(here: Path) -> None:
    edit(here / "rarms.yaml", "mean_response_time", "maximum_response_time")
    measure(here, MEANS)

    found = rows(here, "vision")["maximum_response_time at 62 % of its 2 VPs"]

    assert "of the jobs may lie beyond it: met so far" in found
    assert "at worst" not in found


def test_fixed_reserve_is_compared_with_its_data_log(here: Path) -> None:
    measure(here, MEANS)
    edit(here / "rarms.yaml", "    memory: 512 MiB\n", "    memory: 512 MiB\n    cpu: { reserve: 70 % }\n")

    found = rows(here, "vision")

    assert found["least reservation"] == "1.24 LP (62 % of onboard) (data log; the manifest fixes the reserve)"
    assert found["reservation"] == "1.4 LP (70 % of onboard) (manifest: vision)"
    assert found["data log"].endswith("vision/busy-loop.jsonl (6 settings, 2026-01-01T00:00:00Z, not used)")


def test_explain_without_reservation_and_on_the_host(here: Path) -> None:
    more = "  logging: { criticality: 1, memory: 64 MiB }\n"
    more += "  driver: { criticality: 2, runs_on: host, task: MotionControl }\n  vision:\n"
    edit(here / "rarms.yaml", "  vision:\n", more)
    measure(here, MEANS)

    assert rows(here, "logging")["reservation"] == "none (not set)"
    assert rows(here, "driver") == {
        "threshold": "none (manifest)",
        "host": "onboard (manifest: runs_on: host)",
        "reservation": "none (only partitions have a reservation; it is not measured)",
        "task class": "MotionControl (manifest)",
        "kept on onboard": "0 LP (keep_for_host)",
    }
    assert rarms("explain", "driver", "--guide", "-f", str(here)).code == 64


def test_setting_without_verdict_is_not_unmeasured(here: Path) -> None:
    unsteady = replace(
        steady("vision", 97.0), samples=(*steady("vision", 20.0).samples, *steady("vision", 90.0).samples)
    )
    settings = [a_setting(61, unsteady), *(a_setting(at, steady("vision", MEANS[at])) for at in (62, 70))]
    leave_log(here, ["vision"], settings)

    found = rows(here, "vision")

    assert found["61 % of its 2 VPs"] == "measured, without a verdict (data log)"
    assert found["no verdict at"] == "61 % of its VPs (no steady state, or too few answers)"


def test_tuned_and_rejected_compounds_are_rows(here: Path) -> None:
    speech = (
        "  speech:\n    criticality: 10\n    memory: 64 MiB\n    apt: { mean_response_time: { at_most: 100 ms } }\n"
    )
    edit(here / "rarms.yaml", "  vision:\n", f"{speech}    simulation: {{ work: 9 ms }}\n  vision:\n")
    edit(
        here / "rarms.yaml", "components:\n", "partitions:\n  vision: { components: [vision, speech] }\n\ncomponents:\n"
    )
    leave_log(
        here, ["speech", "vision"], [a_setting(at, steady("speech", 20.0), steady("vision", MEANS[at])) for at in MEANS]
    )
    both = TunedPartition(name="vision", components=("vision", "speech"), processors=2, reserve=62, parts=150)
    run = replace(
        TUNED,
        when="2026-11-21T23:04:31Z",
        before=250,
        after=124,
        partitions=(both,),
        trail=(
            TrailSetting(components=("speech", "vision"), reserve=62, worse=()),
            TrailSetting(components=("driver", "speech"), reserve=50, worse=()),
            TrailSetting(components=("driver", "speech"), reserve=40, worse=("driver",)),
        ),
    )
    by_hand = rows(here, "speech")
    append_run(tuning_path(here, "two-core"), run)
    tuned = rows(here, "speech")

    assert by_hand["combined"].startswith("by hand")
    assert tuned["combined"] == (
        "1.24 LP (62 % of its VPs) instead of 1.5 LP apart (manifest: partitions; tuning, "
        "2026-11-21T23:04:31Z, by the default strategy, proved to be the best)"
    )
    assert tuned["driver+speech"] == (
        "50 % of its VPs is enough; 40 % is not enough for driver (rejected by tuning; outdated: driver "
        "was removed from the manifest)"
    )
    assert "speech+vision" not in tuned
    page = rarms("report", "-f", str(here), "--text").out
    assert "speech+vision is outdated" not in page
    edit(here / "rarms.yaml", "work: 9 ms", "work: 10 ms")
    page = rarms("report", "-f", str(here), "--text").out
    assert "speech+vision is outdated: " in " ".join(page.split())
    assert "vision, speech (outdated)" in " ".join(page.split())


RUNNING = """\
schema: rarms/v1
application: { name: robot }
hosts:
  h1: { logical_processors: 2, memory: 8 GiB }
  h2: { logical_processors: 2, memory: 8 GiB }
components:
  a: { criticality: 9, cpu: { reserve: 50 % } }
  b: { criticality: 8, cpu: { reserve: 40 % } }
"""


def test_explain_says_what_the_plan_says(tmp_path: Path) -> None:
    manifest = tmp_path / "rarms.yaml"
    manifest.write_text(RUNNING, encoding="utf-8", newline="\n")
    assert rarms("apply", "--auto-approve", "-f", str(tmp_path)).code == 0

    there = rows(tmp_path, "b")
    edit(manifest, "reserve: 40 %", "reserve: 60 %")
    too_much = rows(tmp_path, "b", 4)
    edit(manifest, "hosts:\n", "policy: { max_disruption: removal }\nhosts:\n")
    moved = rows(tmp_path, "b")

    stays = "it stays on h1: policy.max_disruption does not allow a removal"
    assert there["host"] == too_much["host"] == f"h1 ({stays})"
    assert (there["on h2"], too_much["on h2"]) == (f"0.8 LP ({stays})", f"1.2 LP ({stays})")
    assert moved["host"] == "h2 (it is on h1 now; apply recreates it on h2)"


def test_guide_says_what_to_set_in_order(here: Path) -> None:
    measure(here, MEANS)
    edit(here / "rarms.yaml", "    memory: 512 MiB\n", "    memory: 512 MiB\n    task: ObjectIdentification\n")
    measure(here, MEANS)

    answer = rarms("explain", "vision", "--guide", "-f", str(here))

    assert answer.code == 0, answer.err
    hyperv = [answer.out.index(word) for word in ("Stop-VM", "-ProcessorCount 2", "-Reserve 62", "Start-VM")]
    assert hyperv == sorted(hyperv)
    assert "`Priority = " in answer.out
    assert "`Scheduling Category = Medium (sz)`" in answer.out
    assert 'AvSetMmThreadCharacteristics("ObjectIdentification")' in answer.out
    assert "echo 124 > /sys/fs/cgroup/rarms.slice/vision/cpu.weight" in answer.out
    assert "exec python3 vision.py" in answer.out
    assert "mean_response_time at most 100 ms" in answer.out
    assert "\n4. Set the reservation: `Hyper-V\\Set-VMProcessor -VMName 'vision' -Reserve 62 -Maximum 100" in answer.out


def test_fixed_reserve_and_limit_have_guide_too(here: Path) -> None:
    edit(here / "rarms.yaml", "    memory: 512 MiB\n", "    memory: 512 MiB\n    cpu: { reserve: 40 %, limit: 50 % }\n")

    answer = rarms("explain", "vision", "--guide", "-f", str(here))
    facts = rarms("explain", "vision", "--guide", "--json", "-f", str(here)).out

    check(facts)
    given = json.loads(facts)["settings"]
    assert (given["reserve"], given["limit"]) == (40, 50)
    assert "fixed in the manifest" in answer.out
    assert "echo '10000 10000'" in answer.out, "half of two processors in each period of a tenth of 100 ms"
    assert "No action is needed" in answer.out


def test_no_guide_without_log_or_component(here: Path) -> None:
    assert rarms("explain", "vision", "--guide", "-f", str(here)).code == 4
    unknown = rarms("explain", "visoin", "--guide", "-f", str(here))
    assert unknown.code == 64
    assert 'Did you mean "vision"?' in " ".join(unknown.err.split())


def test_guide_without_program_invents_no_words(here: Path) -> None:
    program = "    run:\n      command: [python3, vision.py]\n      until: { samples: 200 }\n"
    edit(here / "rarms.yaml", program, "    processors: 1\n    cpu: { reserve: 40 % }\n")

    answer = rarms("explain", "vision", "--guide", "-f", str(here))

    assert "gets 0.8 LP (80 % of its 1 VP), " in answer.out
    assert "configure vision to start with Windows.\n" in answer.out
    assert "exec COMMAND'`, with the command of vision for COMMAND.\n" in answer.out
