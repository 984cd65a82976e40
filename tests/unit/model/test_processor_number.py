"""How many virtual processors a partition has."""

import pytest

from rarms_iac.model.processor_number import ProcessorNumber, ProcessorSource, most_at_once, processor_number, together
from tests.builders import a_component

UNFIXED, NARROW, WIDE = a_component("open"), a_component("one", processors=1), a_component("two", processors=2)
SEEN = {("open",): 1, ("one", "open"): 3}


@pytest.mark.parametrize(
    ("members", "requested", "number", "source"),
    [
        ((UNFIXED,), 7, 7, ProcessorSource.MANIFEST),
        ((WIDE,), None, 2, ProcessorSource.MANIFEST),
        ((NARROW, WIDE), None, 3, ProcessorSource.MANIFEST),
        ((UNFIXED,), None, 1, ProcessorSource.USED),
        ((UNFIXED, NARROW), None, 3, ProcessorSource.USED),
        ((UNFIXED, WIDE), None, 3, ProcessorSource.MEMBERS),
        ((a_component("new"),), None, 4, ProcessorSource.HOST),
        ((a_component("new"), NARROW), None, 4, ProcessorSource.HOST),
    ],
)
def test_manifest_comes_before_observed_and_host(
    members: tuple[object, ...], requested: int | None, number: int, source: ProcessorSource
) -> None:
    found = processor_number(members, requested, 4, SEEN.get)  # type: ignore[arg-type]  # components

    assert found == ProcessorNumber(number=number, source=source)


def test_compound_has_between_member_and_host_processors() -> None:
    assert together([1, 2], 4) == 3
    assert together([3, 2], 4) == 4
    assert together([6, 1], 4) == 6


def test_momentary_use_does_not_count() -> None:
    assert most_at_once({0: 50.0, 1: 49.0, 3: 1.0}, 100.0) == 1
    assert most_at_once({0: 50.0, 1: 48.5, 2: 0.7, 3: 0.8}, 100.0) == 2
    assert most_at_once({}, 0.0) == 1
