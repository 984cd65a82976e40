"""The file of a simulated host: only what rarms wrote is believed."""

import json
from collections import Counter
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.model.capacity import packs
from rarms_iac.model.claims import Claim
from rarms_iac.model.state import RunState
from rarms_iac.providers.simulated.content import (
    Registry,
    SimulatedMachine,
    empty,
    next_id,
    read_content,
    write_content,
)
from rarms_iac.providers.simulated.reserve_packing import CAPACITY, reserves_fit
from rarms_iac.storage.append import Damaged, sealed_line
from rarms_iac.storage.codec import NotDecodable
from tests.builders import a_capacity
from tests.builders_plan import settings

SETTINGS = settings("vision \u2603\nrarms")
ID = next_id(empty("onboard"), "vision")
MACHINE = SimulatedMachine(id=ID, settings=SETTINGS, state=RunState.RUNNING, notes='quotes " and \\ and \u2028')
CONTENT = replace(empty("onboard"), made=3).with_machine(MACHINE)

PATH = Path("onboard.json")


def file_with(old: bytes, new: bytes) -> bytes:
    """A file whose checksum is right, with another text."""
    record = json.loads(write_content(CONTENT).replace(old, new))
    return sealed_line({name: value for name, value in record.items() if name not in {"length", "checksum"}})


def test_content_reads_back_as_written() -> None:
    with_registry = CONTENT.with_registry(ID, Registry())

    assert read_content(write_content(CONTENT), PATH) == CONTENT
    assert read_content(write_content(with_registry), PATH) == with_registry


def test_ids_are_traceable_and_unique() -> None:
    assert empty("onboard") == empty("onboard")
    assert empty("onboard").id != empty("other").id
    assert next_id(CONTENT, "vision") != ID


def test_line_ends_of_git_do_no_harm() -> None:
    assert read_content(write_content(CONTENT).replace(b"\n", b"\r\n"), PATH) == CONTENT


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"{}",
        b"\xff\xfe",
        sealed_line({"made": 1}),
        write_content(CONTENT)[:-1],
        write_content(CONTENT) + b"\n",
        write_content(CONTENT) * 2,
        write_content(CONTENT) + b"{",
        write_content(CONTENT).replace(b'"made":3', b'"made":4'),
        file_with(b'"made":3', b'"made":true'),
        file_with(b'"made":3', b'"made":-3'),
        file_with(b'"made":3', b'"made":3,"more":1'),
        file_with(b'"state":"running"', b'"state":"dancing"'),
        file_with(b"simulated-host/1", b"simulated-host/2"),
    ],
    ids=range(14),
)
def test_what_is_not_such_a_file_is_damage(data: bytes) -> None:
    with pytest.raises((Damaged, NotDecodable)):
        read_content(data, PATH)


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
