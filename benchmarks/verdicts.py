"""How often verdicts are wrong beside what they declare, and whether a series without a steady state gets one."""

import math
import random
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

from benchmarks.timing import Figure, report
from rarms_iac.model.measurement import Sample, Series
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.system import AtLeast, AtMost, Closed, Command, Run, SampleCount, Samples, Stop, Threshold
from rarms_iac.statistics.distributions import share_below
from rarms_iac.statistics.steadiness import Unsteady
from rarms_iac.statistics.verdict import Met, Missed, Verdict, decide, judge, next_look

SERIES = 1000
SAMPLES = 400
LONG = 4000
"""Samples of a series without a steady state: with a CV of 15 % a shorter one hides 1 % in 100 samples in its noise."""
MEAN = 100.0
NOISES = (0.01, 0.05, 0.15)
SHAPES = ("drift", "level shifts", "slow wave", "random walk")
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
    deadline=None,
    failures=0,
)


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
    spread = math.sqrt(math.log(1.0 + noise**2))
    fresh, state, times = math.sqrt(1.0 - correlation**2), chance.gauss(0.0, 1.0), []
    for _ in range(count):
        times.append(mean * math.exp(spread * state - spread**2 / 2))
        state = correlation * state + fresh * chance.gauss(0.0, 1.0)
    return times


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One seeded verdict: the series, and whether the APT is truly met."""

    series: Series
    apt: dict[str, Threshold]
    met: bool


def case(kind: str, seed: int) -> Case:
    """A component near its threshold, as hard as it gets: its index lies within a few deviations of it."""
    chance = random.Random(f"{kind}/{seed}")
    noise, correlation = chance.choice(NOISES), chance.uniform(0.0, 0.5)
    times = noisy(chance, SAMPLES, noise, correlation)
    away = chance.gauss(0.0, 1.0) * noise * 0.15
    spread = math.sqrt(math.log(1.0 + noise**2))
    middle = MEAN * math.exp(-(spread**2) / 2)
    match kind:
        case "mean_response_time":
            return Case(series=series_of(times), apt={kind: _at_most(MEAN * (1 + away))}, met=away >= 0.0)
        case "p95_response_time":
            return Case(
                series=series_of(times),
                apt={kind: _at_most(middle * math.exp(1.6448536 * spread) * (1 + away))},
                met=away >= 0.0,
            )
        case _:
            share = 100 * (0.9 + 0.03 * chance.gauss(0.0, 1.0))
            return Case(
                series=series_of(times, limit=middle * math.exp(1.2815516 * spread)),
                apt={kind: AtLeast(value=Fraction(min(share, 99.9)))},
                met=share <= 90.0,
            )


def _at_most(value: float) -> Threshold:
    return AtMost(value=Fraction(value))


def sequential(series: Series, apt: dict[str, Threshold]) -> Verdict:
    """The verdict as a running measurement gives it: at the first look that settles it, or at the end."""
    look = next_look(0)
    while look < len(series.samples):
        part = Series(component="coi", samples=series.samples[:look], elapsed_ms=series.samples[look].began_ms)
        verdict = decide(part, apt, RUN)
        if verdict is not None:
            return verdict
        look = next_look(look)
    verdict = decide(series, apt, RUN)
    assert verdict is not None
    return verdict


def wrong(kind: str, count: int, judged: Callable[[Series, dict[str, Threshold]], Verdict]) -> tuple[int, int, float]:
    """Of so many seeded verdicts: how many say met or missed, how many of these are wrong, and the error declared."""
    given, false, declared = 0, 0, 0.0
    for seed in range(count):
        one = case(kind, seed)
        verdict = judged(one.series, one.apt)
        if isinstance(verdict, Met | Missed):
            given += 1
            declared = max(declared, verdict.error)
            false += isinstance(verdict, Met) is not one.met
    return given, false, declared


def as_likely(false: int, count: int, declared: float) -> float:
    """The probability of at least so many wrong verdicts if each is wrong with the error declared (binomial)."""
    return 1.0 if false == 0 else share_below(declared, false, count - false + 1)


def unsteady(shape: str, seed: int) -> list[float]:
    """A series without a steady state: its mean moves by 1 to 3 % in every 100 samples, to and fro or for good."""
    chance = random.Random(f"{shape}/{seed}")
    times = noisy(chance, LONG, chance.choice(NOISES), chance.uniform(0.0, 0.5), mean=1.0)
    rate = chance.uniform(0.01, 0.03) / 100
    levels = _levels(shape, chance, rate)
    return [MEAN * max(0.1, level) * time for level, time in zip(levels, times, strict=True)]


def _levels(shape: str, chance: random.Random, rate: float) -> list[float]:
    sign = chance.choice((-1.0, 1.0)) if rate * LONG < 0.7 else 1.0  # no level falls below 0
    match shape:
        case "drift":
            return [1.0 + sign * rate * number for number in range(LONG)]
        case "level shifts":
            length, step = chance.randint(150, 400), chance.uniform(0.04, 0.15)
            return [1.0 + step * ((number // length) % 2) + rate * number for number in range(LONG)]
        case "slow wave":
            wave = chance.uniform(0.5, 1.5) * LONG
            height = rate * wave / 4  # from trough to crest 1 % or more in 100 samples on average
            phase = chance.uniform(0.0, 6.28)
            return [1.0 + height * math.sin(phase + 6.2832 * number / wave) for number in range(LONG)]
        case _:
            walk, levels = 1.0, []
            for _ in range(LONG):
                walk += chance.gauss(0.0, 1.0) * rate * 12.5  # in 100 samples, a mean move of 100 * rate
                levels.append(walk)
            return levels


def steady(seed: int) -> list[float]:
    """A steady series, every other one after a warm-up of up to a tenth of it."""
    chance = random.Random(f"steady/{seed}")
    count = chance.choice((200, 400, 1000, LONG))
    times = noisy(chance, count, chance.choice(NOISES), chance.uniform(0.0, 0.5))
    if seed % 2:
        fades = count * chance.uniform(0.005, 0.03)
        times = [time * (1.0 + 2.0 * math.exp(-number / fades)) for number, time in enumerate(times)]
    return times


def steadiness_figures(count: int) -> list[Figure]:
    """Shares of series without a steady state that are named, or get a verdict; of steady ones that are refused."""
    apt = {"mean_response_time": _at_most(1.1 * MEAN)}
    figures: list[Figure] = []
    named = verdicts = 0
    for shape in SHAPES:
        given = [judge(series_of(unsteady(shape, seed)), apt, RUN) for seed in range(count // len(SHAPES))]
        missed = sum(not isinstance(one, Unsteady) for one in given)
        figures.append(Figure(name=f"{shape}: not named", value=100 * missed / len(given), unit="%"))
        named += len(given) - missed
        verdicts += sum(isinstance(one, Met | Missed) for one in given)
    refused = sum(isinstance(judge(series_of(steady(seed)), apt, RUN), Unsteady) for seed in range(count))
    return [
        *figures,
        Figure(name="no steady state: not named", value=100 * (1 - named / count), unit="%", at_most=5),
        Figure(name="no steady state: a verdict", value=100 * verdicts / count, unit="%", at_most=1),
        Figure(name="steady: refused", value=100 * refused / count, unit="%", at_most=2),
    ]


def error_figures(count: int) -> list[Figure]:
    """Wrong verdicts beside the declared error, with the binomial test at 1 %."""
    figures: list[Figure] = []
    for kind in ("mean_response_time", "success_rate", "p95_response_time"):
        for way, judged in (("one look", _one_look), ("sequential", sequential)):
            given, false, declared = wrong(kind, count, judged)
            name = f"{kind}, {way} ({given} met or missed)"
            figures.append(Figure(name=f"{name}: wrong", value=100 * false / count, unit="%"))
            figures.append(
                Figure(
                    name=f"  unlikely at the declared {100 * declared:g} %",
                    value=100 * (1.0 - as_likely(false, count, declared)),
                    unit="%",
                    at_most=99,
                )
            )
    return figures


def _one_look(series: Series, apt: dict[str, Threshold]) -> Verdict:
    return judge(series, apt, RUN)


def main() -> int:
    return report([*error_figures(SERIES), *steadiness_figures(SERIES)])


if __name__ == "__main__":
    sys.exit(main())
