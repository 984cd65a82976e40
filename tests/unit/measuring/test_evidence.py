"""A setting that was not what it says is known by what the host counted."""

from dataclasses import replace
from fractions import Fraction

import pytest

from rarms_iac.measuring.evidence import disturbance, is_weak, leaves_idle
from rarms_iac.measuring.findings import describe_idle
from rarms_iac.measuring.partitions import LoadShare
from rarms_iac.model.capacity import shared_processors
from rarms_iac.model.environment_setup import P1, P2
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.loads import LOADS_WITHOUT_ENTRY, Browser, Bursts, BusyLoop, CommandLoad, Interference, Stress
from rarms_iac.model.series import SkippedLines
from rarms_iac.model.setting import OutsideWork, Setting, SettingEvidence
from rarms_iac.storage.datalog.columns import line_of, setting_in
from rarms_iac.storage.datalog.log import Provenance, Recorded
from tests.builders import a_host, milliseconds
from tests.builders_measured import a_setting


def share(takes: float, shared: float = 2.0) -> LoadShare:
    """Of a load on two processors, of which all partitions can use so much together."""
    return LoadShare(reserve=round(50 * takes), processors=Fraction(takes), others=Fraction(shared) - Fraction(takes))


QUIET = SettingEvidence(elapsed_ms=10_000, cpu_ms={P1: 12_000.0, P2: 7_900.0}, stolen_ms=100, waiting_ms=9_000.0)
SHORT_LOAD = replace(QUIET, cpu_ms={P1: 12_000.0, P2: 4_000.0})


def test_expected_conditions_are_no_disturbance() -> None:
    assert disturbance(QUIET, 2, load=share(0.8)) == ""


def test_load_that_does_not_get_its_reserve_disturbs() -> None:
    assert disturbance(SHORT_LOAD, 2, load=share(0.8)) == "the load in P2 got 0.40 LP where 0.80 are reserved"
    assert disturbance(SHORT_LOAD, 2, load=None) == "", "browsers may rest"


def test_p1_surplus_disturbs_nobody() -> None:
    """Three threads that sleep and wake got 0.31 LP of a group that reserves 0.2."""
    woken = replace(QUIET, cpu_ms={P1: 3_100.0, P2: 16_800.0})

    assert disturbance(woken, 2, load=share(1.8)) == ""
    assert disturbance(replace(woken, cpu_ms={P1: 2_100.0, P2: 16_700.0}), 2, load=share(1.8)).startswith("the load")


def test_stolen_time_disturbs() -> None:
    stolen = replace(QUIET, stolen_ms=1_100)

    assert disturbance(stolen, 2, load=None) == ("the machine below took 5.5 % of the processors' time, and 5 % may be")


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
def test_log_keeps_evidence_and_reads_lines_without_any(evidence: SettingEvidence | None) -> None:
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
        "busy-loop left 33 % of 1.8 LP. Of 1.8 LP, make in /user.slice had 20 %. The limit of P2 stopped its threads "
        "for 0.4 s, added up over the processors."
    )
    assert describe_idle("timer", an_evidence(200.0, 1000.0), host).endswith("had it: the load waited.")
    assert not leaves_idle(an_evidence(200.0, 1550.0), shared_processors(host, 2))
