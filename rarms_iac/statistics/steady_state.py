"""Finds warm-up and steady state by change points, cuts a series there, and says how long a setting takes at least."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from math import isnan, sqrt
from typing import Final

from rarms_iac.model.loads import Interference, is_steady
from rarms_iac.model.outcomes import Unsteady
from rarms_iac.model.series import Series, columns_of, join_series
from rarms_iac.statistics.distributions import PERIODIC_STARTS
from rarms_iac.statistics.samples import response_times, starts_differ

FEWEST = 40
"""In a shorter series no change can be distinguished from noise: it is taken as steady."""

_BLOCKS, _FEWEST_BLOCKS = 40, 10
_SHORTEST_BLOCK, _LONGEST_BLOCK = 5, 50  # samples; in series of more than 2,000, blocks are longer
_DEPENDENT = 1.5
"""Blocks with a higher first autocorrelation, in its standard deviations, are too short for their noise."""

_LEAST_CHANGE = 0.01
"""The part of a level by which it must change: deterministic jobs show less, which no threshold asks for."""

_MOST_WARM_UP = 0.25  # a warm-up that takes more of the series leaves no steady state


def steady_part(series: Series) -> Series | Unsteady:
    """Leave out what is not a steady state, by the response times: the warm-up of each run, and runs without any.

    Args:
        series: the samples of one component at one setting, in order.

    Returns:
        The rest as a series that begins at 0 ms, the same series where that is all. `Unsteady`: nothing is left, or
            its host had not settled.
    """
    if series.unsettled:
        return Unsteady(reason=series.unsettled)
    samples = columns_of(series.samples)
    whole = replace(series, samples=samples)
    return samples.remember(("steady", series.elapsed_ms, series.starts, series.runs), lambda: _steady_part(whole))


def _steady_part(series: Series) -> Series | Unsteady:
    found = [_steady_run(run) for run in split_at(series, series.runs)] if series.runs else [_steady_run(series)]
    steady = [run for run in found if isinstance(run, Series)]
    return join_series(steady) if steady else found[-1]


def _steady_run(run: Series) -> Series | Unsteady:
    """Return a run without its warm-up.

    Where the starts of its load differ, a change is looked for among their means.
    """
    times, starts = response_times(run.samples), answered_before(run, run.starts)
    starts = starts if starts_differ(times, starts) else []
    first = find_steady_part(times[: starts[0]] if starts else times)
    if isinstance(first, Unsteady):
        return first
    bounds = [first, *(start for start in starts if start > first), len(times)]
    means = [sum(times[begin:end]) / (end - begin) for begin, end in pairwise(bounds) if end > begin]
    while starts and len(means) >= _FEWEST_BLOCKS and (change := _change_in(means)) is not None:
        first, bounds, means = bounds[change.at], bounds[change.at :], means[change.at :]
        if first > _MOST_WARM_UP * len(times):
            return Unsteady(reason=change.describe(len(times)))
    return without_warm_up(run, first)


def answered_before(series: Series, numbers: Sequence[int]) -> list[int]:
    """Count the jobs that answered before each of these samples.

    Args:
        series: with jobs that may have no answer.

    Returns:
        As many counts; the numbers themselves where all jobs answered.
    """
    samples = columns_of(series.samples)
    if not numbers or not isnan(sum(samples.response_ms)):
        return list(numbers)
    answered = list(accumulate((not isnan(time) for time in samples.response_ms), initial=0))
    return [answered[number] for number in numbers]


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
    cut = answered[first]
    return replace(
        series,
        samples=steady,
        elapsed_ms=series.elapsed_ms - began,
        starts=tuple(start - cut for start in series.starts if start > cut),
        runs=tuple(run - cut for run in series.runs if run > cut),
    )


def split_at(series: Series, numbers: Sequence[int]) -> list[Series]:
    """Cut a series at these samples, each part with its own time.

    Args:
        series: the samples of one component at one setting, in order.
        numbers: of the first samples of all parts but the first, ascending.

    Returns:
        Series that begin at 0 ms, one more than there are numbers; their processor time is not known.
    """
    samples = columns_of(series.samples)
    bounds = [0, *numbers, len(samples)]
    times = [0.0, *(samples.began_ms[number] for number in numbers), series.elapsed_ms]
    return [
        replace(
            series,
            samples=samples.take(range(begin, end), began),
            elapsed_ms=ended - began,
            cpu_ms=None,
            starts=tuple(start - begin for start in series.starts if begin < start < end),
            runs=tuple(run - begin for run in series.runs if begin < run < end),
        )
        for (begin, end), (began, ended) in zip(pairwise(bounds), pairwise(times), strict=True)
    ]


def split_series(series: Series, parts: int) -> list[Series]:
    """Cut a series into parts with the same number of samples, but for the last one, each with its own time.

    Args:
        series: at least as many samples as parts, in order.

    Returns:
        Series that begin at 0 ms.
    """
    length = len(series.samples) // parts
    return split_at(series, [number * length for number in range(1, parts)])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Change:
    at: int
    before: float
    after: float

    def describe(self, count: int) -> str:
        levels = f"from {self.before:.4g} ms to {self.after:.4g} ms"
        return f"its response times still changed within {count} samples, {levels}"


def _find_change(numbers: Sequence[float]) -> _Change | None:
    """Return the clearest change of level, None if chance explains it."""
    length, means = _block_means(numbers)
    change = _change_in(means)
    return change and replace(change, at=change.at * length)


def _change_in(means: Sequence[float]) -> _Change | None:
    """Return the clearest change of level among means of equal worth, None if chance explains it; `at` counts means."""
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
    before, after = below / split, (total - below) / (len(means) - split)
    if abs(after - before) <= _LEAST_CHANGE * max(abs(before), abs(after)):
        return None
    return _Change(at=split, before=before, after=after)


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
    """Return the standard deviation of a block's mean, from neighbours only: a drift hardly moves it (von Neumann)."""
    squares = sum((later - sooner) ** 2 for sooner, later in pairwise(means))
    return sqrt(squares / (2 * (len(means) - 1)))


def _limit(blocks: int) -> float:
    """Return the clearest change of so many blocks by chance in one steady series of seventy (simulated)."""
    return 3.45 + 5.0 / blocks


MEMORY_FACTOR: Final = 30
"""Samples count after this many windows of the scheduler, and are then taken for at least as long again."""

STARTS: Final = 8
"""So often at least a load that never pauses begins in a setting; `PERIODIC_STARTS` times with periodic jobs."""

RESTART_WINDOWS: Final = 5
"""After a further start so many windows of the scheduler are left out, not the `MEMORY_FACTOR` of the first.

What settles then is the load alone. With three a P1 of one processor with a P2 of
two got 24.8 % where it reserves 23.
"""


def least_starts(*, is_periodic: bool) -> int:
    """Say how often a load that never pauses begins before a setting is judged.

    Args:
        is_periodic: whether a component measured with it has a period, and so may lock into a phase of it.

    Returns:
        Starts, the first among them.
    """
    return PERIODIC_STARTS if is_periodic else STARTS


def least_setting_ms(
    samples_ms: float, load: Interference, window_ms: float, *, is_periodic: bool, begins_anew: bool
) -> float:
    """Say how long a setting of a search takes at least under a load.

    Args:
        samples_ms: the time in which the samples come that its thresholds need.
        window_ms: the longest of the host's scheduler.
        begins_anew: whether the host can start a load that never pauses again.

    Returns:
        Milliseconds by the host's clock.
    """
    further_starts = least_starts(is_periodic=is_periodic) - 1 if begins_anew and is_steady(load) else 0
    settles_ms = MEMORY_FACTOR * window_ms
    return settles_ms + max(settles_ms, samples_ms) + further_starts * RESTART_WINDOWS * window_ms
