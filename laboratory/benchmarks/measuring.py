"""Whether what `rarms measure` finds enough is enough: random components on the simulated host, against long runs.

`python -m laboratory.benchmarks.measuring [COMPONENTS [ANSWERS]]` measures so many components (2,000 unless said), of
0.5 to 500 ms, closed and periodic, by every strategy. The same settings are measured once. What is found is run again
from another seed, until it is decided or for as long as it takes to know its index closely. An answer is wrong where
that run shows a threshold to be missed. ANSWERS is a file of JSON Lines: components that it has are not measured again.
"""

import json
import math
import os
import random
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from multiprocessing import Pool
from pathlib import Path
from statistics import fmean
from typing import cast

from laboratory.benchmarks.components import walk
from laboratory.benchmarks.timing import Figure, report
from rarms_iac.measuring.loop import MeasuringContext, MeasuringReporter, SettingsLog, measure
from rarms_iac.measuring.methods import Search, strategy_of
from rarms_iac.measuring.partitions import host_budget
from rarms_iac.measuring.search import STRATEGIES
from rarms_iac.measuring.setup import Experiment, experiment_of
from rarms_iac.measuring.strategies import goal_of
from rarms_iac.model.measurement import Setting
from rarms_iac.model.outcomes import ExperimentStep, Measure, Met, Missed, NotAchievable, Sufficient, Swept, Verdict
from rarms_iac.model.run import Elapsed
from rarms_iac.model.series import Series
from rarms_iac.model.system import AtMost, Component, Threshold, run_of
from rarms_iac.providers.simulated.measuring import SimulatedMeasuringHost
from rarms_iac.providers.simulated.scheduling.simulation import simulate
from rarms_iac.statistics.distributions import share_interval
from rarms_iac.statistics.error_probability import ERROR, shared_error
from rarms_iac.statistics.verdicts import judge
from tests.builders import a_component, a_host, a_run, a_simulation, a_system, at_most, milliseconds

COMPONENTS = 2000
PROCESSES = int(os.environ.get("PROCESSES", "2"))
MOST_UNRESOLVED = 5.0  # per cent
LONG_RUN = 40.0  # times as long as what is found took, and 20 s at least; it may end as soon as it is decided
SUREST = 1e-4  # a long run says that a threshold is missed with this error, whenever it ends
MOST_LOOKS = 32  # at a long run, which share the error: the last comes after two million jobs
IN_MEMORY = "/dev/shm"  # where there is one: what a host promises to have on the disk is not what is measured here


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What a strategy found of a component, and whether that is so."""

    strategy: str
    component: str
    ending: str  # enough, not achievable, nothing
    wrong: bool
    settings: int
    seconds: float  # on the host's clock


def random_component(seed: int) -> Component:
    """Draw a component with a threshold that some CR meets, more or less closely."""
    chance = random.Random(f"component/{seed}")
    work = math.exp(chance.uniform(math.log(0.5), math.log(500.0)))
    threads = chance.choice((1, 1, 2))
    enough = chance.uniform(3.0, 97.0) / 100.0  # of its processors, to answer in time
    alone = work / threads
    response = alone * chance.uniform(1.0, 1.3) / enough
    index = chance.choice(("mean_response_time", "mean_response_time", "p90_response_time"))
    apt: dict[str, Threshold] = {index: at_most(f"{response:.4f}")}
    blocked = alone * chance.choice((0.0, 0.0, chance.uniform(0.0, 1.0)))
    every = None
    if chance.random() < 0.5:
        every = f"{(alone / enough + blocked) * chance.uniform(1.1, 3.0):.4f} ms"
    return a_component(
        f"c{seed}",
        apt=apt,
        run=a_run(every=every, timeout="60 min"),
        simulation=a_simulation(
            work=f"{work:.4f} ms",
            blocked=f"{blocked:.4f} ms",
            varies=f"{chance.choice((0.0, 2.0, 10.0, 30.0)):g} %",
            threads=threads,
        ),
    )


@dataclass(frozen=True, slots=True)
class Once:
    """A strategy that asks for a single setting."""

    asked: Measure

    def step(self, settings: Sequence[Setting]) -> ExperimentStep:
        """See `loop.Strategy`."""
        return Swept() if settings else self.asked


class Recorded:
    """A log in memory."""

    def __init__(self) -> None:
        self.all: tuple[Setting, ...] = ()

    def settings(self) -> tuple[Setting, ...]:
        """All of them."""
        return self.all

    def add(self, setting: Setting) -> None:
        """Take one more."""
        self.all = (*self.all, setting)


class LongRun(MeasuringReporter):
    """Watches a setting until it is decided whether its thresholds are met."""

    def __init__(self, component: Component) -> None:
        self.component = component
        self.verdict: Verdict | None = None

    def samples_came(self, experiment: Experiment, reserve: int, seen: Mapping[str, Series]) -> None:  # noqa: ARG002 - a protocol's
        """Judge what was seen so far."""
        self.judge(seen[self.component.name])

    def judge(self, series: Series) -> None:
        """Keep the verdict on these samples."""
        error = shared_error(MOST_LOOKS, SUREST)
        self.verdict = judge(series, self.component.apt, run_of(self.component), error=error)

    def is_decided(self) -> bool:
        """Whether more samples are in vain."""
        return isinstance(self.verdict, Met | Missed)


class Bench:
    """Measures settings of a component as `rarms measure` does; each of them once for all strategies."""

    def __init__(self, component: Component, folder: str) -> None:
        self.component = component
        self.host = SimulatedMeasuringHost(a_host(), Path(folder) / "host.json", simulate)
        self.experiment = self.of(component)
        self.done: dict[Measure, Setting] = {}
        self.misses: dict[int, bool] = {}  # by CR: whether a long run shows that a threshold is missed

    def of(self, component: Component) -> Experiment:
        """The experiment with this component."""
        system = a_system(components=[component])
        return experiment_of(system, system.hosts["onboard"], (component.name,), "busy-loop")

    def measure(self, step: Measure) -> Setting:
        """The setting that a strategy asks for."""
        if step not in self.done:
            [self.done[step]] = self.run(self.experiment, step, 1, MeasuringReporter(), lambda: False)
        return self.done[step]

    def run(
        self,
        experiment: Experiment,
        step: Measure,
        seed: int,
        reporter: MeasuringReporter,
        should_stop: Callable[[], bool],
    ) -> tuple[Setting, ...]:
        """Run it now; nothing where it was stopped."""
        log = Recorded()
        with self.host.lock("benchmark"):
            context = MeasuringContext(
                host=self.host,
                budget=lambda: host_budget(a_host(), self.host.observe(), "robot"),
                seed=seed,
                reporter=reporter,
                should_stop=should_stop,
            )
            measure(experiment, Once(step), cast("SettingsLog", log), context)
        return log.all

    def is_missed(self, reserve: int) -> bool:
        """Whether a long run at this CR shows that a threshold is missed."""
        if reserve not in self.misses:
            [threshold] = self.component.apt.values()
            assert isinstance(threshold, AtMost)
            time = max(20_000.0, LONG_RUN * float(threshold.value))
            longer = replace(run_of(self.component), until=Elapsed(time=milliseconds(f"{time:.0f} ms")))
            watched = LongRun(replace(self.component, run=longer))
            step = Measure(reserve=reserve)
            for setting in self.run(self.of(watched.component), step, 2, watched, watched.is_decided):
                watched.judge(setting.series[0])
            self.misses[reserve] = isinstance(watched.verdict, Missed)
        return self.misses[reserve]


def answers(seed: int) -> list[Answer]:
    """What every strategy finds of a component."""
    component = random_component(seed)
    with tempfile.TemporaryDirectory(dir=IN_MEMORY if Path(IN_MEMORY).is_dir() else None) as folder:
        bench = Bench(component, folder)
        return [_answer(bench, strategy) for strategy in STRATEGIES]


def _answer(bench: Bench, strategy: str) -> Answer:
    done = walk(strategy_of(Search(strategy=strategy), goal_of(bench.experiment), 100), bench.measure)
    wrong, ending = False, "nothing"
    match done.end:
        case Sufficient(reserve=reserve):
            ending, wrong = "enough", bench.is_missed(reserve)
        case NotAchievable():
            ending = "not achievable"
        case _:
            pass
    return Answer(
        strategy=strategy,
        component=bench.component.name,
        ending=ending,
        wrong=wrong,
        settings=len(done.settings),
        seconds=sum(setting.series[0].elapsed_ms for setting in done.settings) / 1000,
    )


def figures(found: Sequence[Answer]) -> list[Figure]:
    """Of each strategy: answers, wrong ones with their lower limit, components without an answer, settings, time."""
    rows: list[Figure] = []
    for strategy in STRATEGIES:
        own = [answer for answer in found if answer.strategy == strategy]
        enough = [answer for answer in own if answer.ending == "enough"]
        wrong = sum(answer.wrong for answer in enough)
        lowest, _ = share_interval(wrong, len(enough), error=0.1)
        unresolved = 100 * sum(answer.ending == "nothing" for answer in own) / len(own)
        rows += [
            Figure(
                name=f"{strategy}: {len(enough)} found enough, of these wrong",
                value=100 * wrong / len(enough),
                unit="%",
            ),
            Figure(name="  at least, by 95 %", value=100 * lowest, unit="%", at_most=100 * ERROR),
            Figure(name="  no answer", value=unresolved, unit="%", at_most=MOST_UNRESOLVED),
            Figure(name="  settings", value=fmean(answer.settings for answer in own), unit=""),
            Figure(name="  time on the host", value=fmean(answer.seconds for answer in own), unit="s"),
        ]
    return rows


def main() -> int:
    """Print the table; 1 where answers are wrong more often than declared, or too many components have none."""
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
    for name, amiss in (
        ("wrong", [answer for answer in found if answer.wrong]),
        ("no answer", [answer for answer in found if answer.ending == "nothing"]),
    ):
        print(f"{name}:", *sorted(f"{answer.component} ({answer.strategy})" for answer in amiss))
    return report(figures(found))


if __name__ == "__main__":
    sys.exit(main())
