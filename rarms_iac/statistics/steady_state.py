"""Finds warm-up and steady state by change points, and cuts a series there."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import isnan, sqrt

from rarms_iac.model.outcomes import Unsteady
from rarms_iac.model.series import Series, columns_of
from rarms_iac.statistics.samples import response_times

FEWEST = 40
"""In a shorter series no change can be distinguished from noise: it is taken as steady."""

_MAXIMUM = "maximum_response_time"
_BLOCKS, _FEWEST_BLOCKS = 40, 10
_SHORTEST_BLOCK, _LONGEST_BLOCK = 5, 50  # samples; in series of more than 2,000, blocks are longer
_DEPENDENT = 1.5
"""Blocks with a higher first autocorrelation, in its standard deviations, are too short for their noise."""

_MOST_WARM_UP = 0.25  # a warm-up that takes more of the series leaves no steady state


def find_steady_series(series: Series) -> int | Unsteady:
    """Find where a series begins to be steady, by its response times; unsteady where its host had not settled.

    Args:
        series: the samples of one component at one setting, in order.

    Returns:
        As of `find_steady_part`, among the jobs that answered.
    """
    if series.unsettled:
        return Unsteady(reason=series.unsettled)
    samples = columns_of(series.samples)
    return samples.remember("steady from", lambda: find_steady_part(response_times(samples)))


def find_steady_part(times: Sequence[float]) -> int | Unsteady:
    """Find where response times begin to be steady.

    Args:
        times: in ms, in the order in which their jobs ended.

    Returns:
        The number, from 0, of the first steady one: what is before it is warm-up, at most a quarter of all. Fewer
            than `FEWEST` are taken as steady. `Unsteady` where no such part is left.
    """
    first = 0
    while True:
        rest = times[first:]
        if len(rest) < FEWEST:
            return first
        change = _find_change(rest)
        if change is None:
            return first
        first += change.at
        if first > _MOST_WARM_UP * len(times):
            return Unsteady(reason=change.describe(len(times)))


def steady_series(index: str, series: Series, first: int) -> Series:
    """Select the samples that an index is made of.

    The maximum is of all samples: no warm-up excuses a late answer.

    Args:
        index: the index's name.
        series: the samples of one component at one setting, in order.
        first: the number (from 0) of the answer from which the series is steady.

    Returns:
        The whole series for the maximum; for every other index the part without its warm-up.
    """
    return series if index == _MAXIMUM else without_warm_up(series, first)


def without_warm_up(series: Series, first: int) -> Series:
    """Cut off the warm-up and set the clock back, so that a throughput counts the steady part's own time only.

    Args:
        series: the samples of one component at one setting, in order.
        first: the number (from 0) of the first answer to keep; jobs without an answer are not counted.

    Returns:
        A series that begins at 0 ms; the same series where `first` is 0.

    Raises:
        IndexError: fewer jobs answered.
    """
    if first == 0:
        return series
    samples = columns_of(series.samples)
    answered = [number for number, time in enumerate(samples.response_ms) if not isnan(time)]
    began = samples.began_ms[answered[first]]
    steady = samples.remember(
        ("without warm-up", first), lambda: samples.take(range(answered[first], len(samples)), began)
    )
    return replace(series, samples=steady, elapsed_ms=series.elapsed_ms - began)


def split_series(series: Series, parts: int) -> list[Series]:
    """Cut a series into parts with the same number of samples, but for the last one, each with its own time.

    Args:
        series: at least as many samples as parts, in order.
        parts: how many.

    Returns:
        Series that begin at 0 ms.
    """
    samples = columns_of(series.samples)
    length = len(samples) // parts
    starts = [number * length for number in range(parts)]
    times = [0.0, *(samples.began_ms[start] for start in starts[1:]), series.elapsed_ms]
    return [
        replace(series, samples=samples.take(range(start, end), began), elapsed_ms=ended - began)
        for (start, end), (began, ended) in zip(pairwise([*starts, len(samples)]), pairwise(times), strict=True)
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Change:
    at: int
    before: float
    after: float

    def describe(self, count: int) -> str:
        levels = f"from {self.before:.4g} ms to {self.after:.4g} ms"
        return f"its response times still changed within {count} samples, {levels}"


def _find_change(numbers: Sequence[float]) -> _Change | None:
    """The clearest change of level, None if chance explains it."""
    length, means = _block_means(numbers)
    noise = _noise(means)
    if noise == 0.0 and means.count(means[0]) == len(means):
        return None
    best, split = 0.0, 0
    total, below = sum(means), 0.0
    for count in range(1, len(means)):
        below += means[count - 1]
        difference = abs(below / count - (total - below) / (len(means) - count))
        clear = difference / sqrt(1.0 / count + 1.0 / (len(means) - count))
        if clear > best:
            best, split = clear, count
    if best <= _limit(len(means)) * noise:
        return None
    below = sum(means[:split])
    return _Change(at=split * length, before=below / split, after=(total - below) / (len(means) - split))


def _block_means(numbers: Sequence[float]) -> tuple[int, list[float]]:
    """Cut a series into blocks of a length, whose means hardly depend on their neighbours as far as that can be had.

    What goes up and down within some fifty samples is noise: of real processes it has a memory, since they are moved
    from processor to processor, and find their caches cold. Blocks shorter than it make a change of its every turn.
    What changes more slowly is a change, so blocks get no longer than that (batch means, Law and Carson 1979).
    """
    length = max(_SHORTEST_BLOCK, len(numbers) // _BLOCKS)
    while True:
        means = [sum(numbers[start : start + length]) / length for start in range(0, len(numbers) - length + 1, length)]
        is_longest = len(means) < 2 * _FEWEST_BLOCKS or 2 * length > _LONGEST_BLOCK
        if is_longest or _first_autocorrelation(means) <= _DEPENDENT / sqrt(len(means)):
            return length, means
        length *= 2


def _first_autocorrelation(means: Sequence[float]) -> float:
    mean = sum(means) / len(means)
    away = [each - mean for each in means]
    variance = sum(each * each for each in away)
    return sum(sooner * later for sooner, later in pairwise(away)) / variance if variance else 0.0


def _noise(means: Sequence[float]) -> float:
    """The standard deviation of a block's mean, from neighbours only: a drift hardly moves it (von Neumann)."""
    squares = sum((later - sooner) ** 2 for sooner, later in pairwise(means))
    return sqrt(squares / (2 * (len(means) - 1)))


def _limit(blocks: int) -> float:
    """How clear the clearest change of so many blocks is by chance in one steady series of seventy (simulated)."""
    return 3.45 + 5.0 / blocks
