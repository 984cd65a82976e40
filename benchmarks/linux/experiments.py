"""The Linux delivery robot's components at work in control groups: what each shows at one reservation or one load.

Independent of `rarms measure`: groups are written by hand, so that its answers can be held against what is seen here.
Each experiment is recorded in a file as it ends, so that it is done once, however often the evaluation is ended.
"""

import json
import os
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import pairwise
from math import ceil, inf
from pathlib import Path
from statistics import median
from typing import Any

from rarms_iac.model.loads import Browser, BusyLoop, CommandLoad, Interference
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.run import Elapsed, Periodic
from rarms_iac.model.series import Sample, Series
from rarms_iac.model.system import AtMost, Component, run_of
from rarms_iac.providers.cgroups.groups import GroupTree, GroupValues
from rarms_iac.providers.cgroups.trees import MissingFeatures, find_tree
from rarms_iac.running.component import ComponentRun
from rarms_iac.running.loads import InterferingLoad
from rarms_iac.running.orders import ProcessPlace, StartContext

SLICE = "rarms-evaluation"
COMPONENT_GROUP, LOAD_GROUP = "components", "load"
BUSY = BusyLoop()
SETTLE_MS = 500.0
"""What a component does in so long from its first job on is not counted."""

STARTS_WITH = 80
"""What a component reserves, in per cent, until its first job is done."""

FEWEST_JOBS, MOST_SECONDS = 40, 8.0
"""A run of a reservation goes on until it has so many jobs, or for so long."""

SECONDS, USAGE_SECONDS, USAGE_WINDOW_S = 3.0, 12.0, 1.0
MEASURED_S, MEASURED_JOBS = 30.0, 80
"""`rarms measure` takes a periodic component's jobs of so long at most for a setting, and so many of another one's."""

PAIRS = ((50, 50), (75, 25), (75, 0))
"""What P1 and P2 reserve in the paper's Fig. 4."""

Values = Mapping[str, float]
"""By index of the APT, in its own unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """One thing to try with a component; `setting` is a reservation, what a load uses, or a number of browsers."""

    kind: str  # measured, alone, reserve, class, browsers
    component: str
    setting: int = 0
    repeat: int = 1

    def __str__(self) -> str:
        return f"{self.component}, {self.kind} {self.setting}, run {self.repeat}"


Record = Mapping[str, Any]
"""What an experiment showed, as JSON."""


@dataclass(slots=True, kw_only=True)
class Log:
    """The experiments that were done, in a file with a line each."""

    path: Path
    records: dict[Experiment, Record] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.path.exists():
            for line in self.path.read_text(encoding="utf-8").splitlines():
                record = json.loads(line)
                self.records[Experiment(**record.pop("experiment"))] = record

    def add(self, experiment: Experiment, record: Record) -> None:
        """Record an experiment that was done."""
        of = {name: getattr(experiment, name) for name in Experiment.__slots__}
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"experiment": of, **record}) + "\n")
        self.records[experiment] = record

    def runs(self, kind: str, component: str, setting: int) -> list[Series]:
        """All runs of a component at one setting, in order."""
        found = sorted(
            (experiment.repeat, record)
            for experiment, record in self.records.items()
            if (experiment.kind, experiment.component, experiment.setting) == (kind, component, setting)
        )
        return [series_of(component, record["series"]) for _, record in found]


@dataclass(frozen=True, slots=True, kw_only=True)
class Workbench:
    """The machine with the robot on it, and two groups that share its processors."""

    tree: GroupTree
    robot: Path  # a copy with `data`
    environment: Mapping[str, str]  # the PATH begins with the robot's own programs
    processors: int

    def perform(self, experiment: Experiment, component: Component, priority: int | None) -> Record:
        """Do an experiment.

        Args:
            priority: SCHED_FIFO's of its class; None: the ordinary class.

        Returns:
            What is to be recorded.
        """
        match experiment.kind:
            case "measured":
                return {"reserve": self._measured(component)}
            case "alone":
                return self._alone(component)
            case "reserve":
                return self.at_reserve(component, experiment.setting, priority)
            case "class":
                return self._at_load(component, experiment.setting, priority)
            case "browsers":
                return self._with_browsers(component, experiment.setting)
            case _:
                raise ValueError(experiment.kind)

    def split(self, p1: float, p2: float) -> None:
        """Give the component and the load so many per cent of the host."""
        self.tree.write(COMPONENT_GROUP, GroupValues(shares_percent=p1 * self.processors))
        self.tree.write(LOAD_GROUP, GroupValues(shares_percent=p2 * self.processors))

    def context(self, place: ProcessPlace) -> StartContext:
        """Return the surroundings of something that starts in this place."""
        return StartContext(base=self.robot, environment=self.environment, inside=place)

    @contextmanager
    def load(self, load: Interference | None, reserve: float | None = None) -> Iterator[None]:
        """Have a load running in its group; `reserve`: per cent of the host that its bursts take."""
        if load is None:
            yield
            return
        context = self.context(self.tree.place(LOAD_GROUP))
        with InterferingLoad("load", load, context, processors=self.processors, reserve=reserve):
            yield

    def run(
        self,
        component: Component,
        place: ProcessPlace,
        seconds: float,
        *,
        fewest: int = 0,
        begin: Callable[[], None] = lambda: None,
    ) -> Record:
        """Run a component for so long, and on until it has so many jobs, `MOST_SECONDS` at most.

        Its first job ends its start; then `begin` is called, and what is seen from `SETTLE_MS` later on counts.
        """
        assert component.run is not None
        samples: list[Sample] = []
        consumed: list[tuple[float, float, float]] = []  # time in ms, processor time of component and load
        until = Elapsed(time=Milliseconds(Fraction(10**9)))
        with ComponentRun(component.name, replace(component.run, until=until), self.context(place)) as run:
            next(run)
            begin()
            began = time.perf_counter()
            for sample in run:
                now = 1000 * (time.perf_counter() - began)
                if now < SETTLE_MS:
                    continue
                if not consumed or now - consumed[-1][0] >= 1000 * USAGE_WINDOW_S:
                    consumed.append((now, self.tree.cpu_ms(COMPONENT_GROUP), self.tree.cpu_ms(LOAD_GROUP)))
                samples.append(sample)
                lasted = (now - consumed[0][0]) / 1000
                if lasted >= seconds and (len(samples) >= fewest or lasted >= MOST_SECONDS):
                    break
        first = min(sample.began_ms for sample in samples)
        ended = max(sample.began_ms + (sample.response_ms or 0.0) for sample in samples)
        rows = [(round(each.began_ms - first, 3), each.response_ms, each.successful, each.count) for each in samples]
        return {"series": {"elapsed_ms": ended - first, "samples": rows}, "consumed": consumed}

    def at_reserve(
        self,
        component: Component,
        reserve: int,
        priority: int | None,
        *,
        load: Interference = BUSY,
        seconds: float = SECONDS,
    ) -> Record:
        """Run a component with a load with so many per cent of the host, in its class where it has one.

        It starts with nearly everything: to load its programs with 5 % takes half a minute.
        """
        place = self.tree.place(COMPONENT_GROUP)
        if priority is not None:
            place = replace(place, words=("chrt", "-f", str(priority)))

        def reserve_all(percent: int) -> None:
            self.split(percent, 100 - percent)
            if priority is not None:
                self.tree.allow_real_time(COMPONENT_GROUP, percent)

        reserve_all(STARTS_WITH)
        with self.load(load, reserve=100.0 - reserve):
            return self.run(component, place, seconds, fewest=FEWEST_JOBS, begin=lambda: reserve_all(reserve))

    def _measured(self, component: Component) -> float:
        """Return what `rarms measure` finds, in per cent of the host."""
        arrival = run_of(component).arrival
        jobs = round(1000 * MEASURED_S / arrival.period) if isinstance(arrival, Periodic) else MEASURED_JOBS
        words = ("rarms", "measure", component.name, "--samples", str(jobs), "--json")
        done = subprocess.run(
            words, cwd=self.robot, env=dict(self.environment), stdout=subprocess.PIPE, text=True, check=True
        )
        (found,) = json.loads(done.stdout)["experiments"]
        return percent_of_host(found)

    def _alone(self, component: Component) -> Record:
        """Nothing runs next to the component."""
        self.split(50, 50)
        return self.run(component, self.tree.place(COMPONENT_GROUP), USAGE_SECONDS)

    def _at_load(self, component: Component, percent: int, priority: int | None) -> Record:
        """Run a component in one system with a load that uses so many per cent of every processor.

        It shares a group with the load, so that the two are alike but for their class. A thread of SCHED_FIFO runs
        outside the groups, whose budget of such time is none under version 1.
        """
        words = ("stress-ng", "--cpu", str(self.processors), "--cpu-load", str(percent), "--cpu-load-slice", "20")
        load = CommandLoad(command=words) if percent else None
        place = self.tree.place(LOAD_GROUP) if priority is None else ProcessPlace(words=("chrt", "-f", str(priority)))
        self.split(50, 50)
        with self.load(load):
            return self.run(component, place, SECONDS)

    def _with_browsers(self, component: Component, browsers: int) -> Record:
        """Run a component with browsers in P2, with each pair of reservations."""
        series = []
        self.split(50, 50)
        with self.load(Browser(instances=browsers) if browsers else None):
            for pair in PAIRS:
                self.split(*pair)
                series.append(self.run(component, self.tree.place(COMPONENT_GROUP), SECONDS)["series"])
        return {"pairs": series}


@contextmanager
def workbench(robot: Path, environment: Mapping[str, str], processors: int) -> Iterator[Workbench]:
    """Make the two groups, and remove them with all that runs in them; meanwhile this process runs before the load.

    Raises:
        RuntimeError: control groups, or the right to make some, are missing.
    """
    tree = find_tree(SLICE)
    match tree:
        case MissingFeatures(names=names):
            raise RuntimeError("; ".join(names))
        case GroupTree():
            pass
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        for name in (COMPONENT_GROUP, LOAD_GROUP):
            tree.make(name)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        yield Workbench(tree=tree, robot=robot, environment=environment, processors=processors)
    finally:
        os.sched_setscheduler(0, *before)
        for name in tree.names():
            tree.remove(name)


def percent_of_host(found: Record) -> float:
    """Return what an experiment of `rarms measure` found, in per cent of the host.

    The experiment's own numbers are of the processors used.
    """
    return float((found["planned"] or found["reserve"]) * found["processors"] / found["host_lp"])


def series_of(component: str, recorded: Record) -> Series:
    """Return the series of a run as it was recorded."""
    samples = tuple(
        Sample(began_ms=began, response_ms=response, successful=successful, count=count)
        for began, response, successful, count in recorded["samples"]
    )
    return Series(component=component, samples=samples, elapsed_ms=recorded["elapsed_ms"], wanders=True)


def work_of(record: Record) -> float:
    """Return what a job of a run consumed on average, in ms of processor time."""
    (began, before, _), (ended, after, _) = record["consumed"][0], record["consumed"][-1]
    series = record["series"]
    return float((after - before) / (ended - began) * series["elapsed_ms"] / len(series["samples"]))


def usage(record: Record, processors: int) -> tuple[float, ...]:
    """Return what a component consumed second by second, in per cent of the host."""
    consumed = record["consumed"]
    return tuple(
        100 * (after[1] - before[1]) / (after[0] - before[0]) / processors for before, after in pairwise(consumed)
    )


def values_in(runs: Sequence[Series], component: Component) -> Values:
    """Return the medians of every index over several runs."""
    seen = [values_of(component, run) for run in runs]
    return {index: median(values[index] for values in seen) for index in component.apt}


def value_of(index: str, series: Series) -> float:
    """Return an index of a run as it was seen, in its own unit; of response times, infinity where no job answered."""
    times = [sample.response_ms for sample in series.samples if sample.response_ms is not None]
    successes = [sample.count for sample in series.samples if sample.successful]
    match index:
        case "mean_response_time":
            return sum(times) / len(times) if times else inf
        case "p95_response_time":
            return percentile(times, 95) if times else inf
        case "success_rate":
            return 100 * len(successes) / max(1, len(series.samples))
        case "throughput":
            return 1000 * sum(successes) / series.elapsed_ms
        case _:
            raise ValueError(index)


def values_of(component: Component, series: Series) -> Values:
    """Return every index of the component's APT as it was seen in a run."""
    return {index: value_of(index, series) for index in component.apt}


def meets(component: Component, values: Values) -> bool:
    """Tell whether every index of the component's APT is met."""
    return all(
        values[index] <= threshold.value if isinstance(threshold, AtMost) else values[index] >= threshold.value
        for index, threshold in component.apt.items()
    )


def percentile(values: Sequence[float], percent: int) -> float:
    """Return the least of the values that so many per cent of them do not exceed."""
    return sorted(values)[max(0, ceil(len(values) * percent / 100) - 1)]
