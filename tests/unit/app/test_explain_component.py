"""`rarms explain COMPONENT`, from manifest and data logs to text and exit code."""

from dataclasses import replace
from pathlib import Path

from rarms_iac.app.explain_component import explain_component
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import ManifestSource
from rarms_iac.storage.datalog.decisions import TrailSetting, TunedPartition, append_run, tuning_path
from rarms_iac.views.explanation_steps import explanation_steps
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


def test_a_walk_leads_from_the_apt_to_the_per_cent(here: Path) -> None:
    measure(here, MEANS)
    edit(here / "rarms.yaml", "components:\n", SECOND_HOST)

    answer = rarms("explain", "vision", "-f", str(here))

    assert answer.code == 0, answer.err
    said = " ".join(answer.out.split())
    for part in (
        "mean_response_time at most 100 ms",
        "measurements/two-core/vision/busy-loop.jsonl, 6 settings, measured 2026-01-01T00:00:00Z",
        "at 62 % of its 2 VPs beside busy-loop: mean_response_time 97 ms",
        "1.24 LP (62 % of its 2 VPs): the least whole per cent of its processors",
        "1.24 LP, 62 % of onboard",
        "1.24 LP (62 % of its 2 VPs): whole per cent are the provider's grain, nothing is lost",
        "headroom: 0.76 LP (38 % of onboard)",
        "limit 2 LP (100 % of its 2 VPs): left open: a cap would falsify what was measured",
        "weight 3000: policy.headroom is by_criticality: 100 times the criticality 30, within 100 to 10000",
        "one less, 61 % of its 2 VPs beside busy-loop: mean_response_time 105 ms (measured)",
        "on workshop: it would reserve 1.24 LP there too; it does not fit",
    ):
        assert part in said


def test_a_fixed_reserve_that_does_not_fit_is_walked_to_its_end(here: Path) -> None:
    fixed = "    memory: 512 MiB\n    cpu: { reserve: 1.25 LP }\n    processors: 2\n"
    edit(here / "rarms.yaml", "    memory: 512 MiB\n", fixed)
    speech = "  speech:\n    criticality: 10\n    memory: 64 MiB\n    cpu: { reserve: 60 % }\n  vision:\n"
    edit(here / "rarms.yaml", "  vision:\n", speech)

    answer = rarms("explain", "vision", "-f", str(here))

    assert answer.code == 4
    said = " ".join(answer.out.split())
    assert "none is needed: the manifest, for vision, fixes the reserve" in said
    assert "1.26 LP (63 % of its 2 VPs): whole per cent are the provider's grain, rounded up" in said
    assert "rounded up by 0.01 LP" in said
    assert "weight 3000: policy.headroom is by_criticality: 100 times the criticality 30" in said
    assert "Reservations exceed the platform (RARMS014)" in said


def test_who_shares_a_partition_is_named_with_the_reason(here: Path) -> None:
    speech = "  speech:\n    criticality: 10\n    memory: 64 MiB\n    together: [vision]\n  vision:\n"
    edit(here / "rarms.yaml", "  vision:\n", speech)
    leave_log(here, ["speech", "vision"], [])
    edit(here / "rarms.yaml", "    memory: 512 MiB\n", "    memory: 512 MiB\n    cpu: { reserve: 40 % }\n")

    answer = rarms("explain", "speech", "-f", str(here))

    assert answer.code == 0, answer.err
    said = " ".join(answer.out.split())
    assert "speech has none: the manifest does not say how well it must do" in said
    assert "vision: speech is combined with vision (criticality 30)" in said
    assert "speech says that it must be together with vision" in said


def test_a_partition_by_hand_fixes_the_reserve_and_puts_members_together(here: Path) -> None:
    speech = "  speech:\n    criticality: 10\n    memory: 64 MiB\n    cpu: { reserve: 45 % }\n  vision:\n"
    edit(here / "rarms.yaml", "  vision:\n", speech)
    measure(here, MEANS)
    manifest = (here / "rarms.yaml").read_text(encoding="utf-8")
    both = "\npartitions:\n  vision: { components: [vision, speech], cpu: { reserve: 70 % } }\n"
    (here / "rarms.yaml").write_text(manifest + both, encoding="utf-8", newline="\n")

    answer = rarms("explain", "speech", "-f", str(here))

    assert answer.code == 0, answer.err
    said = " ".join(answer.out.split())
    assert "as the manifest's partition vision fixes it" in said
    assert "the manifest's `partitions` puts them together" in said


def test_what_is_no_component_says_so(here: Path) -> None:
    for word, meant in (("visoin", "vision"), ("RAMS014", "RARMS014")):
        unknown = rarms("explain", word, "-f", str(here))
        message = f'The manifest has no component "{word}", and no finding is called so. Did you mean "{meant}"?'
        assert unknown.code == 64
        assert message in " ".join(unknown.err.split())


TOPICS = [
    "APT",
    "data log",
    "setting and verdict",
    "reservation",
    "rounding",
    "partition",
    "host",
    "limit and weight",
    "rejected",
]
"""Every walk has them all, also those with nothing to say."""


def steps(folder: Path, name: str, code: int = 0) -> dict[str, str]:
    answer = rarms("explain", name, "--json", "-f", str(folder))
    assert answer.code == code, answer.err
    check(answer.out)
    explanation = explain_component(load_manifest(ManifestSource(manifest=str(folder))), name)
    found = {step.topic: " ".join(map(str, step.sentences)) for step in explanation_steps(explanation)}
    assert list(found)[: len(TOPICS)] == TOPICS
    return found


def test_what_was_not_measured_is_walked_as_far_as_it_is_known(here: Path) -> None:
    answer = rarms("explain", "vision", "-f", str(here))
    said = steps(here, "vision", 4)

    assert answer.code == 4
    assert "error[RARMS100]" in answer.err
    assert "vision (criticality 30)" in answer.out
    assert "mean_response_time at most 100 ms" in said["APT"]
    assert "none that holds: vision is not measured on two-core with busy-loop yet" in said["data log"]
    assert "not measured" in said["setting and verdict"]
    assert said["reservation"] == "not known: not measured"
    assert said["partition"] == "vision: vision is alone, as nothing asks to combine it memory 512 MiB, " + (
        "2 virtual processors"
    )
    assert said["host"] == "onboard, once its reservation is known: it has 2 LP"
    assert "weight 3000" in said["limit and weight"]
    assert "sharing with others: `rarms tune` has measured nothing on two-core" in said["rejected"]
    assert "another host: the manifest has no other" in said["rejected"]
    assert "RARMS100" in said["no layout"]


def test_a_fixed_reserve_has_its_host_once_what_another_needs_is_known(here: Path) -> None:
    edit(here / "rarms.yaml", "components:\n", "components:\n  log: { criticality: 1, cpu: { reserve: 0.1 LP } }\n")

    assert steps(here, "log", 4)["host"].startswith(
        "onboard, once there is a layout: 0.1 LP (5 % of onboard) of its 2 LP"
    )


def test_what_keeps_a_layout_from_being_is_said_once(here: Path) -> None:
    ran = rarms("explain", "vision", "-f", str(here))

    assert (ran.code, ran.err.count("RARMS100"), ran.out.count("RARMS100")) == (4, 1, 0)


def test_an_apt_that_nothing_meets_is_shown_with_the_best_that_was_measured(here: Path) -> None:
    measure(here, {90: 180.0, 100: 150.0})

    said = steps(here, "vision", 4)

    assert "at 100 % of its 2 VPs beside busy-loop: mean_response_time 150 ms" in said["setting and verdict"]
    assert "missed, it must be at most 100 ms" in said["setting and verdict"]
    assert said["reservation"] == "not known: no setting that was measured is enough"
    assert "not even with all of its VPs" in said["no layout"]


def test_a_maximum_is_met_so_far_and_nothing_more_is_said_of_it(here: Path) -> None:
    edit(here / "rarms.yaml", "mean_response_time", "maximum_response_time")
    measure(here, MEANS)

    said = steps(here, "vision")["setting and verdict"]

    assert "jobs may lie beyond it (" in said
    assert ": met so far, as it must be at most 100 ms" in said
    assert "% sure" not in said


def test_what_is_fixed_by_hand_says_that_nothing_was_looked_for(here: Path) -> None:
    edit(here / "rarms.yaml", "    memory: 512 MiB\n", "    memory: 512 MiB\n    cpu: { reserve: 40 % }\n")

    said = steps(here, "vision")

    assert said["setting and verdict"] == (
        "not measured: the reserve is fixed, and it is unknown whether its APT is met"
    )
    assert "another reserve: none was looked for, as the manifest, for vision, fixes it" in said["rejected"]
    assert "sharing with others: not looked for" in said["rejected"]


def test_what_is_fixed_and_measured_all_the_same_says_what_the_log_says(here: Path) -> None:
    measure(here, MEANS)
    edit(here / "rarms.yaml", "    memory: 512 MiB\n", "    memory: 512 MiB\n    cpu: { reserve: 70 % }\n")

    said = steps(here, "vision")

    assert said["setting and verdict"] == (
        "measured: 1.24 LP (62 % of onboard) is enough; the manifest fixes 1.4 LP (70 % of onboard)"
    )
    assert "vision/busy-loop.jsonl, 6 settings" in said["data log"]
    assert "not used: the manifest, for vision, fixes the reserve" in said["data log"]


def test_one_without_a_wish_and_one_outside_partitions_have_every_step(here: Path) -> None:
    more = "  logging: { criticality: 1, memory: 64 MiB }\n"
    more += "  driver: { criticality: 2, runs_on: host, task: MotionControl }\n  vision:\n"
    edit(here / "rarms.yaml", "  vision:\n", more)
    measure(here, MEANS)

    logging, driver = steps(here, "logging"), steps(here, "driver")

    assert logging["reservation"] == "none: nothing asks for one"
    assert logging["rejected"].startswith("a reserve: nothing asks for one")
    assert driver["setting and verdict"] == "not measured: driver runs on the host itself (`runs_on: host`)"
    assert driver["partition"] == "none: it is combined with no other"
    assert driver["host"] == "where it is started: onboard"
    assert "robotic task class MotionControl" in driver["limit and weight"]
    assert rarms("explain", "driver", "--guide", "-f", str(here)).code == 64


def test_a_setting_that_gave_no_verdict_is_not_called_unmeasured(here: Path) -> None:
    unsteady = replace(
        steady("vision", 97.0), samples=(*steady("vision", 20.0).samples, *steady("vision", 90.0).samples)
    )
    settings = [a_setting(61, unsteady), *(a_setting(at, steady("vision", MEANS[at])) for at in (62, 70))]
    leave_log(here, ["vision"], settings)

    said = steps(here, "vision")

    assert (
        "measured beside busy-loop without a verdict (no steady state, or too few answers): 61 % of its VPs"
        in said["setting and verdict"]
    )
    assert (
        "one less, 61 % of its 2 VPs beside busy-loop: it was measured and gave no verdict, so it is unknown "
        "whether it is enough" in said["rejected"]
    )
    assert "nothing so low was measured" not in said["rejected"]


def test_what_tuning_combined_and_rejected_is_told(here: Path) -> None:
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
    by_hand = steps(here, "speech")
    append_run(tuning_path(here, "two-core"), run)
    tuned = steps(here, "speech")

    assert "so it was written by hand" in by_hand["partition"]
    assert (
        "`rarms tune` combined them at 2026-11-21T23:04:31Z, by the default strategy, proved to be the best: CR "
        "1.24 LP (62 % of its VPs) instead of 1.5 LP apart"
    ) in tuned["partition"]
    assert (
        "driver+speech, as `rarms tune` measured it: 50 % of its VPs is enough, and another layout was taken; "
        "40 % of its VPs is not enough "
        "for driver for sure; outdated: the manifest has no driver any more"
    ) in tuned["rejected"]
    assert "speech+vision, as" not in tuned["rejected"]
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


def test_on_a_host_where_it_runs_it_says_what_a_plan_says(tmp_path: Path) -> None:
    manifest = tmp_path / "rarms.yaml"
    manifest.write_text(RUNNING, encoding="utf-8", newline="\n")
    assert rarms("apply", "--auto-approve", "-f", str(tmp_path)).code == 0

    there = steps(tmp_path, "b")
    edit(manifest, "reserve: 40 %", "reserve: 60 %")
    plan, too_much = rarms("plan", "-f", str(tmp_path)), steps(tmp_path, "b", 4)
    edit(manifest, "hosts:\n", "policy: { max_disruption: removal }\nhosts:\n")
    moved = steps(tmp_path, "b")

    stays = "it stays on h1, where it is: a move is a removal, and policy.max_disruption forbids that"
    assert stays in there["host"]
    assert f"on h2: it would reserve 0.8 LP there too; there is room, and {stays}" in there["rejected"]
    assert plan.code == 4
    assert "`rarms plan`" in too_much["no layout"]
    assert stays in too_much["host"]
    assert f"on h2: it would reserve 1.2 LP; {stays}" in too_much["rejected"]
    assert "it is on h1 now: applied, it is made anew on h2" in moved["host"]
