"""One verdict on components by their data logs, and what it says where it gives no reservation."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

import pytest

from rarms_iac.model.commands import command
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.layout import Infeasible, Layout
from rarms_iac.model.outcomes import Achievement
from rarms_iac.model.system import Component, PartitionRequest, System, run_of
from rarms_iac.planner.layout import Planning, plan_layout
from rarms_iac.planner.planning_findings import NOT_VERIFIED, STALE, UNMEASURED
from rarms_iac.planner.reservations import MeasuredReservations
from rarms_iac.planner.verdicts import LogOfLoad, MeasuredTogether, NotMeasured, decide, not_measured, why_unknown
from rarms_iac.statistics.curves import Curve, curve_of
from rarms_iac.texts.findings import Finding
from tests import builders_measured
from tests.builders import PathPlaces, a_component, a_cpu, a_host, a_system, at_most
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
    return not_measured(finding, ("vision",), "onboard", f"no {load}", "Measure it.", load=load)


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
        "vision needs 1.2 LP with busy-loop and is not measured with bursts-20 and bursts-100 yet" in answer.why.detail
    )
    assert "`policy.interference`" in answer.why.detail
    assert str(answer.why.advice) == (
        "Measure the other loads: `rarms measure vision`. "
        "Or set at least this fixed reserve: `cpu: { reserve: 1.2 LP }`."
    )


def test_missed_threshold_names_its_log() -> None:
    logs = [a_log(OPEN, samples=80), a_log(MISSED, "bursts-20")]

    answer = why_unknown(("vision",), decide([VISION], logs), logs, "onboard")

    assert answer.why.code == "RARMS106"
    assert "No setting of measurements/onboard/vision/bursts-20.jsonl meets" in answer.why.detail


APT = {"mean_response_time": at_most(100)}
Logs = Mapping[tuple[str, ...], LogOfLoad | tuple[LogOfLoad, ...]]
STEADY = [1.0, -1.0, 0.5, -0.5, 0.0] * 40


def around(mean: float) -> list[float | None]:
    return [mean + each for each in STEADY]


def measured(means: dict[int, float], component: str = "vision", *, processors: int = 2, apt: float = 100) -> Curve:
    """The curve through settings with these means, about 1 ms wide at most."""
    settings = [a_setting(reserve, a_series(component, around(mean))) for reserve, mean in means.items()]
    return curve_of(settings, component, "mean_response_time", run_of(a_component(component)))


def a_data_log(
    means: dict[int, float],
    *names: str,
    processors: int = 2,
    remarks: tuple[Diagnostic, ...] = (),
    load: str = "busy-loop",
) -> MeasuredTogether:
    curves = {name: measured(means, name) for name in names or ("vision",)}
    return MeasuredTogether(
        path=f"measurements/onboard/vision/{load}.jsonl",
        interference=load,
        processors=processors,
        measured=tuple(sorted(means)),
        curves=lambda component, _index: curves[component],
        records=builders_measured.a_log(()),
        remarks=remarks,
        again=command("measure", "vision"),
    )


NOT_MEASURED = "new"
"""The platform of hosts that no log is of."""


def planned(system: System, logs: Logs) -> Planning:
    kinds = {name: host.platform for name, host in system.hosts.items()}
    platforms = set(kinds.values()) - {NOT_MEASURED}
    everywhere: dict[tuple[Hashable, tuple[str, ...]], tuple[LogOfLoad, ...]] = {
        (kind, names): log if isinstance(log, tuple) else (log,) for names, log in logs.items() for kind in platforms
    }
    source = MeasuredReservations(kinds=kinds, logs=everywhere)
    return plan_layout(system, source, {}, PathPlaces())


def vision(**changes: object) -> System:
    component = a_component(reserve="measured", apt=APT)
    return a_system(components=[replace(component, **changes)])  # type: ignore[arg-type]  # by name, as the builders take them


def reserves(planning: Planning) -> dict[str, int]:
    assert isinstance(planning.answer, Layout), planning.findings
    return {partition.name: partition.settings.reserve for partition in planning.answer.partitions}


def codes(planning: Planning) -> list[str]:
    return [finding.code for finding in planning.findings]


def test_reserve_is_the_least_measured_to_pass() -> None:
    found = planned(vision(), {("vision",): a_data_log({10: 700, 61: 110, 62: 90, 70: 88})})

    assert reserves(found) == {"vision": 62}
    assert codes(found) == []


def test_between_two_settings_the_upper_one_is_taken() -> None:
    found = planned(vision(), {("vision",): a_data_log({50: 150, 70: 90})})

    assert reserves(found) == {"vision": 70}
    assert codes(found) == []


def test_a_cr_is_of_the_partitions_own_processors() -> None:
    host = a_host(logical_processors=4)
    system = replace(vision(processors=2), hosts={host.name: host})

    found = planned(system, {("vision",): a_data_log({61: 110, 62: 90})})

    assert isinstance(found.answer, Layout)
    (partition,) = found.answer.partitions
    assert (partition.settings.processors, partition.settings.reserve) == (2, 62)
    assert partition.reserved == Fraction(124, 100)


@pytest.mark.parametrize(
    ("means", "message", "measures_on"),
    [
        ({50: 300, 100: 150}, "even at 100 % of its VPs", False),
        ({50: 300, 80: 150}, "The highest setting is 80 %", True),
        (
            {50: 300, 100: 100},
            "at 100 % of its VPs the samples do not show whether mean_response_time of vision",
            True,
        ),
        ({}, "does not have a setting with 2 virtual processors yet", True),
    ],
)
def test_where_no_setting_meets_apt_answer_is_no(means: dict[int, float], message: str, measures_on: bool) -> None:
    found = planned(vision(), {("vision",): a_data_log(means)})

    (diagnostic,) = found.findings
    assert isinstance(found.answer, Infeasible)
    assert diagnostic.code == "RARMS106"
    assert message in diagnostic.detail
    assert ("`rarms measure vision`" in str(diagnostic.advice)) is measures_on, (
        "above 100 % there is nothing to measure"
    )


def test_only_thresholds_that_no_setting_meets_are_named() -> None:
    apt = {"mean_response_time": at_most(500), "p95_response_time": at_most(100)}

    (diagnostic,) = planned(vision(apt=apt), {("vision",): a_data_log({50: 300, 80: 150})}).findings

    assert "meets p95_response_time of vision. The highest" in diagnostic.detail


def test_without_log_it_says_what_it_was_told() -> None:
    stale = not_measured(STALE, ("vision",), "onboard", "It changed.", "Measure again.")

    (diagnostic,) = planned(vision(), {("vision",): stale}).findings
    (unknown,) = planned(vision(), {}).findings

    assert (diagnostic.code, diagnostic.detail, str(diagnostic.advice)) == ("RARMS102", "It changed.", "Measure again.")
    assert unknown.code == "RARMS100"


def test_remarks_of_a_log_follow_its_reservation() -> None:
    remark = NOT_VERIFIED.at(None, "model.bin is not here.", "Plan elsewhere.", address="component/vision")
    log = a_data_log({61: 110, 62: 90}, remarks=(remark,))
    fixed = PartitionRequest(name="vision", components=("vision",), cpu=a_cpu(reserve="70 %"))

    assert codes(planned(vision(), {("vision",): log})) == ["RARMS104"]
    assert codes(planned(replace(vision(), partitions={"vision": fixed}), {("vision",): log})) == []


def test_common_log_counts_with_fixed_minimum() -> None:
    members = [a_component("vision", reserve="measured", apt=APT), a_component("speech", reserve="80 %", apt=APT)]
    request = PartitionRequest(name="both", components=("vision", "speech"))
    system = a_system(components=members, partitions=[request])
    alone: Logs = {("vision",): a_data_log({61: 110, 62: 90})}

    assert codes(planned(system, alone)) == ["RARMS100"]
    log = a_data_log({61: 110, 62: 90}, "vision", "speech")
    assert reserves(planned(system, {("speech", "vision"): log})) == {"both": 80}


def test_another_apt_is_looked_up_in_same_log() -> None:
    log: Logs = {("vision",): a_data_log({10: 700, 61: 110, 62: 90, 70: 88})}

    assert reserves(planned(vision(apt={"mean_response_time": at_most(120)}), log)) == {"vision": 61}
    assert reserves(planned(vision(apt={"mean_response_time": at_most(800)}), log)) == {"vision": 10}


def test_hardest_load_decides() -> None:
    logs = (
        a_data_log({30: 110, 40: 95}, load="busy-loop"),
        a_data_log({40: 105, 55: 95}, load="bursts-20"),
        a_data_log({40: 99, 41: 95}, load="bursts-100"),
    )

    assert reserves(planned(vision(), {("vision",): logs})) == {"vision": 55}


def test_hopeless_load_leaves_no_reservation() -> None:
    logs = (a_data_log({40: 95}), a_data_log({40: 120, 60: 110}, load="bursts-20"))

    planning = planned(vision(), {("vision",): logs})

    assert isinstance(planning.answer, Infeasible)
    assert "bursts-20.jsonl" in " ".join(finding.detail for finding in planning.findings)
