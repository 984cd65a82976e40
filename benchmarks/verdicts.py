"""How often verdicts are wrong beside what they declare, and whether a series without a steady state gets one."""

import math
import random
import sys
from collections.abc import Callable

from benchmarks.timing import Figure, report
from benchmarks.verdict_cases import KINDS, MEAN, NOISES, RUN, case, extreme_beyond, limit_at, noisy, series_of
from rarms_iac.model.measurement import Series
from rarms_iac.model.outcomes import Met, Missed, NoEstimate, Unsteady, Verdict
from rarms_iac.model.system import Threshold
from rarms_iac.statistics.distributions import share_below
from rarms_iac.statistics.estimates import USUAL_ERROR, estimate
from rarms_iac.statistics.verdicts import judge, judge_early, next_look

SERIES = 1000
LONG = 4000
"""Samples of a series without a steady state: with a CV of 15 % a shorter one hides 1 % in 100 samples in its noise."""
SHORTER = (200, 400, 1000, 2000)
"""Lengths at which the same is told without a goal: what a setting usually has."""
SHAPES = ("drift", "level shifts", "slow wave", "random walk")


def sequential(series: Series, apt: dict[str, Threshold]) -> Verdict:
    """The verdict as a running measurement gives it: at the first look that settles it, or at the end."""
    look = next_look(0)
    while look < len(series.samples):
        part = Series(component="coi", samples=series.samples[:look], elapsed_ms=series.samples[look].began_ms)
        verdict = judge_early(part, apt, RUN)
        if verdict is not None:
            return verdict
        look = next_look(look)
    verdict = judge_early(series, apt, RUN)
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


def too_much_beyond(count: int, *, longest: bool) -> int:
    """Of so many seeded extremes: beyond how many lie truly more jobs than the estimate grants."""
    index = "maximum_response_time" if longest else "minimum_response_time"
    false = 0
    for seed in range(count):
        series, beyond = extreme_beyond(seed, longest=longest)
        found = estimate(index, series, RUN)
        assert not isinstance(found, NoEstimate)
        assert found.beyond is not None
        false += beyond > found.beyond
    return false


def unsteady(shape: str, seed: int, count: int = LONG) -> list[float]:
    """A series without a steady state: its mean moves by 1 to 3 % in every 100 samples, to and fro or for good."""
    chance = random.Random(f"{shape}/{seed}")
    times = noisy(chance, count, chance.choice(NOISES), chance.uniform(0.0, 0.5), mean=1.0)
    rate = chance.uniform(0.01, 0.03) / 100
    levels = _levels(shape, chance, rate, count)
    return [MEAN * max(0.1, level) * time for level, time in zip(levels, times, strict=True)]


def _levels(shape: str, chance: random.Random, rate: float, count: int) -> list[float]:
    sign = chance.choice((-1.0, 1.0)) if rate * count < 0.7 else 1.0  # no level falls below 0
    match shape:
        case "drift":
            return [1.0 + sign * rate * number for number in range(count)]
        case "level shifts":
            length, step = chance.randint(150, 400), chance.uniform(0.04, 0.15)
            return [1.0 + step * ((number // length) % 2) + rate * number for number in range(count)]
        case "slow wave":
            wave = chance.uniform(0.5, 1.5) * count
            height = rate * wave / 4  # from trough to crest 1 % or more in 100 samples on average
            phase = chance.uniform(0.0, 6.28)
            return [1.0 + height * math.sin(phase + 6.2832 * number / wave) for number in range(count)]
        case _:
            walk, levels = 1.0, []
            for _ in range(count):
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


def unsteady_shares(shape: str, tries: int, count: int) -> tuple[float, float]:
    """Of so many series of a shape and length, in per cent: which are not named as unsteady, which get a verdict."""
    given = [judge(series_of(unsteady(shape, seed, count)), APT, RUN) for seed in range(tries)]
    missed = sum(not isinstance(one, Unsteady) for one in given)
    return 100 * missed / tries, 100 * sum(isinstance(one, Met | Missed) for one in given) / tries


def steadiness_figures(count: int) -> list[Figure]:
    """Shares of series without a steady state that are named, or get a verdict; of steady ones that are refused."""
    figures: list[Figure] = []
    for length in (*SHORTER, LONG):
        shares = [unsteady_shares(shape, count // len(SHAPES), length) for shape in SHAPES]
        if length == LONG:
            named = [
                Figure(name=f"{shape}: not named", value=one, unit="%")
                for shape, (one, _) in zip(SHAPES, shares, strict=True)
            ]
            figures += named
        missed, verdicts = (sum(column) / len(SHAPES) for column in zip(*shares, strict=True))
        goals = (5, 1) if length == LONG else (None, None)
        figures += [
            Figure(name=f"no steady state, {length} samples: not named", value=missed, unit="%", at_most=goals[0]),
            Figure(name=f"no steady state, {length} samples: a verdict", value=verdicts, unit="%", at_most=goals[1]),
        ]
    refused = sum(isinstance(judge(series_of(steady(seed)), APT, RUN), Unsteady) for seed in range(count))
    return [*figures, Figure(name="steady: refused", value=100 * refused / count, unit="%", at_most=2)]


def error_figures(count: int) -> list[Figure]:
    """Wrong verdicts beside the declared error, with the binomial test at 1 %."""
    figures: list[Figure] = []
    for kind in KINDS:
        for way, judged in WAYS.items():
            given, false, declared = wrong(kind, count, judged)
            figures += _beside(f"{kind}, {way} ({given} met or missed): wrong", false, count, declared)
    for name, longest in (("maximum", True), ("minimum", False)):
        false = too_much_beyond(count, longest=longest)
        figures += _beside(f"{name}: more jobs beyond it than granted", false, count, USUAL_ERROR)
    return figures


def _beside(name: str, false: int, count: int, declared: float) -> list[Figure]:
    unlikely = Figure(
        name=f"  unlikely at the declared {100 * declared:g} %",
        value=100 * (1.0 - as_likely(false, count, declared)),
        unit="%",
        at_most=99,
    )
    return [Figure(name=name, value=100 * false / count, unit="%"), unlikely]


def one_look(series: Series, apt: dict[str, Threshold]) -> Verdict:
    """The verdict on the whole series."""
    return judge(series, apt, RUN)


APT = {"mean_response_time": limit_at(1.1 * MEAN)}
WAYS = {"one look": one_look, "sequential": sequential}


def main() -> int:
    return report([*error_figures(SERIES), *steadiness_figures(SERIES)])


if __name__ == "__main__":
    sys.exit(main())
