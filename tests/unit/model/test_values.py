"""Amounts as they are read, performance indexes, and processors of components together."""

import hashlib
from dataclasses import replace
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rarms_iac.model.experiment import ProcessorNumber, ProcessorSource, most_at_once, processor_number, together
from rarms_iac.model.host import SchedulerType, SimulatedHost, host_identity
from rarms_iac.model.indexes import INDEXES, find_index, percentile_of
from rarms_iac.model.quantities import NotAQuantity, Unit, parse_quantity
from rarms_iac.model.run import Run
from rarms_iac.model.series import Sample, columns_of
from rarms_iac.statistics.samples import deadline_misses, ends_ms, response_times, successes
from tests.builders import a_component, a_run
from tests.effort import examples


@pytest.mark.parametrize("text", ["70 %", "70%", "70 % of host"])
def test_a_share_of_a_host_may_say_so(text: str) -> None:
    assert parse_quantity(text, Unit.SHARE, Unit.PROCESSORS) == (Unit.SHARE, Fraction(70))


@pytest.mark.parametrize("text", ["1.4 LP of host", "70 % of HOST", "70 of host", "70 % of host of host"])
def test_nothing_else_is_of_a_host(text: str) -> None:
    with pytest.raises(NotAQuantity):
        parse_quantity(text, Unit.SHARE, Unit.PROCESSORS)


def test_share_of_no_host_names_none() -> None:
    with pytest.raises(NotAQuantity):
        parse_quantity("70 % of host", Unit.SHARE)


def test_every_index_is_found_by_its_own_name() -> None:
    assert [find_index(name) for name in INDEXES] == list(INDEXES.values())
    assert all(index.name == name and index.description for name, index in INDEXES.items())


@pytest.mark.parametrize(
    ("name", "direction", "unit"),
    [
        ("mean_response_time", "at_most", Unit.TIME),
        ("jitter", "at_most", Unit.TIME),
        ("success_rate", "at_least", Unit.SHARE),
        ("throughput", "at_least", Unit.RATE),
        ("deadline_miss_rate", "at_most", Unit.SHARE),
        ("p95_response_time", "at_most", Unit.TIME),
    ],
)
def test_index_knows_unit_and_good_side(name: str, direction: str, unit: Unit) -> None:
    index = find_index(name)

    assert index is not None
    assert (index.direction, index.unit) == (direction, unit)


@pytest.mark.parametrize(
    ("name", "percent"),
    [
        ("p50_response_time", Fraction(50)),
        ("p99.9_response_time", Fraction(999, 10)),
        ("p5_response_time", Fraction(5)),
    ],
)
def test_a_percentile_says_its_per_cent(name: str, percent: Fraction) -> None:
    assert percentile_of(name) == percent


@pytest.mark.parametrize(
    "name",
    [
        "p0_response_time",
        "p05_response_time",
        "p95.0_response_time",
        "p100_response_time",
        "p95",
        "p95_response_time\n",
    ],
)
def test_a_percentile_has_one_spelling(name: str) -> None:
    assert find_index(name) is None


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


MACHINE = "5b0f6a3e-9d1c-4d57-8b7e-2f6a1c0d9e84"


def test_host_identity_is_a_digest() -> None:
    assert host_identity(MACHINE) == hashlib.sha256(f"rarms host {MACHINE}".encode()).hexdigest()[:32]


def test_identity_ignores_blanks_and_case() -> None:
    assert host_identity(f" {MACHINE.upper()}\n") == host_identity(MACHINE)
    assert host_identity(" \n") == ""


@pytest.mark.parametrize(
    ("host", "scheduler"),
    [
        (SimulatedHost(smt=True), SchedulerType.CORE),
        (SimulatedHost(smt=True, windows_build=14393), SchedulerType.CLASSIC),
        (SimulatedHost(smt=True, client=True), SchedulerType.CLASSIC),
        (SimulatedHost(smt=True, scheduler=SchedulerType.CLASSIC), SchedulerType.CLASSIC),
        (SimulatedHost(), SchedulerType.CLASSIC),
    ],
)
def test_simulated_server_has_its_windows_scheduler(host: SimulatedHost, scheduler: SchedulerType) -> None:
    assert host.scheduler_type is scheduler


NUMBERS = st.floats(min_value=0.0, max_value=1e9)
SAMPLES = st.lists(
    st.builds(
        Sample,
        began_ms=NUMBERS,
        response_ms=st.none() | NUMBERS,
        successful=st.booleans(),
        count=NUMBERS,
        failure=st.sampled_from(["", "it died"]),
    ),
    max_size=20,
)


@settings(max_examples=examples(100))
@given(samples=SAMPLES, data=st.data())
def test_columns_equal_their_samples(samples: list[Sample], data: st.DataObject) -> None:
    columns = columns_of(samples)
    part = data.draw(st.slices(max(1, len(samples))))

    assert list(columns) == samples
    assert columns == tuple(samples) == columns
    assert columns[part] == samples[part]
    assert hash(columns) == hash(tuple(samples))
    assert all(columns[at] == sample for at, sample in enumerate(samples))
    if samples:
        assert columns != [*samples[:-1], replace(samples[-1], successful=not samples[-1].successful)]


@settings(max_examples=examples(100))
@given(samples=SAMPLES)
def test_numbers_of_columns_are_those_of_samples(samples: list[Sample]) -> None:
    columns, run = columns_of(samples), a_run(deadline="40 ms")

    assert response_times(columns) == [sample.response_ms for sample in samples if sample.response_ms is not None]
    assert successes(columns) == [float(sample.successful) for sample in samples]
    assert ends_ms(columns) == [sample.began_ms + (sample.response_ms or 0.0) for sample in samples]
    assert deadline_misses(columns, run) == [float(is_late(sample, run)) for sample in samples]


def is_late(sample: Sample, run: Run) -> bool:
    assert run.deadline is not None
    return sample.response_ms is None or sample.response_ms > run.deadline


def test_derived_columns_are_kept() -> None:
    columns = columns_of([Sample(began_ms=0.0, response_ms=1.0, successful=True)])
    asked: list[str] = []

    def work_out() -> int:
        asked.append("")
        return 7

    assert [columns.remember("answer", work_out) for _ in range(3)] == [7, 7, 7]
    assert len(asked) == 1
