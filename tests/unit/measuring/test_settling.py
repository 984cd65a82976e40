"""When a host has forgotten how its work began: time, and consumption that has come down to what is reserved."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import pytest

from rarms_iac.measuring.sampling import PATIENCE_FACTOR, Contender, Settling, wants_all_processors
from rarms_iac.model.loads import LOADS_WITHOUT_ENTRY, Browser, BusyLoop, Interference
from rarms_iac.model.series import Sample
from rarms_iac.statistics.setting_time import MEMORY_FACTOR

LEAST = 100.0 * MEMORY_FACTOR
P1 = Contender(components=("quick",), processors=0.5, excess_forbids_verdict=True)


@dataclass
class Running:
    """Work whose consumption is set by hand."""

    now: float = 0.0
    consumed: dict[str, float] = field(default_factory=dict)

    def used_processors(self, partition: str) -> None:
        """Not seen."""

    def restart_load(self) -> bool:
        return False

    def elapsed_ms(self) -> float:
        return self.now

    def cpu_ms(self, component: str) -> float | None:
        return self.consumed.get(component)

    def samples(self) -> Iterator[tuple[str, Sample]]:
        return iter(())

    def count_from_now(self) -> None:
        """Not asked for."""

    def evidence(self) -> None:
        """It counts nothing."""


def going_on(settling: Settling, running: Running, until: float, processors: float) -> None:
    """Jobs of 10 ms, consuming so much meanwhile."""
    while running.now < until:
        running.now += 10.0
        running.consumed["quick"] = running.consumed.get("quick", 0.0) + 10.0 * processors
        settling.record_job(running, "quick")


def test_however_quick_the_jobs_are_the_schedulers_memory_passes_many_times_first() -> None:
    settling, running = Settling(scheduler_window_ms=100.0, contenders=(P1,)), Running()
    going_on(settling, running, LEAST - 10.0, 0.4)

    assert not settling.is_over(running.now)
    going_on(settling, running, LEAST, 0.4)
    assert settling.is_over(running.now)
    assert settling.excess_message() == ""


def test_who_gets_more_than_its_reserve_is_waited_for_until_that_has_passed() -> None:
    settling, running = Settling(scheduler_window_ms=100.0, contenders=(P1,)), Running()
    going_on(settling, running, 2 * LEAST, 1.0)

    assert not settling.is_over(running.now)
    going_on(settling, running, 2.5 * LEAST, 0.5)
    assert not settling.is_over(running.now), "half of the last while is from before"
    going_on(settling, running, 3 * LEAST + 10.0, 0.5)
    assert settling.is_over(running.now)
    assert settling.excess_message() == ""


@pytest.mark.parametrize("excess_forbids_verdict", [True, False])
def test_what_never_comes_down_ends_without_a_verdict_where_it_would_have_to(excess_forbids_verdict: bool) -> None:
    contender = Contender(components=("quick",), processors=0.5, excess_forbids_verdict=excess_forbids_verdict)
    settling, running = Settling(scheduler_window_ms=100.0, contenders=(contender,)), Running()
    going_on(settling, running, (PATIENCE_FACTOR + 1) * LEAST, 0.8)

    assert settling.is_over(running.now)
    assert ("quick still consumed 0.8 LP where 0.5 are reserved" in settling.excess_message()) is excess_forbids_verdict


def test_a_job_that_takes_longer_is_looked_at_whole() -> None:
    settling, running = Settling(scheduler_window_ms=100.0, contenders=(P1,)), Running()
    for now, consumed in ((500.0, 500.0), (500.0 + 4 * LEAST, 500.0 + 2 * LEAST)):
        running.now, running.consumed["quick"] = now, consumed
        settling.record_job(running, "quick")
        assert settling.is_over(running.now) is (now > LEAST)


def test_jobs_that_take_longer_than_the_memory_are_not_waited_for_without_an_end() -> None:
    settling, running = Settling(scheduler_window_ms=100.0, contenders=(P1,)), Running()
    for number in range(1, PATIENCE_FACTOR + 2):
        running.now, running.consumed["quick"] = number * 1.5 * LEAST, number * 1.5 * LEAST
        settling.record_job(running, "quick")
        assert settling.is_over(running.now) is (running.now > PATIENCE_FACTOR * LEAST)

    assert "still consumed 1 LP" in settling.excess_message()


def test_where_consumption_cannot_be_told_time_decides() -> None:
    settling, running = Settling(scheduler_window_ms=100.0, contenders=(P1,)), Running(now=LEAST)
    settling.record_job(running, "quick")

    assert settling.is_over(running.now)


@pytest.mark.parametrize(
    ("load", "contends"),
    [
        (BusyLoop(), True),
        (BusyLoop(threads=2), True),
        (BusyLoop(threads=1), False),
        (Browser(instances=9), False),
        (LOADS_WITHOUT_ENTRY["bursts-100"], False),
    ],
)
def test_only_a_load_that_wants_all_makes_consumption_a_witness(load: Interference, contends: bool) -> None:
    assert wants_all_processors(load, 2) is contends
    assert not wants_all_processors(None, 2)
