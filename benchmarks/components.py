"""Seeded components whose true curves are known: named shapes, shapes not used for tuning, and two that mislead.

A curve gives the level of a job's response time, in ms, at a whole CR; a job's response is that level times a lognormal
factor of mean 1 (its coefficient of variation is the noise), each factor correlated with the one before. Each job
consumes processor time; on one to two of P1's two processors at a time, so that the least response time that any CR
allows is `work / (parallel * CR)`.
"""

import math
import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from statistics import NormalDist

from rarms_iac.measuring.search.crossings import begun_before, is_known
from rarms_iac.measuring.search.trials import Goal, Member, is_clear
from rarms_iac.measuring.strategies import Strategy
from rarms_iac.model.experiment import Budget
from rarms_iac.model.outcomes import Conclusion, Measure
from rarms_iac.model.series import MOST_SAMPLES, Sample, Series
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import AtLeast, AtMost, MeasuringLimits
from rarms_iac.statistics.distributions import next_look
from rarms_iac.storage.datalog.log import DIGITS
from tests.builders import a_run

PROCESSORS = 2
NOISES = (0.01, 0.05, 0.15)
MOST_CORRELATION = 0.5
PRECISION = float(MeasuringLimits().precision) / 100

Level = Callable[[int], float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """A component as only the benchmark knows it."""

    shape: str
    seed: int
    level: tuple[float, ...]  # at CR 1..100: mean response time in ms
    work: float  # processor time a job, in ms
    noise: float
    correlation: float
    limit_ms: float | None  # a job is successful within it; None: the APT is the mean response time
    heavy: float  # share of jobs that take three times as long
    visible: bool  # whether its response times can be seen
    apt: float  # ms, or per cent of jobs

    def index(self, reserve: int) -> float:
        """Return the true value of the index at a CR: ms, or per cent."""
        level = self.level[reserve - 1]
        return level if self.limit_ms is None else 100 * self.successes(level)

    def meets(self, reserve: int, *, stricter: float = 0.0) -> bool:
        """Whether the APT is met, or one that is stricter by this part of it (of a share: in hundredths)."""
        if self.limit_ms is None:
            return self.index(reserve) <= self.apt * (1.0 - stricter)
        return self.index(reserve) >= self.apt + 100 * stricter

    def least(self, *, stricter: float = 0.0) -> int:
        """Return the least CR that meets it; 101: none does."""
        return next((reserve for reserve in range(1, 101) if self.meets(reserve, stricter=stricter)), 101)

    def successes(self, level: float) -> float:
        """Return the share of jobs that succeed at this level."""
        assert self.limit_ms is not None
        spread = deviation_of_logarithm(self.noise)
        ordinary, heavy = (
            NormalDist().cdf((math.log(self.limit_ms / (level * factor)) + spread**2 / 2) / spread)
            for factor in (1.0, 3.0)
        )
        return (1.0 - self.heavy) * ordinary + self.heavy * heavy


def deviation_of_logarithm(noise: float) -> float:
    """Of a lognormal factor with this coefficient of variation."""
    return math.sqrt(math.log(1.0 + noise**2))


@dataclass(frozen=True, slots=True)
class _Physics:
    """What a shape starts from: work on so many processors at once."""

    chance: random.Random
    work: float
    parallel: float

    def served(self, reserve: float) -> float:
        """Return the response time of the work alone at this CR."""
        return 100 * self.work / (self.parallel * reserve)


def hyperbola(physics: _Physics) -> Level:
    """Work, and time that no processor shortens: a + b / CR."""
    fixed = physics.served(100) * 10 ** physics.chance.uniform(-1.5, 1.0)
    return lambda reserve: fixed + physics.served(reserve)


def floor(physics: _Physics) -> Level:
    """Work down to a floor that more CPU does not lower."""
    lowest = physics.served(physics.chance.uniform(30, 100))
    return lambda reserve: max(lowest, physics.served(reserve))


def staircase(physics: _Physics) -> Level:
    """Return a quota in every period: the work waits for the next one whenever a quota is used up."""
    period = 10 ** physics.chance.uniform(0.0, 2.0)
    work = physics.work / physics.parallel

    def level(reserve: int) -> float:
        quota = period * reserve / 100
        waits = math.ceil(work / quota - 1e-9) - 1
        return work + waits * (period - quota)

    return level


def cliff(physics: _Physics) -> Level:
    """Good from some CR on, and hopeless below: what is asked every period must be served in it."""
    edge = physics.chance.randint(3, 99)
    good = physics.served(edge) * physics.chance.uniform(1.0, 1.5)
    bad = good * 10 ** physics.chance.uniform(0.3, 1.3)
    return lambda reserve: good * (1 + 0.1 / reserve) if reserve >= edge else bad * (edge / reserve) ** 0.2


def random_monotone(physics: _Physics) -> Level:
    """Any falling curve: the logarithm falls by gamma increments, some of them jumps, more of them at low CRs."""
    chance = physics.chance
    steepness, jumpiness = chance.uniform(0.0, 1.0), 10 ** chance.uniform(-0.5, 1.0)
    weights = [reserve**-steepness for reserve in range(1, 100)]
    falls = [chance.gammavariate(jumpiness * weight / max(weights), 1.0) for weight in weights]
    whole = math.log(10 ** chance.uniform(0.4, 1.7)) / sum(falls)
    logarithms = [0.0]
    for fall in reversed(falls):
        logarithms.append(logarithms[-1] + whole * fall)
    logarithms.reverse()
    return _above_its_work(physics, [math.exp(value) for value in logarithms])


def power(physics: _Physics) -> Level:
    """Contention that grows faster, or slower, than the share shrinks: a + b / CR ** k."""
    exponent = physics.chance.uniform(0.5, 2.0)
    fixed = physics.chance.uniform(0.0, 2.0)
    return _above_its_work(physics, [fixed + (100 / reserve) ** exponent for reserve in range(1, 101)])


def knees(physics: _Physics) -> Level:
    """Straight on logarithmic scales between two to four knees: phases of a job that need CPU in different measure."""
    chance = physics.chance
    at = [0.0, *sorted(math.log(chance.uniform(2, 99)) for _ in range(chance.randint(2, 4))), math.log(100)]
    slopes = [chance.uniform(0.02, 2.0) for _ in at[1:]]
    heights = [0.0]
    for lower, upper, slope in zip(at, at[1:], slopes, strict=False):
        heights.append(heights[-1] - slope * (upper - lower))

    def height(reserve: int) -> float:
        position = math.log(reserve)
        upper = next(number for number in range(1, len(at)) if position <= at[number] + 1e-9)
        part = (position - at[upper - 1]) / (at[upper] - at[upper - 1])
        return heights[upper - 1] + part * (heights[upper] - heights[upper - 1])

    return _above_its_work(physics, [math.exp(height(reserve)) for reserve in range(1, 101)])


def queue(physics: _Physics) -> Level:
    """Jobs that arrive at random wait for one another: nothing, then more and more, at last without end (capped)."""
    saturated = physics.chance.uniform(1.0, 95.0)

    def level(reserve: int) -> float:
        busy = saturated / reserve
        waiting = busy / (2.0 * (1.0 - busy)) if busy < 1.0 else math.inf
        return physics.served(reserve) * (1.0 + min(waiting, 50.0))

    return level


def edge(physics: _Physics) -> Level:
    """Flat down to an edge that nothing foretells, as of a maximum, and flat below it."""
    good = physics.served(1) * physics.chance.uniform(1.0, 2.0)
    bad, at = good * 10 ** physics.chance.uniform(0.3, 1.3), physics.chance.randint(2, 99)
    return lambda reserve: good if reserve >= at else bad


def stairs(physics: _Physics) -> Level:
    """Return a few edges, each of another height: what two settings show says nothing of what lies between them."""
    chance, base = physics.chance, physics.served(1)
    falls = [(chance.randint(2, 99), 10 ** chance.uniform(0.01, 1.0)) for _ in range(chance.randint(2, 5))]
    return lambda reserve: base * math.prod(fall for at, fall in falls if reserve < at)


def _above_its_work(physics: _Physics, values: Sequence[float]) -> Level:
    """Return the values at such a scale that at every CR there is time for the work, at one of them hardly more."""
    room = physics.chance.uniform(1.0, 2.5)
    scale = room * max(physics.served(reserve) / values[reserve - 1] for reserve in range(1, 101))
    return lambda reserve: scale * values[reserve - 1]


NAMED: dict[str, Callable[[_Physics], Level]] = {
    "a + b/CR": hyperbola,
    "floor": floor,
    "staircase": staircase,
    "cliff": cliff,
    "success S": hyperbola,
}
UNSEEN: dict[str, Callable[[_Physics], Level]] = {
    "random monotone": random_monotone,
    "power": power,
    "knees": knees,
    "queue": queue,
    "success, two modes": hyperbola,
}


ADVERSARIAL: dict[str, Callable[[_Physics], Level]] = {"edge": edge, "stairs": stairs}


def component(shape: str, seed: int, noise: float) -> Truth:
    """Return the component of this shape and seed: its least CR is uniform over those where its curve falls at all."""
    chance = random.Random(f"{shape}/{seed}/{noise}")
    physics = _Physics(chance, 10 ** chance.uniform(0.5, 2.5), chance.choice((1.0, 1.0, 2.0)))
    curve = (NAMED | UNSEEN | ADVERSARIAL)[shape](physics)
    level = tuple(curve(reserve) for reserve in range(1, 101))
    falls = [reserve for reserve in range(2, 100) if level[reserve - 2] > 1.001 * level[reserve - 1]]
    if shape == "cliff":
        falls = [max(falls, key=lambda reserve: level[reserve - 2] / level[reserve - 1])]
    least = chance.choice(falls) if falls else 2
    upper, lower = level[least - 2], level[least - 1]
    between = lower * (upper / lower) ** chance.random()
    truth = Truth(
        shape=shape,
        seed=seed,
        level=level,
        work=physics.work,
        noise=noise,
        correlation=chance.uniform(0.0, MOST_CORRELATION),
        limit_ms=None,
        heavy=0.0,
        visible=True,
        apt=between,
    )
    return _success(truth, between, chance) if shape.startswith("success") else truth


def _success(truth: Truth, between: float, chance: random.Random) -> Truth:
    """Return the limit that the wanted share of jobs meets at the level `between`; three in four show their times."""
    if truth.shape == "success S":
        # Its jobs differ by themselves: with nothing but a noise of 1 % the S would be the cliff once more.
        heavy = 0.0
        truth = replace(truth, noise=math.hypot(truth.noise, chance.uniform(0.1, 0.4)))
    else:
        heavy = chance.uniform(0.02, 0.3)
    wanted = chance.uniform(0.85, 0.99)
    if heavy and abs(1.0 - heavy - wanted) < 0.01:
        wanted -= 0.02  # the shelf between the modes is no place for a threshold: nothing could tell its ends apart
    low, high = between / 10, between * 20
    for _ in range(60):
        middle = math.sqrt(low * high)
        reached = replace(truth, limit_ms=middle, heavy=heavy).successes(between) >= wanted
        low, high = (low, middle) if reached else (middle, high)
    return replace(truth, limit_ms=high, heavy=heavy, visible=chance.random() < 0.75, apt=100 * wanted)


MOST_SETTINGS = 100  # all there are
NAME = "coi"


def goal_of(truth: Truth) -> Goal:
    """Return what is searched."""
    run = a_run()
    threshold = Fraction(truth.apt)
    if truth.limit_ms is None:
        member = Member(name=NAME, apt={"mean_response_time": AtMost(value=threshold)}, run=run)
    else:
        member = Member(name=NAME, apt={"success_rate": AtLeast(value=threshold)}, run=run)
    return Goal(
        members=(member,), processors=PROCESSORS, budget=Budget(most_ms=math.inf), precision=PRECISION
    )  # samples alone end a setting


def jobs(truth: Truth, reserve: int) -> Iterator[tuple[Sample, float]]:
    """Jobs without end at this CR, each with the processor time that it took; the same for the same component.

    Their times are rounded, as a data log has them.
    """
    chance = random.Random(f"{truth.shape}/{truth.seed}/{truth.noise}/{reserve}")
    spread = deviation_of_logarithm(truth.noise)
    fresh = math.sqrt(1.0 - truth.correlation**2)
    level, state, clock = truth.level[reserve - 1], chance.gauss(0.0, 1.0), 0.0
    while True:
        factor = math.exp(spread * state - spread**2 / 2)
        mode = 3.0 if truth.heavy and chance.random() < truth.heavy else 1.0
        response = level * factor * mode
        sample = Sample(
            began_ms=round(clock, DIGITS),
            response_ms=round(response, DIGITS) if truth.visible else None,
            successful=truth.limit_ms is None or response <= truth.limit_ms,
        )
        yield sample, truth.work * factor * mode
        clock += response
        state = truth.correlation * state + fresh * chance.gauss(0.0, 1.0)


@dataclass
class Bench:
    """Measures settings of one component: at one CR every strategy sees the same jobs."""

    truth: Truth
    goal: Goal

    def measure(self, step: Measure, settings: Sequence[Setting]) -> Setting:
        """Return the setting, ended as soon as the strategy says so, and as a data log gives it back.

        Args:
            settings: What was measured before; a setting at the same CR goes on.
        """
        before = begun_before(step.reserve, settings)
        own = sum(len(setting.series[0].samples) for setting in settings if setting.reserve == step.reserve)
        goal = self.goal if step.until_known else replace(self.goal, precision=0.0)
        samples: list[Sample] = []
        consumed, look = 0.0, next_look(own)
        for sample, work in jobs(self.truth, step.reserve):
            samples.append(sample)
            consumed += work
            if len(samples) < min(look, MOST_SAMPLES):
                continue
            setting = Setting(
                reserve=step.reserve,
                series=(self._series(samples, consumed, step.reserve),),
                seed=1,
                spent_ms=float(len(samples)),
            )
            if is_known(setting, before, goal) or is_clear(setting, goal, precision=step.precision):
                return setting
            look = next_look(len(samples))
        raise AssertionError("jobs never end")

    def _series(self, samples: list[Sample], consumed: float, reserve: int) -> Series:
        last = samples[-1]
        elapsed = last.began_ms + (last.response_ms or self.truth.level[reserve - 1])
        return Series(
            component=NAME, samples=tuple(samples), elapsed_ms=round(elapsed, DIGITS), cpu_ms=round(consumed, DIGITS)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Walk:
    """All that was measured of a component, in order, and how it ended."""

    settings: tuple[Setting, ...]
    end: Conclusion

    @property
    def samples(self) -> int:
        return sum(len(series.samples) for setting in self.settings for series in setting.series)


def walk(strategy: Strategy, setting_of: Callable[[Measure, Sequence[Setting]], Setting]) -> Walk:
    """Return what `rarms measure` measures of this component with this strategy: its loop, without a host."""
    settings: list[Setting] = []
    while len(settings) <= MOST_SETTINGS:
        step = strategy.decide(settings)
        if not isinstance(step, Measure):
            return Walk(settings=tuple(settings), end=step)
        setting = setting_of(step, settings)
        known = [each.reserve for each in settings]
        if step.reserve in known:
            settings[known.index(step.reserve)] = setting
        else:
            settings.append(setting)
    raise AssertionError(f"no end after {MOST_SETTINGS} settings")
