"""From the samples of a series to the numbers that an index is made of."""

from collections.abc import Sequence

from rarms_iac.model.measurement import Sample, Series
from rarms_iac.model.system import Run


def response_times(samples: Sequence[Sample]) -> list[float]:
    """The response times, in ms, of all jobs that answered, in order."""
    return [sample.response_ms for sample in samples if sample.response_ms is not None]


def successes(samples: Sequence[Sample]) -> list[float]:
    """1 for a job that succeeded, 0 for every other, in order."""
    return [1.0 if sample.successful else 0.0 for sample in samples]


def misses(samples: Sequence[Sample], run: Run) -> list[float]:
    """1 for a job that missed its deadline or gave no answer, 0 for every other, in order."""
    deadline = float("inf") if run.deadline is None else float(run.deadline)
    return [1.0 if sample.response_ms is None or sample.response_ms > deadline else 0.0 for sample in samples]


def end_ms(sample: Sample) -> float:
    """When the job was over, in ms since the setting began; without an answer, when it began."""
    return sample.began_ms + (sample.response_ms or 0.0)


def failed(series: Series) -> int:
    """How many samples are failed ones: death, time-out, unreadable."""
    return sum(1 for sample in series.samples if sample.failure)
