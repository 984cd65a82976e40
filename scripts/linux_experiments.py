"""The Linux delivery robot's components at work in control groups: what each shows at one reservation or one load.

Independent of `rarms measure`: groups are written by hand, so that its answers can be held against what is seen here.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from math import ceil, inf
from pathlib import Path

from rarms_iac.model.measurement import Series
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.run import Elapsed
from rarms_iac.model.system import AtMost, BusyLoop, CommandLoad, Component, Interference
from rarms_iac.providers.cgroups.groups import GroupTree, GroupValues, MissingFeatures, find_tree
from rarms_iac.running.component import ComponentRun
from rarms_iac.running.loads import InterferingLoad
from rarms_iac.running.start import ProcessPlace, StartContext

SLICE = "rarms-evaluation"
COMPONENT_GROUP, LOAD_GROUP = "components", "load"
BUSY = BusyLoop()
USAGE_WINDOW_S = 1.0

Values = Mapping[str, float]
"""By index of the APT, in its own unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Laboratory:
    """The machine with the robot on it, and two groups that share its processors."""

    tree: GroupTree
    robot: Path  # a copy with `data`
    environment: Mapping[str, str]  # the PATH begins with the robot's own programs
    processors: int
    seconds: float  # a run goes on for so long

    def split(self, reserve: float) -> None:
        """Give the component so many per cent of the host, and the load the rest."""
        self.tree.write(COMPONENT_GROUP, GroupValues(shares_percent=reserve * self.processors))
        self.tree.write(LOAD_GROUP, GroupValues(shares_percent=(100 - reserve) * self.processors))

    def context(self, place: ProcessPlace) -> StartContext:
        """The surroundings of something that starts in this place."""
        return StartContext(base=self.robot, environment=self.environment, inside=place)

    @contextmanager
    def load(self, load: Interference | None) -> Iterator[None]:
        """Have a load running in its group."""
        if load is None:
            yield
            return
        with InterferingLoad("load", load, self.context(self.tree.place(LOAD_GROUP)), processors=self.processors):
            yield

    def run(self, component: Component, place: ProcessPlace) -> Series:
        """Run a component for a while."""
        assert component.run is not None
        elapsed = Elapsed(time=Milliseconds(Fraction(round(1000 * self.seconds))))
        with ComponentRun(component.name, replace(component.run, until=elapsed), self.context(place)) as run:
            for _ in run:
                pass
        return run.series()

    def at(self, component: Component, reserve: float) -> Series:
        """Run a component at one reservation beside busy loops on every processor."""
        self.split(reserve)
        with self.load(BUSY):
            return self.run(component, self.tree.place(COMPONENT_GROUP))

    def at_load(self, component: Component, percent: int, priority: int | None) -> Series:
        """Run a component in one system with a load that uses so many per cent of every processor.

        Args:
            component: Shares a group with the load, so that the two are alike but for their class.
            percent: 0 to 100.
            priority: A SCHED_FIFO priority; None: the ordinary class. A thread of that class runs outside the groups,
                whose budget of such time is none under version 1.
        """
        words = ("stress-ng", "--cpu", str(self.processors), "--cpu-load", str(percent), "--cpu-load-slice", "20")
        load = CommandLoad(command=words) if percent else None
        place = self.tree.place(LOAD_GROUP) if priority is None else ProcessPlace(words=("chrt", "-f", str(priority)))
        with self.load(load):
            return self.run(component, place)

    def usage(self, component: Component, seconds: int) -> tuple[float, ...]:
        """Measure what a component consumes of the host, in per cent, second by second, with nothing beside it."""
        assert component.run is not None
        elapsed = Elapsed(time=Milliseconds(Fraction(1000 * seconds)))
        self.split(50)
        consumed: list[tuple[float, float]] = []
        with ComponentRun(
            component.name, replace(component.run, until=elapsed), self.context(self.tree.place(COMPONENT_GROUP))
        ) as run:
            for _ in run:
                now = time.perf_counter()
                if not consumed or now - consumed[-1][0] >= USAGE_WINDOW_S:
                    consumed.append((now, self.tree.cpu_ms(COMPONENT_GROUP)))
        return tuple(
            (after - before) / (end - begin) / 10 / self.processors
            for (begin, before), (end, after) in pairwise(consumed)
        )


@contextmanager
def laboratory(robot: Path, environment: Mapping[str, str], processors: int, seconds: float) -> Iterator[Laboratory]:
    """Make the two groups, and remove them with all that runs in them.

    Raises:
        RuntimeError: control groups, or the right to make some, are missing.
    """
    tree = find_tree(SLICE)
    match tree:
        case MissingFeatures(names=names):
            raise RuntimeError("; ".join(names))
        case GroupTree():
            pass
    try:
        for name in (COMPONENT_GROUP, LOAD_GROUP):
            tree.make(name)
        yield Laboratory(tree=tree, robot=robot, environment=environment, processors=processors, seconds=seconds)
    finally:
        for name in tree.names():
            tree.remove(name)


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
