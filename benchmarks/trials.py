"""Searching a component whose truth is known: its settings are drawn job by job, until the verdict may be given."""

import math
import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction

from benchmarks.shapes import PROCESSORS, Truth, deviation_of_logarithm
from rarms_iac.measuring.loop import Strategy
from rarms_iac.measuring.search.trials import Goal, Member, is_clear
from rarms_iac.model.measurement import Sample, Series, Setting
from rarms_iac.model.outcomes import Conclusion, Measure
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.system import AtLeast, AtMost, Closed, Command, Run, SampleCount, Samples, Stop
from rarms_iac.statistics.verdicts import next_look
from rarms_iac.storage.datalog.columns import DIGITS

ALLOWED = 4000
"""Samples a setting may have: with a CV of 15 % and a correlation of 0.5, a mean is then known within 0.4 %."""

MOST_SETTINGS = 100  # all there are
NAME = "coi"


def goal_of(truth: Truth) -> Goal:
    """What is searched."""
    run = Run(
        start=Command(words=("job",)),
        files=(),
        environment={},
        folder=".",
        until=SampleCount(samples=ALLOWED),
        timeout=Milliseconds(Fraction(60_000)),
        stop=Stop(),
        arrival=Closed(),
        samples=Samples(source="json_lines"),
        deadline=None,
        failures=0,
    )
    threshold = Fraction(truth.apt)
    if truth.limit_ms is None:
        member = Member(name=NAME, apt={"mean_response_time": AtMost(value=threshold)}, run=run)
    else:
        member = Member(name=NAME, apt={"success_rate": AtLeast(value=threshold)}, run=run)
    return Goal(members=(member,), processors=PROCESSORS)


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
    """Measures settings of one component; what was drawn once is not drawn again by the next strategy."""

    truth: Truth
    goal: Goal
    done: dict[tuple[int, bool, float | None], Setting] = field(default_factory=dict)

    def measure(self, step: Measure) -> Setting:
        """The setting, ended as soon as the strategy says so, and as a data log gives it back."""
        key = (step.reserve, step.until_clear, step.precision)
        if key not in self.done:
            self.done[key] = self._setting(step)
        return self.done[key]

    def _setting(self, step: Measure) -> Setting:
        samples: list[Sample] = []
        consumed, look = 0.0, next_look(0)
        for sample, work in jobs(self.truth, step.reserve):
            samples.append(sample)
            consumed += work
            if len(samples) < min(look, ALLOWED):
                continue
            series = self._series(samples, consumed, step.reserve)
            clear = step.until_clear and is_clear({NAME: series}, self.goal, precision=step.precision)
            if len(samples) >= ALLOWED or clear:
                return Setting(reserve=step.reserve, series=(series,), seed=1)
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


def walk(strategy: Strategy, bench: Bench) -> Walk:
    """What `rarms measure` measures of this component with this strategy: its loop, without a host."""
    settings: list[Setting] = []
    while len(settings) <= MOST_SETTINGS:
        step = strategy.step(settings)
        if not isinstance(step, Measure):
            return Walk(settings=tuple(settings), end=step)
        settings.append(bench.measure(step))
    raise AssertionError(f"{bench.truth.shape} {bench.truth.seed}: no end after {MOST_SETTINGS} settings")
