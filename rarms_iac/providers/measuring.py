"""The interface of hosts that are measured on: P1 and P2 are ordinary partitions; here something runs in them.

A host that is measured on is also changed (`StepwiseHost`): lock, marks and removal are the same as everywhere.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from rarms_iac.diff.readings import resolve
from rarms_iac.model.commands import APPLY, PLAN, Wording, command, prose
from rarms_iac.model.loads import Interference
from rarms_iac.model.plan import Scope
from rarms_iac.model.run import Elapsed, SampleCount
from rarms_iac.model.series import Sample
from rarms_iac.model.setting import PartitionShape, PlatformFacts, SettingEvidence
from rarms_iac.model.state import Partition, State
from rarms_iac.model.system import Component
from rarms_iac.planner.task_classes import ClassValues
from rarms_iac.providers.interface import HostRefused, ReadableHost, ScriptedHost, StepwiseHost


@dataclass(frozen=True, slots=True)
class Obstacle:
    """The reason why a host cannot run a component or a load, with advice."""

    reason: str  # follows its name
    advice: Wording


NO_RUN = Obstacle("it has no `run`", "Add a `run` with a command.")
"""On every host that runs real components."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PartitionWork:
    """Components and load for one running partition of the application, or the host's own operating system."""

    partition: str  # as its mark calls it (P1, P2, vision); empty: the host's own operating system
    components: tuple[Component, ...] = ()
    load: Interference | None = None  # bursts that say no duty take what the partition reserves
    classes: tuple[ClassValues, ...] = ()  # of the components' tasks, where they go with the processes
    deadline_period_us: int | None = None  # Linux: its component's first thread gets the reservation in each (deadline)


@dataclass(frozen=True, slots=True, kw_only=True)
class Work:
    """Everything that is to run on a host at the same time."""

    application: str
    partitions: tuple[PartitionWork, ...]
    until: Mapping[str, SampleCount | Elapsed]  # by component: when there is enough of it; the others only run along
    seed: int  # of chance, where the host draws it: the same work with the same seed shows the same samples
    least_ms: float = 0.0  # and how long all of it goes on at least, from `count_from_now`


class RemainingSamples:
    """The samples and the time that a work still needs, from the moment on at which they count."""

    def __init__(self, work: Work, now_ms: float) -> None:
        """Begin to count.

        Args:
            work: with the `until` of its components.
        """
        until = work.until.values()
        times = [float(end.time) for end in until if isinstance(end, Elapsed)]
        self._until_ms = now_ms + max(work.least_ms, *times, 0.0)
        self._missing = {name: end.samples if isinstance(end, SampleCount) else 1 for name, end in work.until.items()}

    def take(self, component: str) -> None:
        """Count a sample of a component."""
        if component in self._missing:
            self._missing[component] -= 1

    def are_over(self, now_ms: float) -> bool:
        """Return whether every component has enough, and the time has passed."""
        return now_ms >= self._until_ms and all(missing <= 0 for missing in self._missing.values())


class RunningWork(Protocol):
    """Components at work."""

    def samples(self) -> Iterator[tuple[str, Sample]]:
        """Yield a component's name and the sample of a job of it, in the order in which the jobs ended.

        It ends when every component had its `until`, and `least_ms` have passed; a component that has enough goes on
        meanwhile, so that the others see it. A caller that has seen enough before stops asking. Called once; each step
        waits for the next job.

        Raises:
            HostError: it cannot go on.
        """

    def count_from_now(self) -> None:
        """Begin to count `until` and `least_ms`: what was before has settled. May be called between two samples."""

    def restart_load(self) -> bool:
        """Start the loads that never pause again at a random moment, the components running on.

        May be called between two samples. What begins so takes a while to settle.

        Returns:
            False: no such load, or this host cannot.
        """

    def elapsed_ms(self) -> float:
        """Return the time, in ms on the host's clock, since all of it began to run. Cheap: asked at every look."""

    def cpu_ms(self, component: str) -> float | None:
        """Return the processor time, in ms, that a component consumed so far. Cheap: asked at every look.

        Args:
            component: One of the work, by name.

        Returns:
            None if it is unknown.
        """

    def used_processors(self, partition: str) -> int | None:
        """Return the most processors that the components of a partition of the work were seen to use at once.

        These are threads that ran, or waited for a processor, at once; what made up at most 1 % of the time with a job
        under way does not count. Cheap: asked at every look.

        Args:
            partition: As the work names it; one that runs components.

        Returns:
            At least 1, also above what the partition has; None where it cannot be seen.
        """

    def evidence(self) -> SettingEvidence | None:
        """Return the host's counts since `count_from_now`.

        Returns:
            None: it counts nothing, because nothing can disturb it.

        Raises:
            HostError: it cannot be read.
        """


def running_partition(state: State, partition: str, application: str) -> Partition:
    """Return the partition of an application that runs under this name.

    Raises:
        HostRefused: it is not there or does not run.
    """
    found = resolve(state.partitions, partition, Scope(application=application, plan=""))
    if len(found) != 1:
        advice = prose("Show the changes with ", PLAN, ", and apply them with ", APPLY, ".")
        raise HostRefused(state.facts.name, f"the partition {partition} of {application} does not exist", advice)
    if not found[0].settings.running:
        advice = prose("Start it: ", command("start", partition), ".")
        raise HostRefused(state.facts.name, f"the partition {partition} of {application} is stopped", advice)
    return found[0]


class WorkHost(ReadableHost, Protocol):
    """A host on which components can be run and looked at.

    What is measured must hold in service, where nothing but the reservation is promised. So P1 gets exactly CR as soon
    as it asks for more: P2 reserves all that the host's processors have, less CR and less what machines of others
    reserve, what is kept for the host included, and has the highest weight for what is not claimed
    (`storage.datalog.identity.CONFINEMENT`, a part of each log's identity). Both are set by ordinary operations. A
    provider keeps to what they say: reserves first, then weights over the whole host. One that cannot must bring the
    same about otherwise, and change that part for its logs.
    """

    def platform_facts(self) -> PlatformFacts:
        """Describe what of this machine can change what is measured on it, equal as long as that is equal.

        Raises:
            HostError: the host cannot be reached or read.
        """

    @property
    def scheduler_memory_ms(self) -> float:
        """How long, in ms, this host's scheduler lets what happened decide what happens: its longest window.

        What is measured before that has passed many times over (`measuring/sampling.py`) may show how the work began,
        and not how it goes on.
        """

    def obstacle(self, subject: Component | Interference, *, in_its_partition: bool = False) -> Obstacle | None:
        """Say why this host cannot run a component or a load; asked before anything is changed for it.

        Args:
            in_its_partition: whether it is to run in the partition that was applied for it, not in a test partition.

        Returns:
            None: nothing is known that would keep it from running.
        """

    def run(self, work: Work) -> AbstractContextManager[RunningWork]:
        """Have all of it running while the context lasts; when it ends, what still runs of it is ended.

        Args:
            work: Its partitions are there and run; nothing is made for it here. At most one work runs at a time, and
                the caller holds the host's lock.

        Raises:
            Refused: a partition is not there or does not run, or something of the work cannot run on this host.
            HostError: it cannot be started.
        """

    def lock(self, owner: str, timeout_ms: int = 0) -> AbstractContextManager[None]:
        """Hold the host, as `StepwiseHost.lock`; where scripts change it, each script holds it while it runs."""


@runtime_checkable
class StepwiseMeasuringHost(WorkHost, StepwiseHost, Protocol):
    """A `WorkHost` whose test partitions are made by ordinary operations, one after another."""


@runtime_checkable
class ScriptedMeasuringHost(WorkHost, ScriptedHost, Protocol):
    """A `WorkHost` whose test partitions are made by the script that measures, and are gone when it ends."""

    def test_partitions(self, shapes: Sequence[PartitionShape]) -> AbstractContextManager[None]:
        """Have these test partitions for every `run` in the context.

        Args:
            shapes: as they are made, with the first `run`; they are gone when the context has ended.

        Raises:
            HostError: they cannot be removed.
        """

    def set_reserves(self, reserves: Mapping[str, int]) -> None:
        """Have test partitions reserve so much from the next `run` on.

        Args:
            reserves: per cent of each processor, by name.
        """

    def remove_test_partitions(self) -> None:
        """Remove what a killed measurement left.

        Raises:
            HostError: one cannot be removed.
        """

    def measuring_script(
        self, application: str, shapes: Sequence[PartitionShape], partitions: Sequence[PartitionWork]
    ) -> str:
        """Make the script that measures this.

        Args:
            partitions: what runs in them, and in others; without both it only removes what a killed one left.

        Returns:
            Its text, with CRLF.

        Raises:
            HostError: it cannot be observed, or something of the work cannot run there.
        """


MeasuringHost = StepwiseMeasuringHost | ScriptedMeasuringHost
