from fractions import Fraction
from itertools import product
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.model.capacity import Capacity, capacity_of, core_sharing, decide_packing, fits, packs
from rarms_iac.model.claims import ANY_THREAD, Claim, CoreSharing, load_of
from rarms_iac.model.host import SERVER_2019, SchedulerType
from rarms_iac.model.quantities import Bytes, LogicalProcessors
from rarms_iac.model.seen_host import unseen
from tests.builders import a_capacity, a_host
from tests.strategies import facts_for

ONE_BY_ONE = [
    ([], 1, True),
    ([0, 0, 0], 1, True),
    ([100], 1, True),
    ([60, 60, 60], 2, False),
    ([60, 50, 40, 30, 20], 2, True),  # first fit fails where it begins with 60 + 40
    ([50, 50, 50, 50], 2, True),
    ([34] * 9, 3, False),
    ([46, 42, 40, 38, 34], 2, False),
    ([44, 24, 24, 22, 21, 17, 16, 16, 16], 2, True),  # 44+24+16+16, 24+22+21+17+16
]


@pytest.mark.parametrize(("sizes", "processors", "expected"), ONE_BY_ONE)
def test_examples_of_packing(sizes: list[int], processors: int, expected: bool) -> None:
    assert decide_packing([claim(size) for size in sizes], a_capacity(processors)) is expected


def claim(reserve: int, processors: int = 1, memory: int = 0) -> Claim:
    return Claim(processors=processors, reserve=reserve, memory=memory)


def test_virtual_processor_needs_one_logical_one() -> None:
    assert not packs([claim(60), claim(60), claim(60)], a_capacity(2))
    assert packs([claim(60), claim(60), claim(40, 2)], a_capacity(2))


def test_a_packing_that_first_fit_misses_is_found() -> None:
    assert packs([claim(size) for size in (44, 43, 39, 37, 19, 18)], a_capacity(2))


def test_exact_packing_is_found_without_repetition() -> None:
    sizes = (52, 44, 43, 39, 34, 31, 26, 23, 21, 17, 16, 13, 12, 11, 9, 9)
    assert sum(sizes) == 400

    assert packs([claim(size) for size in sizes], a_capacity(4))


def test_reserve_on_missing_processors_does_not_hold() -> None:
    assert not packs([claim(1, 3)], a_capacity(2))
    assert packs([claim(0, 3)], a_capacity(2))


def test_what_is_kept_for_host_counts_against_sum() -> None:
    room = Capacity(logical_processors=2, processors=LogicalProcessors(Fraction(3, 2)), memory=Bytes(100))

    assert fits(room, [claim(75, 2, 100)])
    assert not fits(room, [claim(76, 2, 100)])
    assert not fits(room, [claim(75, 2, 101)])


def test_the_smaller_of_manifest_and_fact_counts() -> None:
    host = a_host(logical_processors=4, memory="4 GiB", keep_processor="25 %", keep_memory="1 GiB")

    found = capacity_of(host, facts_for(host, logical_processors=2))

    assert found == Capacity(logical_processors=2, processors=LogicalProcessors(Fraction(1)), memory=Bytes(3 * 2**30))
    assert unseen(host, "robot").capacity.processors == 3


SMT = {"smt": True, "scheduler": SchedulerType.CORE}


@pytest.mark.parametrize(
    ("facts", "threads_per_core", "sharing"),
    [
        (SMT, None, CoreSharing(threads=2, used=2)),
        (SMT, 0, CoreSharing(threads=2, used=2)),
        (SMT, 1, CoreSharing(threads=2, used=1)),
        (SMT, 4, CoreSharing(threads=2, used=2)),
        (SMT | {"os_build": SERVER_2019 - 1}, None, CoreSharing(threads=2, used=1)),
        (SMT | {"scheduler": SchedulerType.UNKNOWN}, 1, CoreSharing(threads=2, used=1)),
        (SMT | {"scheduler": SchedulerType.UNKNOWN, "os_build": SERVER_2019 - 1}, 1, ANY_THREAD),
        (SMT | {"scheduler": SchedulerType.CLASSIC}, 1, ANY_THREAD),
        (SMT | {"smt": False}, 1, ANY_THREAD),
    ],
)
def test_how_a_machine_takes_cores(facts: dict[str, Any], threads_per_core: int | None, sharing: CoreSharing) -> None:
    assert core_sharing(facts_for(a_host(logical_processors=8), **facts), threads_per_core) == sharing


def test_core_never_runs_two_machines() -> None:
    narrow = CoreSharing(threads=2, used=2)
    seven = [narrow.claim(1, 95, 0)] * 7

    assert load_of(seven).percent == 7 * 2 * 95
    assert all(each.idle == 1 for each in seven)
    assert not fits(a_capacity(8, narrow), seven)
    assert fits(a_capacity(8, narrow), seven[:4])
    assert fits(a_capacity(8, narrow), [narrow.claim(2, 95, 0)] * 4)
    assert not packs([CoreSharing(threads=2, used=1).claim(5, 10, 0)], a_capacity(8, narrow))


@given(st.lists(st.integers(1, 100), max_size=6), st.integers(1, 3))
def test_packing_agrees_with_trying_every_way(sizes: list[int], processors: int) -> None:
    ways = product(range(processors), repeat=len(sizes))
    possible = any(
        all(
            sum(s for s, at in zip(sizes, way, strict=True) if at == processor) <= 100
            for processor in range(processors)
        )
        for way in ways
    )

    assert packs([claim(size) for size in sizes], a_capacity(processors)) is possible
