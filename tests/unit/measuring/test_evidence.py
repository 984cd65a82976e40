"""A setting that was not what it says is known by what the host counted."""

from dataclasses import replace

import pytest

from rarms_iac.measuring.evidence import disturbance, is_weak, leaves_idle
from rarms_iac.model.environment_setup import P1, P2
from rarms_iac.model.loads import LOADS_WITHOUT_ENTRY, Browser, Bursts, BusyLoop, CommandLoad, Interference, Stress
from rarms_iac.model.series import SkippedLines
from rarms_iac.model.setting import OutsideWork, Setting, SettingEvidence
from rarms_iac.storage.datalog.columns import line_of, setting_in
from rarms_iac.storage.datalog.log import Provenance, Recorded
from tests.builders import milliseconds
from tests.builders_measured import a_setting

QUIET = SettingEvidence(elapsed_ms=10_000, cpu_ms={P1: 12_000.0, P2: 7_900.0}, stolen_ms=100, waiting_ms=9_000.0)
SHORT_LOAD = replace(QUIET, cpu_ms={P1: 12_000.0, P2: 4_000.0})


def test_what_is_as_it_was_asked_for_is_not_disturbed() -> None:
    assert disturbance(QUIET, 2, load_takes=0.8) == ""


def test_a_load_that_does_not_get_its_reserve_disturbs() -> None:
    assert disturbance(SHORT_LOAD, 2, load_takes=0.8) == "the load in P2 got 0.40 LP where 0.80 are reserved"
    assert disturbance(SHORT_LOAD, 2, load_takes=None) == "", "browsers may rest"


def test_what_p1_had_beyond_its_reserve_disturbs_no_other() -> None:
    """Three threads that sleep and wake got 0.31 LP of a group that reserves 0.2."""
    woken = replace(QUIET, cpu_ms={P1: 3_100.0, P2: 16_800.0})

    assert disturbance(woken, 2, load_takes=1.8) == ""
    assert disturbance(replace(woken, cpu_ms={P1: 2_100.0, P2: 16_700.0}), 2, load_takes=1.8).startswith("the load")


def test_stolen_time_disturbs() -> None:
    stolen = replace(QUIET, stolen_ms=1_100)

    assert disturbance(stolen, 2, load_takes=None) == (
        "the machine below took 5.5% of the processors' time, and 5% may be"
    )


def test_counters_give_what_was_counted_between_two_moments() -> None:
    later = SettingEvidence(
        elapsed_ms=12_500, cpu_ms={P1: 12_250.0, P2: 8_000.0}, throttled_ms={P1: 7.0}, stolen_ms=110, waiting_ms=None
    )

    assert later.since(QUIET) == SettingEvidence(
        elapsed_ms=2500, cpu_ms={P1: 250.0, P2: 100.0}, throttled_ms={P1: 7.0}, stolen_ms=10
    )


ELSEWHERE = replace(
    QUIET, outside=(OutsideWork(name="sh", group="/docker/1", cpu_ms=7.5, component="eyes"),), out_of_memory={"eyes": 2}
)
SKIPPED = replace(QUIET, skipped_lines={"vision": SkippedLines(count=7, first=('"loading"',))})


@pytest.mark.parametrize(
    "evidence", [None, QUIET, SKIPPED, ELSEWHERE, replace(SHORT_LOAD, waiting_ms=None, disturbances=("it slept",))]
)
def test_a_log_keeps_the_evidence_and_reads_lines_without_any(evidence: SettingEvidence | None) -> None:
    recorded = Recorded(
        setting=Setting(reserve=40, series=(), beside=60, evidence=evidence),
        provenance=Provenance(rarms_version="1.0", when="2026-11-22T20:00:00Z"),
    )

    line = line_of(recorded)

    assert setting_in(line) == recorded
    assert ("evidence" in line) is (evidence is not None)


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
def test_a_load_leaves_processors_idle_where_neither_partition_had_their_time(
    evidence: SettingEvidence | None, idle: bool
) -> None:
    assert leaves_idle(evidence, 2) == idle


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
def test_a_load_is_weak_that_cannot_take_all_or_did_not(load: Interference, weak: bool) -> None:
    seen = an_evidence(200.0, 1000.0) if not isinstance(load, BusyLoop) else an_evidence(200.0, 1790.0)

    assert is_weak(load, replace(a_setting(), evidence=seen), 2) == weak
