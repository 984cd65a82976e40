"""What an end is told as: an end that is a no always has a finding that says so."""

import re
from collections.abc import Iterator
from contextlib import chdir
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.manifest.text.tree import first_line
from rarms_iac.measuring.evidence import disturbance, is_weak, leaves_idle
from rarms_iac.measuring.findings import findings_of, unused_processors
from rarms_iac.measuring.other_work import describe_idle, work_of_evidence, work_of_settings
from rarms_iac.measuring.partitions import LoadShare
from rarms_iac.model.capacity import shared_processors
from rarms_iac.model.experiment import Experiment, ProcessorNumber, ProcessorSource, experiment_of
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.loads import LOADS_WITHOUT_ENTRY, Browser, Bursts, BusyLoop, CommandLoad, Interference, Stress
from rarms_iac.model.outcomes import NotAchievable, NotResolved, Sufficient, TooManyFailures
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.run import Periodic
from rarms_iac.model.series import Sample, Series, SkippedLines
from rarms_iac.model.setting import P1, P2, MachineSpeed, OutsideWork, Setting, SettingEvidence
from rarms_iac.providers.simulated.measuring import SimulatedRun
from rarms_iac.storage.codec import decode, encode
from rarms_iac.storage.datalog.log import Provenance, Recorded
from tests.builders import a_component, a_host, a_run, a_simulation, a_system, at_most, milliseconds
from tests.builders_measured import a_series, a_setting
from tests.fluid import without_scheduler
from tests.measuring import leave_logs
from tests.unit.cli.running import Ran, rarms
from tests.unit.measuring import test_prove, test_tune

APT = {"mean_response_time": at_most(84), "maximum_response_time": at_most(90)}


def an_experiment(reserve: str | None) -> Experiment:
    system = a_system(components=[a_component("vision", apt=APT, simulation=a_simulation(), reserve=reserve)])
    return experiment_of(system, system.hosts["onboard"], ("vision",), "busy-loop")


EXPERIMENT = an_experiment("20 %")


def told(times: list[float]) -> list[str]:
    settings = (a_setting(100, a_series("vision", times)),)
    found = list(findings_of(EXPERIMENT, NotAchievable(reserve=100), settings, first_line("")))
    assert {diagnostic.code for diagnostic in found} == {"RARMS110"}
    assert all({"component": "vision", "reserve_percent": 100}.items() <= each.values.items() for each in found)
    assert {(each.values["index"], each.values["threshold"], each.values["unit"]) for each in found} <= {
        ("mean_response_time", 84.0, "ms"),
        ("maximum_response_time", 90.0, "ms"),
    }
    assert all(f"--at LEVEL --index {each.values['index']}" in str(each.advice) for each in found)
    return [diagnostic.detail for diagnostic in found]


def test_indexes_that_are_on_wrong_side_are_named() -> None:
    (only,) = told([82.0, 86.5] * 30)

    assert "mean_response_time" in only


def test_unsure_right_side_is_told_too() -> None:
    """A mean of 83.9 ms, known to within a millisecond, does not show that it is at most 84 ms."""
    assert len(told([81.4, 86.4] * 30)) == len(APT)


def test_series_without_steady_state_is_told_as_such() -> None:
    message = " ".join(told([40.0 + number for number in range(100)]))

    assert "not known: its response times still changed within 100 samples" in message


@pytest.mark.parametrize(("cpu_ms", "helps"), [(60.0, True), (10.0, False)])
def test_waiting_component_is_told_cpu_does_not_help(cpu_ms: float, helps: bool) -> None:
    """Of 60 ms that lie between the ends of two jobs, which are due every 50 ms."""
    run = replace(a_run(), arrival=Periodic(period=Milliseconds(Fraction(50))))
    member = replace(EXPERIMENT.members[0], run=run)
    samples = [Sample(began_ms=50.0 * at, response_ms=60.0 + 10.0 * at + at % 3, successful=True) for at in range(100)]
    series = Series(component="vision", samples=samples, elapsed_ms=6000.0, cpu_ms=cpu_ms * len(samples))

    found = list(
        findings_of(
            replace(EXPERIMENT, members=(member,)),
            NotAchievable(reserve=100),
            (a_setting(100, series),),
            first_line(""),
        )
    )

    assert found
    why = "overloaded: needs 1.2 LP, has 1" if helps else "overloaded: jobs arrive every 50 ms but end every 60"
    assert all(f"keeps growing ({why}" in each.detail for each in found)
    assert all(str(each.advice).startswith("More CPU time does not help") is not helps for each in found)


def drifting(reserve: int) -> Setting:
    return a_setting(reserve, a_series("vision", [40.0 + number for number in range(100)]))


@pytest.mark.parametrize(
    ("failed", "inconclusive", "message"),
    [
        (
            None,
            (45,),
            "vision: 46 % of its VPs is enough. rarms did not judge 45 %. vision at 45 % of its VPs: ",
        ),
        (
            20,
            (44, 45),
            "46 % of its VPs is enough; 20 % is too little. rarms did not judge 44 and 45 %. vision at 45 %",
        ),
        (43, (44, 45), None),
        (45, (), None),
        (20, (), None),
    ],
)
def test_possibly_smaller_answer_is_told(
    failed: int | None, inconclusive: tuple[int, ...], message: str | None
) -> None:
    end = Sufficient(reserve=46, failed=failed, inconclusive=inconclusive)
    experiment = an_experiment(None)

    found = list(findings_of(experiment, end, tuple(map(drifting, inconclusive)), first_line("")))

    assert [diagnostic.code for diagnostic in found] == (["RARMS267"] if message else [])
    assert all(message is not None and message in diagnostic.detail for diagnostic in found)
    assert all("vision at 45 % of its VPs: its response times still changed" in each.detail for each in found)


@pytest.mark.parametrize(
    ("samples", "advice"),
    [
        (400, "100 samples took 8 s. The threshold needs about 400 samples, 34 s per setting. Allow more time: "),
        (None, "100 samples took 8 s. The necessary number is not known yet. Allow more time: "),
        (50_000, "Change the threshold. The measured value is too close to decide with 40000 samples."),
    ],
)
def test_unshown_threshold_says_needed_samples(samples: int | None, advice: str) -> None:
    settings = (a_setting(100, a_series("vision", [81.4, 86.4] * 50)),)

    [found] = findings_of(EXPERIMENT, NotResolved(reason="inconclusive", samples=samples), settings, first_line(""))

    assert found.code == "RARMS111"
    assert str(found.advice).startswith(advice)
    more_time = samples != 50_000
    assert ("`policy: { measuring: { setting: 20 min } }`" in str(found.advice)) is more_time, "10 min are allowed now"
    assert ("ended after 8 s, because the rest of its 10 min would" in found.detail) is more_time


def test_more_time_is_for_all_loads() -> None:
    experiment = replace(EXPERIMENT, loads=(EXPERIMENT.load,) * 3)
    settings = (a_setting(100, a_series("vision", [81.4, 86.4] * 50)),)
    end = NotResolved(reason="inconclusive", samples=20_000)

    [found] = findings_of(experiment, end, settings, first_line(""))

    assert "28 min per setting with each of 3 loads. Allow more time: " in str(found.advice)
    assert found.values["takes_ms"] == pytest.approx(200 * settings[0].host_ms)
    assert found.values["needs_setting_ms"] == 126 * 60_000, "1.5 times as long, three times"
    assert "`policy: { measuring: { setting: 126 min } }`" in str(found.advice)


def test_samples_and_time_are_of_the_slowest_member() -> None:
    """Planner has a tenth of vision's jobs; four times its samples are four times the time."""
    series = (a_series("planner", [81.4, 86.4] * 5), a_series("vision", [81.4, 86.4] * 50))
    end = NotResolved(reason="inconclusive", member="planner", samples=40)

    [found] = findings_of(EXPERIMENT, end, (a_setting(100, *series),), first_line(""))

    assert "10 samples of planner took" in str(found.advice)
    assert found.values["takes_ms"] == pytest.approx(4 * a_setting(100, *series).host_ms)


@pytest.mark.parametrize(("samples", "asked"), [(7000, 7000), (None, 1000)])
def test_ended_at_until_asks_for_samples(samples: int | None, asked: int) -> None:
    settings = (a_setting(100, a_series("vision", [81.4, 86.4] * 50)),)
    end = NotResolved(reason="inconclusive", samples=samples, ends_at_until=True)

    [found] = findings_of(EXPERIMENT, end, settings, first_line(""))

    assert f"`rarms measure vision --strategy paper --again --samples {asked}`" in str(found.advice)
    assert "The setting ended" not in found.detail, "no budget ended it"


def test_early_end_asks_for_the_same_command() -> None:
    settings = (a_setting(70, a_series("vision", [81.4, 86.4] * 50)),)
    end = NotResolved(reason="none of its 8 settings was shown to be enough", more_settings=8)

    [found] = findings_of(EXPERIMENT, end, settings, first_line(""))

    assert str(found.advice) == "Run the same command to continue with up to 8 settings more."
    assert found.values["more_settings"] == 8
    assert "The setting ended" not in found.detail, "it may be clear"


def test_early_end_is_not_called_unsteady() -> None:
    end = Sufficient(reserve=46, failed=20, inconclusive=(45,), more_settings=8)

    assert not list(findings_of(an_experiment(None), end, (drifting(45),), first_line("")))


@pytest.mark.parametrize(("samples", "more_time"), [(100, True), (2000, False)])
def test_unsteady_despite_many_samples_needs_no_time(samples: int, more_time: bool) -> None:
    experiment = an_experiment(None)
    setting = a_setting(45, a_series("vision", [40.0 + number for number in range(samples)]))
    enough = Sufficient(reserve=46, failed=20, inconclusive=(45,))

    (less,) = findings_of(experiment, enough, (setting,), first_line(""))
    (none,) = findings_of(experiment, NotResolved(reason="no steady state"), (setting,), first_line(""))

    assert none.code == "RARMS112"
    assert "for a growing queue" in str(less.advice)
    assert ("setting: 30 min" in str(none.advice)) == ("setting: 30 min" in str(less.advice)) == more_time


@pytest.mark.parametrize(("reserve", "codes"), [("30 %", ["RARMS266"]), ("measured", []), (None, [])])
def test_fixed_and_measured_reservation_is_told(reserve: str | None, codes: list[str]) -> None:
    experiment = an_experiment(reserve)

    found = list(findings_of(experiment, Sufficient(reserve=21, failed=20), (), first_line("")))

    assert [diagnostic.code for diagnostic in found] == codes
    assert all("21 %" in diagnostic.detail and "fixes 30 %" in diagnostic.detail for diagnostic in found)


@pytest.mark.parametrize(("source", "codes"), [(ProcessorSource.MANIFEST, ["RARMS380"]), (ProcessorSource.HOST, [])])
def test_unused_fixed_processors_are_noted(source: ProcessorSource, codes: list[str]) -> None:
    experiment = an_experiment(None).with_processors(ProcessorNumber(number=2, source=source))
    setting = replace(a_setting(54, a_series("vision", [40.0] * 60)), used_processors=1)

    found = list(unused_processors([(experiment, 54, (setting,))], first_line("")))

    assert [diagnostic.code for diagnostic in found] == codes
    assert all(diagnostic.detail == "With 1 VP instead of 2, less is enough: vision 0.54 LP." for diagnostic in found)


def test_unused_processors_are_one_finding_a_host() -> None:
    number = ProcessorNumber(number=2, source=ProcessorSource.MANIFEST)
    setting = replace(a_setting(54, a_series("vision", [40.0] * 60)), used_processors=1)
    answers = [(an_experiment(None).with_processors(number), reserve, (setting,)) for reserve in (54, 20)]

    (found,) = unused_processors(answers, first_line(""))

    assert found.detail == "With 1 VP instead of 2, less is enough: vision 0.54 LP, vision 0.2 LP."
    assert (found.place, found.address) == (None, "host/onboard")
    assert found.values["reserve_percent"] == ("54", "20")


def setting(reserve: int, response_ms: float, cpu_ms: float) -> Setting:
    """Ten jobs with this response time each, and the processor time of all of them."""
    samples = [Sample(began_ms=at * 100.0, response_ms=response_ms, successful=True) for at in range(10)]
    series = Series(component="vision", samples=samples, elapsed_ms=1000.0, cpu_ms=cpu_ms)
    return Setting(reserve=reserve, series=(series,), evidence=SettingEvidence(elapsed_ms=1000.0))


@pytest.mark.parametrize(
    ("settings", "found"),
    [
        ((setting(20, 100.0, 0.0), setting(80, 100.0, 0.0)), True),
        ((setting(20, 100.0, 0.9), setting(80, 105.0, 0.9)), True),
        ((setting(20, 100.0, 1.1), setting(80, 100.0, 1.1)), False),  # more than 1 ms a second
        ((setting(20, 100.0, 0.0), setting(80, 50.0, 0.0)), False),  # a reservation helps
        ((setting(20, 100.0, 0.0),), False),
    ],
)
def test_waiting_without_processor_time_is_a_warning(settings: tuple[Setting, ...], found: bool) -> None:
    told = list(work_of_settings(EXPERIMENT, settings, (), first_line("")))

    assert [diagnostic.code for diagnostic in told] == ["RARMS393"] * found
    assert all("at 20 % and at 80 % of its VPs are the same" in diagnostic.detail for diagnostic in told)


def share(takes: float, shared: float = 2.0) -> LoadShare:
    """Of a load on two processors, of which all partitions can use so much together."""
    return LoadShare(
        reserve=round(50 * takes), reserves={}, processors=Fraction(takes), others=Fraction(shared) - Fraction(takes)
    )


QUIET = SettingEvidence(elapsed_ms=10_000, cpu_ms={P1: 12_000.0, P2: 7_900.0}, stolen_ms=100, waiting_ms=9_000.0)
SHORT_LOAD = replace(QUIET, cpu_ms={P1: 12_000.0, P2: 4_000.0})


def test_expected_conditions_are_no_disturbance() -> None:
    assert disturbance(QUIET, 2, load=share(0.8)) == ""


def test_load_that_does_not_get_its_reserve_disturbs() -> None:
    assert disturbance(SHORT_LOAD, 2, load=share(0.8)) == "the load in P2 got 0.40 LP of its reserved 0.80 LP"
    assert disturbance(SHORT_LOAD, 2, load=None) == "", "browsers may rest"


def test_p1_surplus_disturbs_nobody() -> None:
    """Three threads that sleep and wake got 0.31 LP of a group that reserves 0.2."""
    woken = replace(QUIET, cpu_ms={P1: 3_100.0, P2: 16_800.0})

    assert disturbance(woken, 2, load=share(1.8)) == ""
    assert disturbance(replace(woken, cpu_ms={P1: 2_100.0, P2: 16_700.0}), 2, load=share(1.8)).startswith("the load")


def test_stolen_time_disturbs() -> None:
    stolen = replace(QUIET, stolen_ms=1_100)

    assert disturbance(stolen, 2, load=None) == "steal time was 5.5 % of the processor time; at most 5 % is allowed"


FAST = MachineSpeed(governor="performance", mhz=3000, limit_mhz=3400, throttled=2)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"governor": "powersave"}, "the frequency governor changed from performance to powersave"),
        ({"throttled": 3}, "heat slowed the processors"),
        ({"limit_mhz": 2000}, "the highest frequency allowed changed from 3400 to 2000 MHz"),
        ({"mhz": 2600}, "the processors' frequency changed from 3000 to 2600 MHz"),
        ({"mhz": 2800}, ""),
    ],
)
def test_changed_speed_disturbs(change: dict[str, Any], reason: str) -> None:
    evidence = replace(QUIET, speeds=(FAST, replace(FAST, **change)))

    assert disturbance(evidence, 2, load=share(0.8)) == reason
    assert disturbance(evidence, 2, load=None) == ("" if "mhz" in change else reason), "idle processors slow down"


def test_counters_give_what_was_counted_between_two_moments() -> None:
    later = SettingEvidence(
        elapsed_ms=12_500, cpu_ms={P1: 12_250.0, P2: 8_000.0}, throttled_ms={P1: 7.0}, stolen_ms=110, waiting_ms=None
    )

    assert later.since(QUIET) == SettingEvidence(
        elapsed_ms=2500, cpu_ms={P1: 250.0, P2: 100.0}, throttled_ms={P1: 7.0}, stolen_ms=10
    )


ELSEWHERE = replace(
    QUIET,
    speeds=(FAST, FAST),
    memory_peak=2**28,
    outside=(OutsideWork(name="sh", group="/docker/1", cpu_ms=7.5, component="eyes"),),
    out_of_memory={"eyes": 2},
)
SKIPPED = replace(QUIET, skipped_lines={"vision": SkippedLines(count=7, first=('"loading"',))})


@pytest.mark.parametrize(
    "evidence", [None, QUIET, SKIPPED, ELSEWHERE, replace(SHORT_LOAD, waiting_ms=None, disturbances=("it slept",))]
)
def test_log_keeps_evidence(evidence: SettingEvidence | None) -> None:
    recorded = Recorded(
        setting=Setting(reserve=40, series=(), beside=60, evidence=evidence),
        provenance=Provenance(rarms_version="1.0", when="2026-11-22T20:00:00Z"),
    )

    assert decode(Recorded, encode(recorded)) == recorded


def an_evidence(p1_ms: float, p2_ms: float, stolen_ms: float = 0.0) -> SettingEvidence:
    """One second of two processors."""
    return SettingEvidence(elapsed_ms=1000.0, cpu_ms={P1: p1_ms, P2: p2_ms}, stolen_ms=stolen_ms)


@pytest.mark.parametrize(
    ("evidence", "idle"),
    [
        (an_evidence(200.0, 1750.0), False),
        (an_evidence(200.0, 1000.0), True),
        (an_evidence(200.0, 1000.0, stolen_ms=750.0), False),
        (SettingEvidence(), False),
        (None, False),
    ],
)
def test_load_leaves_idle_what_nobody_had(evidence: SettingEvidence | None, idle: bool) -> None:
    assert leaves_idle(evidence, Fraction(2)) == idle


@pytest.mark.parametrize(
    ("load", "weak"),
    [
        (BusyLoop(), False),
        (BusyLoop(threads=1), True),
        (Stress(stressor="timer", workers=1), True),
        (Stress(stressor="timer", workers=2), True),  # it was seen to leave half of the time
        (CommandLoad(command=("recorder",)), True),  # so was this
        (Bursts(every=milliseconds("50 ms")), False),  # it sleeps by design
        (Bursts(every=milliseconds("50 ms"), threads=1), True),
        (LOADS_WITHOUT_ENTRY["bursts-50-half"], True),
        (Browser(instances=9), True),
    ],
)
def test_weak_load_cannot_or_did_not_take_all(load: Interference, weak: bool) -> None:
    seen = an_evidence(200.0, 1000.0) if not isinstance(load, BusyLoop) else an_evidence(200.0, 1790.0)

    assert is_weak(load, replace(a_setting(), evidence=seen), a_host()) == weak


def test_a_weak_load_names_what_had_its_time() -> None:
    """Of 1.8 LP that partitions have together P1 had 0.2 and the load 1; what is kept for the host is not idle."""
    host = replace(a_host(keep_processor="10 %"), provider=ProviderKind.LINUX)
    others = (
        OutsideWork(name="make", group="/user.slice", cpu_ms=360.0),
        OutsideWork(name="top", group="", cpu_ms=9.0),
    )
    evidence = replace(an_evidence(200.0, 1000.0), others=others, throttled_ms={P1: 5.0, P2: 400.0})

    assert describe_idle("busy-loop", evidence, host) == (
        "busy-loop left 33 % of 1.8 LP idle. Of 1.8 LP, make in /user.slice used 20 %. The limit of P2 "
        "stopped its threads for 0.4 s in total on all processors."
    )
    assert "The load was waiting." in describe_idle("timer", an_evidence(200.0, 1000.0), host)
    assert not leaves_idle(an_evidence(200.0, 1550.0), shared_processors(host, 2))


OUTSIDE = OutsideWork(name="sh", group=f"/libpod_parent/libpod-{'0a' * 32}", cpu_ms=790.0, component="vision")
FOUND = SettingEvidence(
    elapsed_ms=1000.0,
    cpu_ms={P1: 10.0, P2: 10_000.0},
    outside=(OUTSIDE,),
    out_of_memory={"vision": 2},
    skipped_lines={"vision": SkippedLines(count=3, first=('"booting"',))},
)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder in which every setting and start counts work outside."""
    monkeypatch.setattr(SimulatedRun, "evidence", lambda _running: FOUND)
    with chdir(tmp_path), without_scheduler():
        yield tmp_path


def reported_work(ran: Ran) -> list[str]:
    """The sentences on work outside and on kills, and the number of their findings."""
    text = " ".join(ran.err.split())
    found = re.findall(r"Processes of vision left [^*]*\* \d+ ms\.|The kernel killed \d+ processes", text)
    return [*sorted(found), str(text.count("[RARMS393]")), str(text.count("[RARMS394]"))]


def work_of_starts(number: int) -> list[str]:
    left = f"Processes of vision left their control group: sh in /libpod_parent/libpod-* {790 * number} ms."
    return [left, f"The kernel killed {2 * number} processes", "1", "1"]


@pytest.mark.parametrize("is_current", [True, False])
def test_busy_host_is_a_note_on_current_settings(is_current: bool) -> None:
    others = (OutsideWork(name="make", group="/user.slice", cpu_ms=360.0),)
    evidence = SettingEvidence(elapsed_ms=1000.0, outside=others)

    told = list(work_of_evidence(["vision"], [evidence], first_line(""), [evidence] * is_current))

    assert [str(each.code) for each in told] == ["RARMS392"] * is_current
    assert all("used more processor time: make in /user.slice 360 ms." in each.detail for each in told)


def test_measure_names_work_outside_and_kills(here: Path) -> None:
    (here / "rarms.yaml").write_text(test_prove.MANIFEST, encoding="utf-8")

    measured, recorded = (rarms("measure", "vision", "--from", "50%", "--to", "50%") for _ in range(2))

    assert reported_work(measured) == reported_work(recorded) == work_of_starts(1)


def test_prove_adds_up_the_starts(here: Path) -> None:
    without_conditions = "policy: { interference: busy-loop, measuring: { slow_job: 1 } }"
    manifest = test_prove.MANIFEST.replace("policy: { interference: busy-loop }", without_conditions)
    (here / "rarms.yaml").write_text(manifest, encoding="utf-8")
    assert rarms("apply", "--auto-approve").code == 0

    proved = rarms("prove", "--without-load")

    assert reported_work(proved) == work_of_starts(8)
    assert "vision: 24 lines" in " ".join(proved.out.split())


def test_tune_names_work_outside_and_kills(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "rarms.yaml").write_text(test_tune.MANIFEST, encoding="utf-8")
    monkeypatch.setattr(SimulatedRun, "evidence", lambda _running: None)
    assert rarms("measure", "--samples", "400").code == 0
    monkeypatch.setattr(SimulatedRun, "evidence", lambda _running: FOUND)

    ran = rarms("tune", "--samples", "60", "--dry-run")

    assert "RARMS393" in ran.err
    assert "RARMS394" in ran.err


def test_tuning_without_answer_says_why(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "rarms.yaml").write_text(test_tune.MANIFEST, encoding="utf-8")
    leave_logs(here, {"vision": 45, "paths": 40, "video": 30})
    failed = TooManyFailures(component="vision", failures=("no answer within 60 s",), allowed=0)
    monkeypatch.setattr("rarms_iac.measuring.setting_run.watch", lambda *_, **_more: failed)

    ran = rarms("tune")

    assert ran.code == 4
    assert "error[RARMS310]" in ran.err
    assert "no answer within 60 s" in " ".join(ran.err.split())


def test_memory_is_advised_where_memory_kills(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "rarms.yaml").write_text(test_prove.MANIFEST, encoding="utf-8")
    failed = TooManyFailures(component="vision", failures=("killed by signal KILL",), allowed=0)
    for module in ("setting_run", "proof"):
        monkeypatch.setattr(f"rarms_iac.measuring.{module}.watch", lambda *_, **_more: failed)

    measured = rarms("measure", "vision")
    assert rarms("apply", "--auto-approve").code == 0
    for ran in (measured, rarms("prove", "--without-load")):
        text = " ".join(ran.err.split())
        assert "The kernel killed 2 processes of its partition" in text
        assert "Raise `memory`" in text
        assert "run: { failures" not in text
