"""Whether reserves fit onto logical processors."""

from collections import Counter
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.model.capacity import packs
from rarms_iac.model.claims import Claim
from rarms_iac.providers.simulated.reserve_packing import CAPACITY, reserves_fit
from tests.builders import a_capacity


def fits_somehow(sizes: list[int], processors: int) -> bool:
    """Every placement there is."""
    return any(
        all(
            sum(size for size, at in zip(sizes, places, strict=True) if at == processor) <= CAPACITY
            for processor in range(processors)
        )
        for places in product(range(processors), repeat=len(sizes))
    )


@pytest.mark.parametrize(
    ("sizes", "processors", "expected"),
    [
        ([], 1, True),
        ([0, 0, 0], 1, True),
        ([100], 1, True),
        ([60, 60, 60], 2, False),
        ([60, 50, 40, 30, 20], 2, True),  # first fit fails where it begins with 60 + 40
        ([101], 4, False),
        ([50, 50, 50, 50], 2, True),
        ([34] * 9, 3, False),
        ([46, 42, 40, 38, 34], 2, False),
        ([44, 24, 24, 22, 21, 17, 16, 16, 16], 2, True),  # 44+24+16+16, 24+22+21+17+16
    ],
)
def test_examples(sizes: list[int], processors: int, expected: bool) -> None:
    assert reserves_fit(Counter(sizes), processors) is expected


@given(st.lists(st.integers(0, 100), max_size=6), st.integers(1, 3))
def test_the_answer_is_that_of_trying_everything(sizes: list[int], processors: int) -> None:
    assert reserves_fit(Counter(sizes), processors) is fits_somehow(sizes, processors)


@given(st.lists(st.tuples(st.integers(1, 4), st.integers(0, 100)), max_size=8), st.integers(4, 8))
def test_what_the_planner_promises_fits(claims: list[tuple[int, int]], processors: int) -> None:
    sizes: Counter[int] = Counter()
    for count, reserve in claims:
        sizes[reserve] += count

    if packs([Claim(processors=count, reserve=reserve) for count, reserve in claims], a_capacity(processors)):
        assert reserves_fit(sizes, processors)
