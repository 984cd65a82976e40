"""One verdict on components by their data logs, and what it says where it gives no reservation."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import pytest

from rarms_iac.model.achievement import Achievement
from rarms_iac.model.commands import command
from rarms_iac.model.diagnostics import Finding
from rarms_iac.model.system import Component, run_of
from rarms_iac.planner.measured_together import LogOfLoad, MeasuredTogether, NotMeasured, explained
from rarms_iac.planner.planning_findings import STALE, UNMEASURED
from rarms_iac.planner.verdicts import decide, why_unknown
from rarms_iac.statistics.curves import curve_of
from tests import builders_measured
from tests.builders import a_component, at_most
from tests.builders_measured import a_series, a_setting

MEAN, P95 = "mean_response_time", "p95_response_time"
VISION = a_component(reserve="measured", apt={MEAN: at_most(120), P95: at_most(120)})


def a_log(means: Mapping[int, float], load: str = "busy-loop", samples: int = 600) -> MeasuredTogether:
    """Settings with these means, spread by 1 ms; a percentile needs more samples than a mean."""
    settings = [
        a_setting(reserve, a_series("vision", [mean + spread for spread in (1.0, -1.0) * (samples // 2)]))
        for reserve, mean in means.items()
    ]
    return MeasuredTogether(
        path=f"measurements/onboard/vision/{load}.jsonl",
        interference=load,
        processors=2,
        measured=tuple(sorted(means)),
        curves=lambda component, index: curve_of(settings, component, index, run_of(VISION)),
        records=builders_measured.a_log(settings),
        again=command("measure", "vision"),
    )


def missing(load: str, finding: Finding = UNMEASURED) -> NotMeasured:
    why = explained(finding, ("vision",), "onboard", f"no {load}", "Measure it.")
    return NotMeasured(components=("vision",), interference=load, why=why)


MET, OPEN, MISSED = {40: 130.0, 60: 90.0}, {60: 90.0, 100: 80.0}, {60: 150.0, 100: 140.0}


@pytest.mark.parametrize(
    ("logs", "achievements", "reserve"),
    [
        ([a_log(MET)], (Achievement.MET, Achievement.MET), 60),
        ([a_log(OPEN, samples=80)], (Achievement.MET, Achievement.OPEN), None),
        ([a_log(MISSED)], (Achievement.MISSED, Achievement.MISSED), None),
        ([a_log(MET), a_log({60: 130.0, 70: 90.0}, "bursts-20")], (Achievement.MET, Achievement.MET), 70),
        ([a_log(MET), a_log(OPEN, "bursts-20", 80)], (Achievement.MET, Achievement.OPEN), None),
        ([a_log(OPEN, samples=80), a_log(MISSED, "bursts-20")], (Achievement.MISSED, Achievement.MISSED), None),
        ([a_log(MET), missing("bursts-20")], (Achievement.UNMEASURED, Achievement.UNMEASURED), None),
        ([a_log(OPEN, samples=80), missing("bursts-20")], (Achievement.UNMEASURED, Achievement.OPEN), None),
        ([a_log(MISSED), missing("bursts-20")], (Achievement.MISSED, Achievement.MISSED), None),
        ([a_log(OPEN, samples=80), missing("x", STALE)], (Achievement.UNMEASURED, Achievement.UNMEASURED), None),
        ([missing("busy-loop")], (Achievement.UNMEASURED, Achievement.UNMEASURED), None),
    ],
)
def test_a_component_stands_as_its_worst_threshold(
    logs: Sequence[LogOfLoad], achievements: tuple[Achievement, Achievement], reserve: int | None
) -> None:
    verdict = decide([VISION], logs).verdict

    assert tuple(each.achievement for each in verdict.thresholds) == achievements
    assert verdict.of("vision") is verdict.achievement is max(achievements, key=list(Achievement).index)
    assert verdict.reserve == reserve


def test_met_member_waits_for_open_one() -> None:
    quick: Component = a_component("quick", reserve="measured", apt={MEAN: at_most(120)})
    log = a_log(OPEN, samples=80)
    settings = [a_setting(60, a_series("quick", [90.0, 91.0] * 300))]

    def curves(component: str, index: str) -> object:
        own = component == "quick"
        return curve_of(settings, component, index, run_of(quick)) if own else log.curves(component, index)

    both = replace(log, curves=curves)  # type: ignore[arg-type]  # a curve all the same
    verdict = decide([VISION, quick], [both]).verdict

    assert (verdict.of("quick"), verdict.of("vision"), verdict.reserve) == (Achievement.MET, Achievement.OPEN, None)


def test_missing_log_says_known_numbers() -> None:
    logs: list[LogOfLoad] = [a_log(MET), missing("bursts-20"), missing("bursts-100")]

    answer = why_unknown(("vision",), decide([VISION], logs), logs, "onboard")

    assert answer.why.code == "RARMS100"
    assert (
        "vision needs 1.2 LP with busy-loop, and is not measured with bursts-20 and bursts-100 yet" in answer.why.detail
    )
    assert "`policy.interference`" in answer.why.detail
    assert str(answer.why.advice) == (
        "Measure the other loads: `rarms measure vision`. Or reserve at least that for now: `cpu: { reserve: 1.2 LP }`."
    )


def test_missed_threshold_names_its_log() -> None:
    logs = [a_log(OPEN, samples=80), a_log(MISSED, "bursts-20")]

    answer = why_unknown(("vision",), decide([VISION], logs), logs, "onboard")

    assert answer.why.code == "RARMS106"
    assert "No setting of measurements/onboard/vision/bursts-20.jsonl meets" in answer.why.detail
