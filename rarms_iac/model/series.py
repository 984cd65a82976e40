"""What the jobs of a component showed: samples, many of them as columns, and the series of a setting."""

from array import array
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isnan, nan
from operator import attrgetter
from typing import TypeVar, cast, overload

LARGEST_SAMPLE = 1e12
"""The largest time (in milliseconds: thirty years) or count of a sample; sums and squares of many stay finite."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """The result of one job of a component."""

    began_ms: float  # since the setting began; of a periodic job, its scheduled start
    response_ms: float | None  # None: no answer
    successful: bool
    count: float = 1.0  # how much it did
    failure: str = ""  # why it is a failed sample (death, time-out, unreadable); empty: it is none


FIRST_SKIPPED = 3
"""Skipped lines that are kept."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SkippedLines:
    """Lines of a component's output that are not samples: other text than JSON objects, or no match of the pattern."""

    count: int = 0
    first: tuple[str, ...] = ()  # at most `FIRST_SKIPPED`, shortened, invisible characters spelt out


@dataclass(frozen=True, slots=True, kw_only=True)
class HeardMessages:
    """The messages that the subscriber next to a component heard, and its own delay."""

    input: str  # the topic
    inputs: int = 0
    outputs: int = 0
    unmatched: int = 0  # outputs with the stamp of no input
    delay_ms: float | None = None  # of a message that the subscriber sends to itself, median; None: not measured
    p99_delay_ms: float | None = None
    ahead_ms: float = 0.0  # by which the stamps of inputs are ahead of this machine's clock when they come, median
    simulated_time: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """All samples of a component at one setting, in the order in which their jobs ended."""

    component: str
    samples: Sequence[Sample]  # `SampleColumns`, where there may be many
    elapsed_ms: float
    cpu_ms: float | None = None  # processor time that the component consumed; None: unknown here
    unsettled: str = ""  # why it says nothing of the next hour: the host had not settled; empty: it had
    wanders: bool = False  # real processes, all samples of a setting: the machine's speed changes for seconds

    starts: tuple[int, ...] = ()  # numbers of the samples with which its load began again: after the first start
    runs: tuple[int, ...] = ()  # numbers of the samples with which the component itself began again, in a further run


MOST_SAMPLES = 40_000
"""Samples that a setting may have of a component: the error that is said of it covers looks at up to so many."""

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampleColumns(Sequence[Sample]):
    """Samples in the order in which their jobs ended, equal to any sequence of equal samples.

    NOTE: a `Sample` is made only for who asks for one. What looks at a whole log takes the columns: a million samples
    as objects take seconds and 300 MB.
    """

    began_ms: "array[float]"
    response_ms: "array[float]"  # not a number: no answer
    successful: bytes  # 1 or 0
    counts: "array[float]"
    failures: Mapping[int, str]  # of failed samples alone, by their numbers, ascending
    known: dict[Hashable, object] = field(default_factory=dict, repr=False)  # what `remember` keeps

    def __len__(self) -> int:
        return len(self.began_ms)

    @overload
    def __getitem__(self, at: int) -> Sample: ...
    @overload
    def __getitem__(self, at: slice) -> "SampleColumns": ...
    def __getitem__(self, at: int | slice) -> "Sample | SampleColumns":
        numbers = range(len(self))[at]
        return self.take(numbers) if isinstance(numbers, range) else self._sample(numbers)

    def __iter__(self) -> Iterator[Sample]:
        return map(self._sample, range(len(self)))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence):
            return NotImplemented
        return self is other or (len(self) == len(other) and all(map(Sample.__eq__, self, other)))

    def __hash__(self) -> int:
        return hash(tuple(self))

    def take(self, numbers: Sequence[int], earlier_ms: float = 0.0) -> "SampleColumns":
        """Take some of the samples.

        Args:
            numbers: Which, from 0, in the order in which they are wanted.
            earlier_ms: By how much the clock is set back.
        """
        return SampleColumns(
            began_ms=array("d", [self.began_ms[at] - earlier_ms for at in numbers]),
            response_ms=array("d", map(self.response_ms.__getitem__, numbers)),
            successful=bytes(map(self.successful.__getitem__, numbers)),
            counts=array("d", map(self.counts.__getitem__, numbers)),
            failures={new: self.failures[at] for new, at in enumerate(numbers) if at in self.failures},
        )

    def remember(self, key: Hashable, work_out: Callable[[], T]) -> T:
        """Work something out of these samples once, however often it is asked for.

        Args:
            key: What is asked for, with all that the answer depends on apart from the samples.
            work_out: Gives the answer; called at the first time.
        """
        if key not in self.known:
            self.known[key] = work_out()
        return cast("T", self.known[key])

    def _sample(self, at: int) -> Sample:
        time = self.response_ms[at]
        return Sample(
            began_ms=self.began_ms[at],
            response_ms=None if isnan(time) else time,
            successful=bool(self.successful[at]),
            count=self.counts[at],
            failure=self.failures.get(at, ""),
        )


def columns_of(samples: Iterable[Sample]) -> SampleColumns:
    """Return samples as columns; what is in columns already stays as it is.

    Args:
        samples: In the order in which their jobs ended.
    """
    if isinstance(samples, SampleColumns):
        return samples
    rows = list(samples)
    return SampleColumns(
        began_ms=array("d", map(attrgetter("began_ms"), rows)),
        response_ms=array("d", [nan if sample.response_ms is None else sample.response_ms for sample in rows]),
        successful=bytes(map(attrgetter("successful"), rows)),
        counts=array("d", map(attrgetter("count"), rows)),
        failures={at: sample.failure for at, sample in enumerate(rows) if sample.failure},
    )


def join_series(parts: Sequence[Series]) -> Series:
    """Join the runs of a component at one setting to one series, in which each run follows the one before.

    Args:
        parts: At least one, of the same component; each begins at 0 ms.

    Returns:
        At most `MOST_SAMPLES` samples: what is beyond them is left out, with its time. A single part stays as it is.
    """
    if len(parts) == 1 and len(parts[0].samples) <= MOST_SAMPLES:
        return parts[0]
    joined = parts[0] if len(parts[0].samples) <= MOST_SAMPLES else first_samples(parts[0], MOST_SAMPLES)
    for part in parts[1:]:
        room = MOST_SAMPLES - len(joined.samples)
        if room <= 0:
            break
        joined = _followed_by(joined, part if len(part.samples) <= room else first_samples(part, room))
    return joined


def first_samples(series: Series, count: int) -> Series:
    """Take the first samples of a series, as if it had ended then.

    Args:
        series: with more samples than `count`.

    Returns:
        A series that ends as the next job begins; of its processor time it has the part that goes by its time.
    """
    samples = columns_of(series.samples)
    ends = max(samples.began_ms[count], 0.0)
    part = ends / series.elapsed_ms if series.elapsed_ms else 1.0
    return replace(
        series,
        samples=samples.take(range(count)),
        elapsed_ms=ends,
        cpu_ms=None if series.cpu_ms is None else series.cpu_ms * part,
        starts=tuple(start for start in series.starts if start < count),
        runs=tuple(run for run in series.runs if run < count),
    )


def _followed_by(series: Series, later: Series) -> Series:
    sooner, count = columns_of(series.samples), len(series.samples)
    rest = columns_of(later.samples)
    samples = SampleColumns(
        began_ms=sooner.began_ms + array("d", [began + series.elapsed_ms for began in rest.began_ms]),
        response_ms=sooner.response_ms + rest.response_ms,
        successful=sooner.successful + rest.successful,
        counts=sooner.counts + rest.counts,
        failures={**sooner.failures, **{count + at: reason for at, reason in rest.failures.items()}},
    )
    unknown = series.cpu_ms is None or later.cpu_ms is None
    return replace(
        series,
        samples=samples,
        elapsed_ms=series.elapsed_ms + later.elapsed_ms,
        cpu_ms=None if unknown else (series.cpu_ms or 0.0) + (later.cpu_ms or 0.0),
        wanders=series.wanders or later.wanders,
        starts=(*series.starts, *(count + start for start in later.starts)),
        runs=(*series.runs, count, *(count + run for run in later.runs)),
    )
