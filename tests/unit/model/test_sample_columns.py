"""Samples as columns are what the same samples are as objects."""

from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st

from rarms_iac.model.run import Run
from rarms_iac.model.series import Sample, columns_of
from rarms_iac.statistics.samples import deadline_misses, ends_ms, response_times, successes
from tests.builders import a_run
from tests.effort import examples

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
