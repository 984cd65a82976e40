"""How often verdicts are wrong next to what they declare, and whether a series without a steady state gets one."""

import math
import random
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from statistics import NormalDist

from benchmarks.components import NOISES, deviation_of_logarithm
from benchmarks.timing import Figure, report
from rarms_iac.model.outcomes import Met, Missed, NoEstimate, Unsteady, Verdict
from rarms_iac.model.run import Run, SampleCount
from rarms_iac.model.series import Sample, Series, first_samples
from rarms_iac.model.system import AtLeast, AtMost, MeasuringLimits, Threshold
from rarms_iac.statistics.conditions import conditions_of
from rarms_iac.statistics.distributions import ERROR, FIRST_LOOK, LOOK_ERROR, next_look, share_below
from rarms_iac.statistics.estimates import estimate
from rarms_iac.statistics.verdicts import judge, judge_early, judge_look
from tests.builders import a_run

SAMPLES = 400
MEAN = 100.0
DEADLINE = 120.0
RUN = a_run(until=SampleCount(samples=SAMPLES), deadline=f"{DEADLINE:g} ms")
KINDS = (
    "mean_response_time",
    "mean_response_time of two modes",
    "mean_response_time of a long tail",
    "mean_response_time by a coarse clock",
    "mean_response_time that depends on the last",
    "mean_response_time of short jobs",
    "p95_response_time",
    "p95_response_time of two modes",
    "p95_response_time of short jobs",
    "jitter",
    "jitter of two modes",
    "success_rate",
    "success_rate near 100 %",
    "success_rate of short jobs",
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
        """Return the response time that lies so many deviations above the middle one."""
        spread = deviation_of_logarithm(self.noise)
        return MEAN * math.exp(spread * deviations - spread**2 / 2)

    def share_below(self, time: float) -> float:
        """Return the share of jobs that take less."""
        spread = deviation_of_logarithm(self.noise)
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
    """Return a steady series: lognormal, each value correlated with the one before."""
    spread = deviation_of_logarithm(noise)
    fresh, state, times = math.sqrt(1.0 - correlation**2), chance.gauss(0.0, 1.0), []
    for _ in range(count):
        times.append(mean * math.exp(spread * state - spread**2 / 2))
        state = correlation * state + fresh * chance.gauss(0.0, 1.0)
    return times


NEAR, FAR = 1.0, 4.0
"""At its threshold, as hard as it gets: an index lies within a few deviations; and as far from it as a search comes."""


def case(kind: str, seed: int, distance: float = NEAR) -> Case:
    """Return a component whose index lies so far from its threshold."""
    chance = random.Random(f"{kind}/{seed}")
    if kind.endswith("two modes"):
        return _two_modes(kind, chance, distance)
    if kind in _HARD:
        return _HARD[kind](chance, distance)
    jobs = _jobs(chance)
    away = chance.gauss(0.0, distance)
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


def _two_modes(kind: str, chance: random.Random, distance: float) -> Case:
    """Every job takes 100 ms, give or take 1 %, but for a few that take twice as long, unseen at first."""
    rare = chance.choice((0.005, 0.02, 0.05, 0.2))
    away = chance.gauss(0.0, distance)
    if kind.startswith("p95"):
        rare = 0.05 * math.exp(0.3 * away)
    ordinary = noisy(chance, SAMPLES, 0.01, 0.0)
    series = series_of([2 * time if chance.random() < rare else time for time in ordinary])
    match kind.split(maxsplit=1)[0]:
        case "mean_response_time":
            return _at_most("mean_response_time", series, MEAN * (1.0 + rare), 0.1 * rare * away)
        case "jitter":
            return _at_most("jitter", series, MEAN * math.sqrt(rare * (1.0 - rare)), math.expm1(0.6 * away))
        case _:
            return Case(series=series, apt={"p95_response_time": limit_at(1.5 * MEAN)}, met=rare <= 0.05)


def _long_tail(chance: random.Random, distance: float) -> Case:
    """Lognormal with a sigma of 1: a CV of 131 %."""
    times = [MEAN * math.exp(chance.gauss(0.0, 1.0) - 0.5) for _ in range(SAMPLES)]
    return _at_most("mean_response_time", series_of(times), MEAN, 0.05 * chance.gauss(0.0, distance))


def _coarse_clock(chance: random.Random, distance: float) -> Case:
    """Windows' clock ticks every 15.6 ms: a job shows whole ticks, one more or one less as it happens to begin."""
    mean, tick = chance.choice((3.0, 15.9, 20.0, 50.0)), 15.6
    times = [tick * math.floor(time / tick + chance.random()) for time in noisy(chance, SAMPLES, 0.05, 0.0, mean)]
    return _at_most("mean_response_time", series_of(times), mean, 0.02 * chance.gauss(0.0, distance))


def _dependent(chance: random.Random, distance: float) -> Case:
    """Each job like the last: AR 0.9, so that 400 are worth 21."""
    noise = chance.choice(NOISES)
    times = noisy(chance, SAMPLES, noise, 0.9)
    return _at_most("mean_response_time", series_of(times), MEAN, 0.1 * noise * chance.gauss(0.0, distance))


WINDOW_MS = 100.0


def short_jobs(
    chance: random.Random, count: int, per_start: int | None, waiting: float | None = None
) -> tuple[list[float], float, float]:
    """Jobs one after the other, which wait where a scheduler's window gives no more; each start in a random phase.

    Args:
        chance: Draws the work and the window, but for the share of jobs that wait, where that is given.
        per_start: Of jobs; None: there is one start.
        waiting: 0..1.

    Returns:
        Response times; their true mean; the share of jobs, in per cent, that do not wait.
    """
    share = chance.uniform(0.2, 0.8)
    budget, work = WINDOW_MS * share, chance.uniform(2.0, min(30.0, WINDOW_MS * share / 2))
    work = work if waiting is None else waiting * budget
    noise, used, times = chance.choice((0.0, 0.0, 0.03)), 0.0, list[float]()
    for number in range(count):
        if number % (per_start or count) == 0:
            used = chance.uniform(0.0, budget)
        own = max(0.0, work * chance.gauss(1.0, noise))
        waits, used = divmod(used + own, budget)
        times.append(own + waits * (WINDOW_MS - budget))
    return times, work / share, 100 * (1.0 - work / budget)


def _short_jobs(chance: random.Random, distance: float) -> Case:
    times, mean, _ = short_jobs(chance, SAMPLES, None)
    return _at_most("mean_response_time", series_of(times), mean, 0.01 * chance.gauss(0.0, distance))


def _short_successes(chance: random.Random, distance: float) -> Case:
    times, _, succeed = short_jobs(chance, SAMPLES, None)
    limited = series_of(times, limit=(min(times) + WINDOW_MS / 10))
    return _at_least("success_rate", limited, succeed, 0.01 * chance.gauss(0.0, distance))


def _short_percentile(chance: random.Random, distance: float) -> Case:
    waiting = min(0.4, 0.05 * math.exp(0.3 * chance.gauss(0.0, distance)))
    times, _, _ = short_jobs(chance, SAMPLES, None, waiting)
    limit = limit_at(min(times) + WINDOW_MS / 10)
    return Case(series=series_of(times), apt={"p95_response_time": limit}, met=waiting <= 0.05)


_HARD = {
    "p95_response_time of short jobs": _short_percentile,
    "mean_response_time of short jobs": _short_jobs,
    "success_rate of short jobs": _short_successes,
    "mean_response_time of a long tail": _long_tail,
    "mean_response_time by a coarse clock": _coarse_clock,
    "mean_response_time that depends on the last": _dependent,
}


def extreme_beyond(seed: int, *, longest: bool) -> tuple[Series, float]:
    """Return a series, and the share of jobs, in per cent, that truly lies beyond the extreme it shows."""
    jobs = _jobs(random.Random(f"extreme/{seed}"))
    seen = jobs.share_below(max(jobs.times) if longest else min(jobs.times))
    return series_of(jobs.times), 100 * (1.0 - seen if longest else seen)


def limit_at(value: float) -> Threshold:
    """At most this."""
    return AtMost(value=Fraction(value))


def _jobs(chance: random.Random) -> _Jobs:
    noise, correlation = chance.choice(NOISES), chance.uniform(0.0, 0.5)
    return _Jobs(times=noisy(chance, SAMPLES, noise, correlation), noise=noise)


def _at_most(index: str, series: Series, truth: float, away: float) -> Case:
    return Case(series=series, apt={index: limit_at(truth * (1.0 + away))}, met=away >= 0.0)


def _at_least(index: str, series: Series, truth: float, away: float) -> Case:
    return Case(series=series, apt={index: AtLeast(value=Fraction(truth * (1.0 + away)))}, met=away <= 0.0)


SERIES = 1000
LONG = 4000
"""Samples of a series without a steady state: with a CV of 15 % a shorter one hides 1 % in 100 samples in its noise."""
SHORTER = (200, 400, 1000, 2000)
"""Lengths at which the same is told without a goal: what a setting usually has."""
SHAPES = ("drift", "level shifts", "slow wave", "random walk")


def sequential(series: Series, apt: dict[str, Threshold]) -> Verdict:
    """Return the verdict as a running measurement gives it: at the first look that settles it, or at the end."""
    return sequential_in(series, apt, RUN)[1]


def sequential_in(series: Series, apt: dict[str, Threshold], run: Run) -> tuple[int, Verdict]:
    """Return the verdict of a run as a running measurement gives it, with the samples that it took."""
    look = FIRST_LOOK
    while look < len(series.samples):
        part = Series(component="coi", samples=series.samples[:look], elapsed_ms=series.samples[look].began_ms)
        verdict = judge_early(part, apt, run, done=look / len(series.samples))
        if verdict is not None:
            return look, verdict
        look = next_look(look)
    verdict = judge_early(series, apt, run, done=1.0)
    assert verdict is not None
    return len(series.samples), verdict


def wrong(
    kind: str, count: int, judged: Callable[[Series, dict[str, Threshold]], Verdict], distance: float = NEAR
) -> tuple[int, int]:
    """Of so many seeded series: how many verdicts say met or missed, and how many of these are wrong."""
    given, false = 0, 0
    for seed in range(count):
        drawn = case(kind, seed, distance)
        verdict = judged(drawn.series, drawn.apt)
        if isinstance(verdict, Met | Missed):
            given += 1
            false += isinstance(verdict, Met) is not drawn.met
    return given, false


def as_likely(false: int, count: int, declared: float) -> float:
    """Return the probability of at least so many wrong verdicts if each is wrong with the error declared (binomial)."""
    return 1.0 if false == 0 else share_below(declared, false, count - false + 1)


def too_much_beyond(count: int, *, longest: bool) -> int:
    """Of so many seeded extremes: beyond how many lie truly more jobs than the estimate grants."""
    index = "maximum_response_time" if longest else "minimum_response_time"
    false = 0
    for seed in range(count):
        series, beyond = extreme_beyond(seed, longest=longest)
        found = estimate(index, series, RUN, error=ERROR)
        assert not isinstance(found, NoEstimate)
        assert found.beyond is not None
        false += beyond > found.beyond
    return false


def unsteady(shape: str, seed: int, count: int = LONG) -> list[float]:
    """Return a series without a steady state.

    Its mean moves by 1 to 3 % in every 100 samples, to and fro or for good.
    """
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
    """Return a steady series, every other one after a warm-up of up to a tenth of it."""
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
    missed = sum(not isinstance(verdict, Unsteady) for verdict in given)
    return 100 * missed / tries, 100 * sum(isinstance(verdict, Met | Missed) for verdict in given) / tries


def steadiness_figures(count: int) -> list[Figure]:
    """Shares of series without a steady state that are named, or get a verdict; of steady ones that are refused."""
    figures: list[Figure] = []
    for length in (*SHORTER, LONG):
        shares = [unsteady_shares(shape, count // len(SHAPES), length) for shape in SHAPES]
        if length == LONG:
            named = [
                Figure(name=f"{shape}: not named", value=share, unit="%")
                for shape, (share, _) in zip(SHAPES, shares, strict=True)
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
    """Wrong verdicts next to the declared error, with the binomial test at 1 %."""
    figures: list[Figure] = []
    for kind in KINDS:
        for way, judged in WAYS.items():
            given, false = wrong(kind, count, judged)
            figures += _wrong_verdicts(f"{kind}, {way}: wrong, a series", false, count)
            # NOTE: no goal at the threshold: what is declared is of series, and few get a verdict there, by luck.
            figures.append(Figure(name=f"  a verdict, of {given}", value=100 * false / max(1, given), unit="%"))
            given, false = wrong(kind, count, judged, FAR)
            figures += _wrong_verdicts(f"  a verdict, of {given} further from the threshold", false, given)
    for name, longest in (("maximum", True), ("minimum", False)):
        false = too_much_beyond(count, longest=longest)
        figures += _wrong_verdicts(f"{name}: more jobs beyond it than granted", false, count)
    return figures


def _wrong_verdicts(name: str, false: int, count: int) -> list[Figure]:
    sure = 100 * (1.0 - as_likely(false, count, ERROR))
    unlikely = Figure(name="    unlikely at the declared error", value=sure, unit="%", at_most=99)
    return [Figure(name=name, value=100 * false / max(1, count), unit="%"), unlikely]


BEFORE = {"normal": 666.0, "two modes": 432.0, "long tail": 2691.0}
"""Samples that a setting took before every bound counted in a job that was not seen, with the same series."""


def effort(data: str, seed: int) -> tuple[Series, dict[str, Threshold]]:
    """Return a long series, and a threshold at 0.5 to 50 % from its mean: what a search comes by."""
    chance = random.Random(f"effort/{data}/{seed}")
    match data:
        case "normal":
            noise = chance.choice((*NOISES, 0.3))
            times = [max(1.0, chance.gauss(MEAN, noise * MEAN)) for _ in range(LONG)]
        case "two modes":
            times = [2 * time if chance.random() < 0.02 else time for time in noisy(chance, LONG, 0.01, 0.0, 98.039)]
        case _:
            times = [MEAN * math.exp(chance.gauss(0.0, 1.0) - 0.5) for _ in range(LONG)]
    away = math.exp(chance.uniform(math.log(0.005), math.log(0.5))) * chance.choice((-1.0, 1.0))
    return series_of(times), {"mean_response_time": limit_at(MEAN * (1.0 + away))}


def effort_figures(count: int) -> list[Figure]:
    """Return samples that a setting takes, next to those before."""
    figures: list[Figure] = []
    for data, before in BEFORE.items():
        taken = clear = 0
        for seed in range(count):
            series, apt = effort(data, seed)
            samples, verdict = sequential_in(series, apt, a_run(until=SampleCount(samples=LONG)))
            taken += samples
            clear += isinstance(verdict, Met | Missed)
        goal = before if data == "normal" else None
        figures += [
            Figure(name=f"{data}: samples a setting", value=taken / count, unit="", at_most=goal),
            Figure(name="  before", value=before, unit=""),
            Figure(name="  met or missed", value=100 * clear / count, unit="%"),
        ]
    return figures


MOST_LOOKED_AT = 40_000
FLAT = (
    "mean_response_time",
    "p95_response_time of two modes",
    "success_rate",
    "mean_response_time of short jobs",
    "success_rate of short jobs",
    "p95_response_time of short jobs",
)
PER_START = (None, 10, 40, 300)
"""Short jobs between two starts of a load; None: there is one start."""

FLAT_SETTINGS = 8
"""As many as a search has: each is a chance to say that it is enough where none is."""


def beyond_boundary(runs: int) -> int:
    """Of so many series of normal values: how many standardised means leave the boundary at any count of samples."""
    boundary = -NormalDist().inv_cdf(LOOK_ERROR)
    left = 0
    for seed in range(runs):
        draw, total = random.Random(f"boundary/{seed}").gauss, 0.0
        limits = [boundary * math.sqrt(count) for count in range(MOST_LOOKED_AT + 1)]
        for count in range(1, MOST_LOOKED_AT + 1):
            total += draw(0.0, 1.0)
            if count >= FIRST_LOOK and total > limits[count]:
                left += 1
                break
    return left


def met_at_a_look(searches: int, settings: int, most: int, beyond: float) -> int:
    """Of so many searches: how many have a setting whose bound meets the threshold at any look, where none truly does.

    Args:
        settings: of each search; jobs are normal values, and all settings lie equally far beyond the threshold.
        most: jobs of a setting.
        beyond: how far, in standard deviations of a job.
    """
    looks = [*_looks(most), most]
    limits = [-LOOK_DEVIATIONS * math.sqrt(look) for look in looks]
    wrong_searches = 0
    for seed in range(searches):
        draw = random.Random(f"looks/{settings}/{most}/{beyond:g}/{seed}").gauss
        wrong_searches += any(_is_met_at_a_look(looks, limits, beyond, draw) for _ in range(settings))
    return wrong_searches


def _is_met_at_a_look(
    looks: Sequence[int], limits: Sequence[float], beyond: float, draw: Callable[[float, float], float]
) -> bool:
    total, before = 0.0, 0
    for look, limit in zip(looks, limits, strict=True):
        total += draw(beyond * (look - before), math.sqrt(look - before))
        before = look
        if total <= limit:
            return True
    return False


LOOK_DEVIATIONS = -NormalDist().inv_cdf(LOOK_ERROR)


def flat_series(kind: str, chance: random.Random, count: int) -> tuple[Series, dict[str, Threshold]]:
    """Return a series of a setting just on the wrong side of its threshold, by a thousandth."""
    match kind:
        case "mean_response_time":
            return series_of(noisy(chance, count, 0.15, 0.3)), {kind: limit_at(MEAN * 0.999)}
        case "success_rate":
            good = [chance.random() < 0.899 for _ in range(count)]
            return series_of([50.0 if each else 150.0 for each in good], limit=MEAN), {
                kind: AtLeast(value=Fraction(90))
            }
        case "mean_response_time of short jobs" | "success_rate of short jobs" | "p95_response_time of short jobs":
            per_start = chance.choice(PER_START)
            times, mean, succeed = short_jobs(chance, count, per_start, 0.0501 if kind.startswith("p95") else None)
            series = series_of(times, limit=min(times) + WINDOW_MS / 10)
            series = replace(series, starts=tuple(range(per_start or count, count, per_start or count)))
            index = kind.split(maxsplit=1)[0]
            if index == "p95_response_time":
                return series, {index: limit_at(min(times) + WINDOW_MS / 10)}
            return series, {index: limit_at(0.999 * mean) if index == "mean_response_time" else _above(succeed)}
        case _:
            times = [2 * MEAN if chance.random() < 0.051 else MEAN * chance.uniform(0.99, 1.01) for _ in range(count)]
            return series_of(times), {"p95_response_time": limit_at(1.5 * MEAN)}


def _above(share: float) -> Threshold:
    return AtLeast(value=Fraction(share + 0.1))


def flat_curves(kind: str, curves: int) -> tuple[int, int]:
    """Of so many flat curves, all of it on the wrong side: which are said to be met, at one setting or in a search.

    Each setting is measured in several runs, of random lengths, and looked at after each.
    """
    settings = wrong_curves = 0
    for seed in range(curves):
        found = 0
        for number in range(FLAT_SETTINGS):
            chance = random.Random(f"flat/{kind}/{seed}/{number}")
            series, apt = flat_series(kind, chance, LONG)
            found += any(isinstance(judge_look(part, apt, RUN), Met) for part in _growing(series, chance))
        settings += found
        wrong_curves += found > 0
    return settings, wrong_curves


def _growing(series: Series, chance: random.Random) -> Iterator[Series]:
    """Yield the series after each of its runs, as `--again` lets it grow."""
    count, runs = 0, list[int]()
    while count < len(series.samples):
        count = min(len(series.samples), max(FIRST_LOOK, round(count * chance.uniform(1.1, 2.5))))
        first = first_samples(series, count) if count < len(series.samples) else series
        yield replace(first, runs=tuple(runs))
        runs.append(count)


def sequence_figures(count: int) -> list[Figure]:
    """How often any look at a growing series is wrong, and a search along a flat curve."""
    left = beyond_boundary(count)
    figures = _wrong_verdicts("normal means beyond the boundary at any of 40 to 40,000 samples", left, count)
    for settings in (1, 3, FLAT_SETTINGS):
        found = met_at_a_look(4 * count, settings, LONG, 0.001 / 0.15)
        name = f"{settings} settings 0.1 % beyond, normal, CV 15 %, any met at a look"
        figures.append(Figure(name=name, value=25 * found / count, unit="%"))
    for kind in FLAT:
        settings, curves = flat_curves(kind, count // FLAT_SETTINGS)
        figures += _wrong_verdicts(f"{kind}, flat, runs of random lengths: wrong, a setting", settings, count)
        figures += _wrong_verdicts(f"  of {FLAT_SETTINGS} such settings, any", curves, count // FLAT_SETTINGS)
    return figures


RARE_KINDS = ("1 job in 300 takes 20 times as long", "5 % of jobs in runs of 5 take 3 times as long")

RARE_CASES = (
    (RARE_KINDS[0], "mean_response_time"),
    (RARE_KINDS[0], "success_rate"),
    (RARE_KINDS[1], "mean_response_time"),
    (RARE_KINDS[1], "success_rate"),
    (RARE_KINDS[1], "p95_response_time"),
)


def rare_series(kind: str, index: str, chance: random.Random) -> tuple[Series, dict[str, Threshold]]:
    """Return a long series with rare slow jobs, a thousandth on the wrong side of its threshold."""
    slow, share, run = (20.0, 1 / 300, 1) if kind == RARE_KINDS[0] else (3.0, 0.05, 5)
    times: list[float] = []
    while len(times) < LONG:
        begins = chance.random() < share / run / (1.0 - share + share / run)
        times += [(slow if begins else 1.0) * MEAN * chance.uniform(0.95, 1.05) for _ in range(run if begins else 1)]
    match index:
        case "mean_response_time":
            return series_of(times), {index: limit_at(0.999 * MEAN * (1.0 + share * (slow - 1.0)))}
        case "success_rate":
            return series_of(times, limit=2 * MEAN), {index: _above(100 * (1.0 - share))}
        case _:
            return series_of(times), {"p95_response_time": limit_at(2 * MEAN)}


def falsely_met(kind: str, index: str, count: int) -> tuple[int, int]:
    """Of so many series, each looked at again and again: how many are said to be met, and how many unconditionally."""
    met = unconditional = 0
    for seed in range(count):
        series, apt = rare_series(kind, index, random.Random(f"{kind}/{index}/{seed}"))
        verdicts = list[tuple[Series, Met]]()
        for look in _looks(len(series.samples)):
            part = first_samples(series, look)
            if isinstance(verdict := judge_look(part, apt, RUN), Met):
                verdicts.append((part, verdict))
        met += bool(verdicts)
        unconditional += any(not conditions_of(each.judged, part, RUN, SLOW_JOB) for part, each in verdicts)
    return met, unconditional


SLOW_JOB = MeasuringLimits().slow_job
MOST_WRONG = 2.0
"""Per cent of unconditional verdicts on rare slow jobs that may be wrong."""


def _looks(count: int) -> Iterator[int]:
    look = FIRST_LOOK
    while look < count:
        yield look
        look = next_look(look)


def rare_figures(count: int) -> list[Figure]:
    """Return how often rare slow jobs make a verdict wrong, with its condition and without one."""
    figures: list[Figure] = []
    for kind, index in RARE_CASES:
        met, unconditional = falsely_met(kind, index, count)
        figures += [
            Figure(name=f"{index}, {kind}: falsely met", value=100 * met / count, unit="%"),
            Figure(name="  without a condition", value=100 * unconditional / count, unit="%", at_most=MOST_WRONG),
        ]
    return figures


def one_look(series: Series, apt: dict[str, Threshold]) -> Verdict:
    """Return the verdict on the whole series."""
    return judge(series, apt, RUN)


APT = {"mean_response_time": limit_at(1.1 * MEAN)}
WAYS = {"one look": one_look, "sequential": sequential}


def main() -> int:
    return report(
        [
            *sequence_figures(SERIES),
            *rare_figures(SERIES),
            *error_figures(SERIES),
            *effort_figures(SERIES // 4),
            *steadiness_figures(SERIES),
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
