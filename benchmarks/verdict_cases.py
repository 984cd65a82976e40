"""Seeded series whose truth is known: components near their thresholds, one kind a performance index or more.

What is rare, or takes one of two values only, has kinds of its own: few samples of it may show no spread at all.
"""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from rarms_iac.model.measurement import Sample, Series
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.system import AtLeast, AtMost, Closed, Command, Run, SampleCount, Samples, Stop, Threshold

SAMPLES = 400
MEAN = 100.0
DEADLINE = 120.0
NOISES = (0.01, 0.05, 0.15)
RUN = Run(
    start=Command(words=("job",)),
    files=(),
    environment={},
    folder=".",
    until=SampleCount(samples=SAMPLES),
    timeout=Milliseconds(Fraction(60_000)),
    stop=Stop(),
    arrival=Closed(),
    samples=Samples(source="json_lines"),
    deadline=Milliseconds(Fraction(DEADLINE)),
    failures=0,
)
KINDS = (
    "mean_response_time",
    "mean_response_time of two modes",
    "p95_response_time",
    "p95_response_time of two modes",
    "jitter",
    "jitter of two modes",
    "success_rate",
    "success_rate near 100 %",
    "deadline_miss_rate",
    "throughput",
    "throughput where 10 % fail",
    "throughput where 1 % fails",
)
"""Each begins with its index; the extremes are no kinds: they are judged by what was seen (`extreme_beyond`)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One seeded verdict: the series, and whether the APT is truly met."""

    series: Series
    apt: dict[str, Threshold]
    met: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class _Jobs:
    """Lognormal response times of a known distribution."""

    times: list[float]
    noise: float

    def quantile(self, deviations: float) -> float:
        """The response time that lies so many deviations above the middle one."""
        spread = _spread(self.noise)
        return MEAN * math.exp(spread * deviations - spread**2 / 2)

    def share_below(self, time: float) -> float:
        """The share of jobs that take less."""
        spread = _spread(self.noise)
        return 0.5 * math.erfc(-(math.log(time / MEAN) + spread**2 / 2) / spread / math.sqrt(2.0))


def series_of(times: Sequence[float], *, limit: float = math.inf) -> Series:
    """Jobs one after the other; those within the limit succeed."""
    samples: list[Sample] = []
    clock = 0.0
    for time in times:
        samples.append(Sample(began_ms=clock, response_ms=time, successful=time <= limit))
        clock += time
    return Series(component="coi", samples=tuple(samples), elapsed_ms=clock)


def noisy(chance: random.Random, count: int, noise: float, correlation: float, mean: float = MEAN) -> list[float]:
    """A steady series: lognormal, each value correlated with the one before."""
    spread = _spread(noise)
    fresh, state, times = math.sqrt(1.0 - correlation**2), chance.gauss(0.0, 1.0), []
    for _ in range(count):
        times.append(mean * math.exp(spread * state - spread**2 / 2))
        state = correlation * state + fresh * chance.gauss(0.0, 1.0)
    return times


def case(kind: str, seed: int) -> Case:
    """A component near its threshold, as hard as it gets: its index lies within a few deviations of it."""
    chance = random.Random(f"{kind}/{seed}")
    if kind.endswith("two modes"):
        return _two_modes(kind, chance)
    jobs = _jobs(chance)
    away = chance.gauss(0.0, 1.0)
    near = away * jobs.noise * 0.15
    match kind:
        case "mean_response_time":
            return _at_most("mean_response_time", series_of(jobs.times), MEAN, near)
        case "p95_response_time":
            return _at_most("p95_response_time", series_of(jobs.times), jobs.quantile(1.6448536), near)
        case "jitter":
            return _at_most("jitter", series_of(jobs.times), MEAN * jobs.noise, 0.1 * away)
        case "deadline_miss_rate":
            soon = DEADLINE / jobs.quantile(1.2815516)  # one in ten misses it
            return _at_most("deadline_miss_rate", series_of([soon * time for time in jobs.times]), 10.0, 0.3 * away)
        case "success_rate":
            return _at_least("success_rate", series_of(jobs.times, limit=jobs.quantile(1.2815516)), 90.0, 0.03 * away)
        case "success_rate near 100 %":
            limited = series_of(jobs.times, limit=jobs.quantile(2.0537489))
            return _at_least("success_rate", limited, 98.0, min(0.019, 0.02 * away))
        case "throughput":
            return _at_least("throughput", series_of(jobs.times), 1000.0 / MEAN, near)
        case "throughput where 10 % fail":
            limited = series_of(jobs.times, limit=jobs.quantile(1.2815516))
            return _at_least("throughput", limited, 900.0 / MEAN, 0.03 * away)
        case _:
            limited = series_of(jobs.times, limit=jobs.quantile(2.3263479))
            return _at_least("throughput", limited, 990.0 / MEAN, 0.03 * away)


def _two_modes(kind: str, chance: random.Random) -> Case:
    """Every job takes 100 ms but for a few that take twice as long: the first samples may show none of those."""
    rare = chance.choice((0.02, 0.05, 0.2))
    away = chance.gauss(0.0, 1.0)
    if kind.startswith("p95"):
        rare = 0.05 * math.exp(0.3 * away)
    series = series_of([2 * MEAN if chance.random() < rare else MEAN for _ in range(SAMPLES)])
    match kind.split(maxsplit=1)[0]:
        case "mean_response_time":
            return _at_most("mean_response_time", series, MEAN * (1.0 + rare), 0.3 * rare * away)
        case "jitter":
            return _at_most("jitter", series, MEAN * math.sqrt(rare * (1.0 - rare)), math.expm1(0.6 * away))
        case _:
            return Case(series=series, apt={"p95_response_time": limit_at(1.5 * MEAN)}, met=rare <= 0.05)


def extreme_beyond(seed: int, *, longest: bool) -> tuple[Series, float]:
    """A series, and the share of jobs, in per cent, that truly lies beyond the extreme it shows."""
    jobs = _jobs(random.Random(f"extreme/{seed}"))
    seen = jobs.share_below(max(jobs.times) if longest else min(jobs.times))
    return series_of(jobs.times), 100 * (1.0 - seen if longest else seen)


def limit_at(value: float) -> Threshold:
    """At most this."""
    return AtMost(value=Fraction(value))


def _jobs(chance: random.Random) -> _Jobs:
    noise, correlation = chance.choice(NOISES), chance.uniform(0.0, 0.5)
    return _Jobs(times=noisy(chance, SAMPLES, noise, correlation), noise=noise)


def _spread(noise: float) -> float:
    """The deviation of the logarithm of times with this coefficient of variation."""
    return math.sqrt(math.log(1.0 + noise**2))


def _at_most(index: str, series: Series, truth: float, away: float) -> Case:
    return Case(series=series, apt={index: limit_at(truth * (1.0 + away))}, met=away >= 0.0)


def _at_least(index: str, series: Series, truth: float, away: float) -> Case:
    return Case(series=series, apt={index: AtLeast(value=Fraction(truth * (1.0 + away)))}, met=away <= 0.0)
