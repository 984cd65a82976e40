"""How near the answers of `rarms measure` are: random components on the simulated host, against long runs.

`python -m laboratory.benchmarks.measuring [COMPONENTS [ANSWERS]]` measures so many components (400 unless said), of 0.5
to 500 ms, closed and periodic, beside a busy loop, by the default strategy and by bisection. Thresholds are what a long
run shows at a random reservation, or 5 % beyond what the whole host gives. Where two points less are hardly worse, as
on the floor of a curve, a threshold lies near no reservation: another one below is drawn. The truth is the least
reservation at which a long run meets the threshold. Settings that both strategies ask for are measured once. ANSWERS is
a file of JSON Lines: components that it has are not measured again.
"""

import json
import math
import os
import random
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from multiprocessing import Pool
from pathlib import Path
from statistics import fmean
from typing import cast

from laboratory.benchmarks.components import walk
from laboratory.benchmarks.timing import Figure, report
from rarms_iac.measuring.loop import measure_settings
from rarms_iac.measuring.methods import Search, strategy_of
from rarms_iac.measuring.partitions import host_resources
from rarms_iac.measuring.reporter import MeasuringReporter
from rarms_iac.measuring.setting_run import MeasuringContext
from rarms_iac.measuring.settings_log import SettingsLog
from rarms_iac.measuring.setup import Budget, Experiment, experiment_of
from rarms_iac.measuring.strategies import goal_of
from rarms_iac.model.indexes import percentile_of
from rarms_iac.model.outcomes import ExperimentDecision, Measure, NotAchievable, Sufficient, Swept, WithinNoise
from rarms_iac.model.run import Periodic
from rarms_iac.model.series import MOST_SAMPLES, Sample, Series, columns_of
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import Component, Threshold, run_of
from rarms_iac.providers.simulated.measuring import SimulatedMeasuringHost
from rarms_iac.providers.simulated.scheduling.machine import JobDone, ModelMachine
from rarms_iac.providers.simulated.scheduling.simulation import simulate
from rarms_iac.statistics.distributions import share_interval
from rarms_iac.statistics.error_probability import ERROR, samples_needed
from rarms_iac.statistics.samples import response_times
from rarms_iac.statistics.verdicts import judge_look, samples_to_clear
from tests.builders import a_component, a_host, a_run, a_simulation, a_system, at_least, at_most, milliseconds

COMPONENTS = 400
PROCESSES = int(os.environ.get("PROCESSES", "2"))
JOBS = int(os.environ.get("JOBS", "20000"))
"""Jobs of a long run."""

BUDGET = os.environ.get("BUDGET", "2 h")
"""The budget of a setting."""

STRATEGIES = ("default", "bisection")
HIGHEST = 97
"""Where the truth is above it, no answer is no failure: the noise of a threshold reaches beyond the host."""

LESS, WORSE = 2, 1.01
"""So many points below the reservation that a threshold is drawn at, its index is at least so many times worse."""

TRUE_SEED, TRUE_STARTS = 2, 100
SETTLED_MS, LEAST_MS = 1000.0, 500.0
"""After which what was measured of a start counts, and how long at least."""

IN_MEMORY = "/dev/shm"  # where there is one: what a host promises to have on the disk is not what is measured here
INDEXES = (
    "mean_response_time",
    "mean_response_time",
    "p90_response_time",
    "p95_response_time",
    "p99_response_time",
    "success_rate",
    "deadline_miss_rate",
    "throughput",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What a strategy found of a component, beside the truth."""

    strategy: str
    component: str
    index: str
    ending: str  # enough, not achievable, nothing
    reserve: int  # 0: none was found
    truth: int  # 101: no reservation is enough
    processors: int
    needs: int  # samples of a setting near the whole host, to show what is true there
    is_short: bool  # its budget holds fewer
    settings: int
    seconds: float  # on the host's clock


def random_component(seed: int) -> tuple[Component, str, int]:
    """Draw a component without a threshold, the index that is to have one, and the reservation that it is drawn at."""
    chance = random.Random(f"component/{seed}")
    work = math.exp(chance.uniform(math.log(0.5), math.log(500.0)))
    threads, processors = chance.choice((1, 1, 2)), chance.choice((1, 2))
    index = chance.choice(INDEXES)
    reserve = 101 if chance.random() < 0.1 else chance.randint(3, 97)
    alone = work / min(threads, processors)
    blocked = alone * chance.choice((0.0, 0.0, chance.uniform(0.0, 1.0)))
    every = None
    if index != "throughput" and chance.random() < 0.5:
        every = f"{(100 * alone / min(reserve, 100) + blocked) * chance.uniform(1.1, 3.0):.4f} ms"
    component = a_component(
        f"c{seed}",
        apt={},
        run=a_run(every=every, timeout="60 min"),
        processors=processors,
        simulation=a_simulation(
            work=f"{work:.4f} ms",
            blocked=f"{blocked:.4f} ms",
            varies=f"{chance.choice((0.0, 2.0, 10.0, 30.0)):g} %",
            threads=threads,
        ),
    )
    return component, index, reserve


@dataclass(frozen=True, slots=True)
class Once:
    """A strategy that asks for a single setting."""

    asked: Measure

    def decide(self, settings: Sequence[Setting]) -> ExperimentDecision:
        """Ask for the setting once, and end."""
        return Swept() if settings else self.asked


class Recorded:
    """A log in memory."""

    remeasure_seed = None
    is_simulated = True

    def __init__(self) -> None:
        self.all: tuple[Setting, ...] = ()

    def runs(self) -> tuple[Setting, ...]:
        """All of them."""
        return self.all

    def add(self, setting: Setting) -> None:
        """Take one more."""
        self.all = (*self.all, setting)


class Bench:
    """Measures settings of a component as `rarms measure` does; each of them once for all strategies."""

    def __init__(self, seed: int, folder: str) -> None:
        self.host = SimulatedMeasuringHost(a_host(), Path(folder) / "host.json", self.simulate)
        self.machine: ModelMachine
        self.bare, self.index, self.drawn_at = random_component(seed)
        self.long: dict[int, Series] = {}  # long runs, by CR
        self.leave_floor(random.Random(f"floor/{seed}"))
        self.component = self.with_threshold()
        self.experiment = self.of(self.component)
        self.done: dict[Measure, Setting] = {}

    def leave_floor(self, chance: random.Random) -> None:
        """Draw another reservation below while the index is hardly worse a little below."""
        least = max(LESS + 1, self.demand())
        while least < self.drawn_at <= 100 and self.level(self.drawn_at - LESS) < WORSE * self.level(self.drawn_at):
            self.drawn_at = chance.randint(least, self.drawn_at - 1)

    def demand(self) -> int:
        """The least CR that what is due does not overload: below, times have no level, but grow with a run."""
        arrival, simulation = run_of(self.bare).arrival, self.bare.simulation
        assert simulation is not None
        assert self.bare.processors is not None
        if not isinstance(arrival, Periodic):
            return 0
        return math.ceil(100 * simulation.work / arrival.period / min(simulation.threads, self.bare.processors))

    def of(self, component: Component) -> Experiment:
        """The experiment with this component."""
        system = a_system(components=[component])
        experiment = experiment_of(system, system.hosts["onboard"], (component.name,), "busy-loop")
        return replace(experiment, budget=Budget(most_ms=float(milliseconds(BUDGET))))

    def measure(self, step: Measure) -> Setting:
        """The setting that a strategy asks for."""
        if step not in self.done:
            [self.done[step]] = self.run(self.experiment, step, 1)
        return self.done[step]

    def run(self, experiment: Experiment, step: Measure, seed: int) -> tuple[Setting, ...]:
        """Run it now."""
        log = Recorded()
        with self.host.lock("benchmark"):
            context = MeasuringContext(
                host=self.host,
                resources=lambda: host_resources(a_host(), self.host.observe(), "robot"),
                seed=seed,
                reporter=MeasuringReporter(),
                should_stop=lambda: False,
            )
            measure_settings(experiment, Once(step), cast("SettingsLog", log), context)
        return log.all

    def series(self, reserve: int) -> Series:
        """A long run at this CR, of many starts of the load, each settled."""
        if reserve not in self.long:
            self.run(self.of(self.bare), Measure(reserve=reserve), TRUE_SEED)
            self.long[reserve] = self.long_run()
        return self.long[reserve]

    def long_run(self) -> Series:
        """One of these, on the machine that was measured last."""
        samples, starts = list[Sample](), list[int]()
        now = began = since = counted = 0.0
        machine = simulate(self.machine, TRUE_SEED)
        for job in machine:
            now = max(now, job.began + job.response)
            if now - began < SETTLED_MS:
                since = now
                continue
            at = job.began - since + counted
            samples.append(Sample(began_ms=at, response_ms=job.response, successful=True))
            if len(samples) * TRUE_STARTS >= JOBS * (len(starts) + 1) and now - since >= LEAST_MS:
                counted += now - since
                if len(starts) + 1 == TRUE_STARTS:
                    break
                starts.append(len(samples))
                machine.restart_loads()
                began = since = now
        name = self.bare.name
        return Series(component=name, samples=tuple(samples), elapsed_ms=counted, starts=tuple(starts))

    def simulate(self, machine: ModelMachine, seed: int) -> Iterator[JobDone]:
        """Run a machine, and keep it."""
        self.machine = machine
        return simulate(machine, seed)

    def rate(self, reserve: int) -> float:
        """Jobs a second at this CR."""
        series = self.series(reserve)
        return 1000 * len(series.samples) / series.elapsed_ms

    def level(self, reserve: int) -> float:
        """What falls with the CR: the index in ms, or the time within which its share of jobs answers."""
        times = sorted(response_times(self.series(reserve).samples))
        match self.index:
            case "mean_response_time":
                return fmean(times)
            case "throughput":
                return 1.0 / self.rate(reserve)
            case _:
                return times[math.ceil(self.share * len(times)) - 1]

    @property
    def share(self) -> float:
        """Of jobs that are to answer within the level."""
        percentile = percentile_of(self.index)
        return 0.95 if percentile is None else float(percentile) / 100

    @property
    def limit(self) -> float:
        """The level that the threshold asks for."""
        return self.level(self.drawn_at) if self.drawn_at <= 100 else 0.95 * self.level(100)

    def with_threshold(self) -> Component:
        """The component with its threshold."""
        limit = f"{self.limit:.6f}"
        match self.index:
            case "success_rate":
                assert self.bare.simulation is not None
                simulation = replace(self.bare.simulation, success_within=milliseconds(f"{limit} ms"))
                return replace(self.bare, apt={self.index: at_least(95)}, simulation=simulation)
            case "deadline_miss_rate":
                run = replace(run_of(self.bare), deadline=milliseconds(f"{limit} ms"))
                return replace(self.bare, apt={self.index: at_most(5)}, run=run)
            case "throughput":
                return replace(self.bare, apt={self.index: at_least(f"{1.0 / self.limit:.6f}")})
            case _:
                return replace(self.bare, apt={self.index: at_most(limit)})

    def samples_needed(self, index: str, threshold: Threshold) -> int:
        """Samples of a setting that show what is true at the highest CR that may be an answer."""
        series, run = self.series(HIGHEST), run_of(self.component)
        least = samples_needed(index, threshold)
        if index == "success_rate":
            limit = self.limit * (1 + 1e-6)
            good = [time <= limit for time in response_times(series.samples)]
            series = replace(series, samples=replace(columns_of(series.samples), successful=bytes(good), known={}))
        verdict = judge_look(series, {index: threshold}, run)
        if not isinstance(verdict, WithinNoise):
            return least
        [judged] = verdict.judged
        return max(least, round(min(1e9, samples_to_clear(judged, series) or 0.0)))

    def truth(self) -> int:
        """The least CR at which a long run meets the threshold; 101: none does."""
        low, high, limit = 0, 101, self.limit * (1 + 1e-6)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self.level(middle) <= limit else (middle, high)
        return high


def answers(seed: int) -> list[Answer]:
    """What every strategy finds of a component."""
    with tempfile.TemporaryDirectory(dir=IN_MEMORY if Path(IN_MEMORY).is_dir() else None) as folder:
        bench = Bench(seed, folder)
        return [_answer(bench, strategy) for strategy in STRATEGIES]


def _answer(bench: Bench, strategy: str) -> Answer:
    goal = goal_of(bench.experiment)
    done = walk(strategy_of(Search(strategy=strategy), goal, 100), bench.measure)
    [(index, threshold)] = bench.component.apt.items()
    enough = isinstance(done.end, Sufficient)
    needs = bench.samples_needed(index, threshold)
    return Answer(
        strategy=strategy,
        component=bench.component.name,
        index=index,
        ending="enough" if enough else "not achievable" if isinstance(done.end, NotAchievable) else "nothing",
        reserve=done.end.reserve if isinstance(done.end, Sufficient) else 0,
        truth=bench.truth(),
        processors=goal.processors,
        needs=needs,
        is_short=needs > MOST_SAMPLES or 1000 * needs / bench.rate(min(100, bench.drawn_at)) > goal.budget.most_ms,
        settings=len(done.settings),
        seconds=sum(setting.host_ms for setting in done.settings) / 1000,
    )


def figures(found: Sequence[Answer]) -> list[Figure]:
    """Of each strategy: wrong answers, components without one, how far answers lie above the truth, settings, time."""
    rows: list[Figure] = []
    for strategy in STRATEGIES:
        own = [answer for answer in found if answer.strategy == strategy and not answer.is_short]
        apart = [answer for answer in found if answer.strategy == strategy and answer.is_short]
        beyond = sum(answer.needs > MOST_SAMPLES for answer in apart)
        is_goal = strategy == "default"
        # NOTE: a long run knows the truth to about a point, where a threshold was drawn from one.
        wrong = [answer for answer in own if answer.reserve and answer.reserve < answer.truth - 1]
        wrong += [answer for answer in own if answer.ending == "not achievable" and answer.truth <= 100]
        existing = [answer for answer in own if answer.truth <= HIGHEST]
        over = sorted(answer.reserve - answer.truth for answer in existing if answer.reserve)
        lowest, _ = share_interval(len(wrong), len(own), error=0.1)
        missing = sum(not answer.reserve for answer in existing)
        rows += [
            Figure(name=f"{strategy}: {len(own)} components, wrong", value=100 * len(wrong) / len(own), unit="%"),
            Figure(name="  at least, by 95 %", value=100 * lowest, unit="%", at_most=100 * ERROR if is_goal else None),
            Figure(
                name="  no answer where there is one",
                value=100 * missing / len(existing),
                unit="%",
                at_most=3 if is_goal else None,
            ),
            Figure(name="  points too high, mean", value=fmean(over), unit="", at_most=1.5 if is_goal else None),
            Figure(
                name="    95th percentile",
                value=over[math.ceil(0.95 * len(over)) - 1],
                unit="",
                at_most=6 if is_goal else None,
            ),
            Figure(
                name="  counted apart: too few samples in the budget",
                value=100 * len(apart) / (len(own) + len(apart)),
                unit="%",
                at_most=10 if is_goal else None,
            ),
            Figure(name=f"    of these more than {MOST_SAMPLES:,} needed", value=float(beyond), unit=""),
            Figure(name="    of these answered", value=float(sum(answer.reserve > 0 for answer in apart)), unit=""),
            Figure(name="  settings", value=fmean(answer.settings for answer in own), unit=""),
            Figure(name="  time on the host, each", value=fmean(answer.seconds for answer in own) / 60, unit="min"),
        ]
    return rows


def main() -> int:
    """Print the table; 1 where a goal is missed."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else COMPONENTS
    file = Path(sys.argv[2] if len(sys.argv) > 2 else os.devnull)
    found = [Answer(**json.loads(line)) for line in file.read_text().splitlines()] if file.exists() else []
    known = {answer.component for answer in found}
    missing = [seed for seed in range(count) if f"c{seed}" not in known]
    with Pool(PROCESSES) as pool, file.open("a") as lines:
        for several in pool.imap_unordered(answers, missing):
            found += several
            lines.writelines(f"{json.dumps(asdict(answer))}\n" for answer in several)
            lines.flush()
    for answer in found:
        if not answer.reserve or not -1 <= answer.reserve - answer.truth <= 6:
            print(
                f"{answer.component} ({answer.strategy}, {answer.index}): {answer.ending}, {answer.reserve} % found, "
                f"{answer.truth} % true"
            )
    return report(figures(found))


if __name__ == "__main__":
    sys.exit(main())
