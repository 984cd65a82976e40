"""What measuring yields: samples of jobs (many as columns), a series a component, a setting a reservation."""

from array import array
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from math import isnan, nan
from operator import attrgetter
from typing import TypeVar, cast, overload

from rarms_iac.model.host import ProviderKind, SchedulerType
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.run import Closed, Command, Run, SampleCount, Samples, Stop
from rarms_iac.model.system import Component

P1 = "rarms-p1"
"""The test partition of the components; what its mark calls it. No partition of a manifest may be called so."""

P2 = "rarms-p2"
"""The test partition of the interfering load."""

TEST_PARTITIONS = (P1, P2)

P2_WEIGHT = 10_000
"""The highest weight that Hyper-V and control groups know: what P1's own processors leave idle goes to P2."""

CONFINEMENT = f"P2 reserves all the rest, and has the weight {P2_WEIGHT}"
"""How P1 is held to CR while it is measured: a condition of a data log (docs/data-logs.md)."""

GROUP_CONFINEMENT = "control groups P1 and P2 weigh what they reserve, and P2 reserves all the rest"
"""The same on Linux, where weight beside a reserve has no meaning."""


LARGEST_SAMPLE = 1e12
"""The largest time (in milliseconds: thirty years) or count of a sample; sums and squares of many stay finite."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """What one job of a component showed."""

    began_ms: float  # since the setting began; of a periodic job, its scheduled start
    response_ms: float | None  # None: no answer
    successful: bool
    count: float = 1.0  # how much it did
    failure: str = ""  # why it is a failed sample (death, time-out, unreadable); empty: it is none


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """All samples of a component at one setting, in the order in which their jobs ended."""

    component: str
    samples: Sequence[Sample]  # `SampleColumns`, where there may be many
    elapsed_ms: float
    cpu_ms: float | None = None  # processor time that the component consumed; None: cannot be told here
    unsettled: str = ""  # why it says nothing of the next hour: the host had not settled; empty: it had
    wanders: bool = False  # real processes, all samples of a setting: the machine's speed changes for seconds


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingEvidence:
    """What a host's kernel counted while samples were taken: whether the setting was what it says."""

    elapsed_ms: float = 0.0
    cpu_ms: Mapping[str, float] = field(default_factory=dict)  # processor time by partition
    throttled_ms: Mapping[str, float] = field(default_factory=dict)  # how long its quota held a partition back
    stolen_ms: float = 0.0  # of all processors, by the machine below this one
    waiting_ms: float | None = None  # how long something waited for a processor (PSI); None: not counted
    # By partition, how long a ready virtual processor waits for a logical one; None: not counted.
    dispatch_wait_ns: Mapping[str, float] | None = field(default=None, metadata={"sparse": True})
    # By Hyper-V's names of counter set and counter, run times summed over processors; None: not counted.
    hypervisor_ms: Mapping[str, float] | None = field(default=None, metadata={"sparse": True})
    disturbances: tuple[str, ...] = ()  # of each try that was disturbed, this one included where it is the last

    def since(self, before: "SettingEvidence") -> "SettingEvidence":
        """Return what was counted since then.

        Args:
            before: the counters at some earlier moment.

        Returns:
            The differences.
        """
        waited = self.waiting_ms is not None and before.waiting_ms is not None
        return replace(
            self,
            elapsed_ms=self.elapsed_ms - before.elapsed_ms,
            cpu_ms={name: time - before.cpu_ms.get(name, 0.0) for name, time in self.cpu_ms.items()},
            throttled_ms={name: time - before.throttled_ms.get(name, 0.0) for name, time in self.throttled_ms.items()},
            stolen_ms=self.stolen_ms - before.stolen_ms,
            waiting_ms=(self.waiting_ms or 0.0) - (before.waiting_ms or 0.0) if waited else None,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """One reservation of the test partition P1 with what was measured there."""

    reserve: int  # CR: per cent of P1's own processors, 1..100
    series: tuple[Series, ...]  # by component name
    beside: int = 0  # what P2 reserved meanwhile: per cent of each of its processors
    seed: int = 0  # that chance was drawn from, where the host draws it
    evidence: SettingEvidence | None = None  # None: the host counts nothing

    def repeats(self, other: "Setting") -> bool:
        """Tell whether this is the same setting, measured once more: it counts instead of the other.

        Args:
            other: Measured before.

        Returns:
            Whether reservation and seed are the same.
        """
        return (self.reserve, self.seed) == (other.reserve, other.seed)


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """The machine that was measured on, as far as it can change what is measured there."""

    provider: ProviderKind
    processor: str  # its model, as it names itself
    logical_processors: int
    smt: bool
    scheduler: SchedulerType
    guest_image: str  # what the test partitions run; empty: nothing of their own
    os_build: int  # 0: there is none


@dataclass(frozen=True, slots=True, kw_only=True)
class EnvironmentSetup:
    """What P1 and P2 are while one data log is measured; only their reserves change from setting to setting."""

    members: tuple[str, ...]  # the components in P1, by name
    interference: str  # the load in P2, by its name in the manifest
    processors: int  # virtual ones, of P1; P2 has as many as the host has logical ones
    memory: int  # bytes, of P1
    limit: int  # of P1: per cent of each of its processors
    weight: int  # of P1


def run_of(component: Component) -> Run:
    """How a component is run; on a simulated host it needs no `run`, and what that would say has its usual value."""
    return _SIMULATED_ONLY if component.run is None else component.run


_SIMULATED_ONLY = Run(
    start=Command(words=()),
    files=(),
    environment={},
    folder=".",
    until=SampleCount(samples=200),
    timeout=Milliseconds(Fraction(60_000)),
    stop=Stop(),
    arrival=Closed(),
    samples=Samples(source="per_run"),
    deadline=None,
    failures=0,
)


T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampleColumns(Sequence[Sample]):
    """Samples in the order in which their jobs ended, equal to any sequence of equal samples.

    NOTE: a `Sample` is made only for who asks for one. What looks at a whole log takes the columns: a million samples
    as objects take seconds and 300 MB.
    """

    began_ms: "array[float]"
    response_ms: "array[float]"  # not a number: no answer
    successful: bytes  # 1 or 0
    counts: "array[float]"
    failures: Mapping[int, str]  # of failed samples alone, by their numbers, ascending
    known: dict[Hashable, object] = field(default_factory=dict, repr=False)  # what `remember` keeps

    def __len__(self) -> int:
        return len(self.began_ms)

    @overload
    def __getitem__(self, at: int) -> Sample: ...
    @overload
    def __getitem__(self, at: slice) -> "SampleColumns": ...
    def __getitem__(self, at: int | slice) -> "Sample | SampleColumns":
        numbers = range(len(self))[at]
        return self.take(numbers) if isinstance(numbers, range) else self._sample(numbers)

    def __iter__(self) -> Iterator[Sample]:
        return map(self._sample, range(len(self)))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence):
            return NotImplemented
        return self is other or (len(self) == len(other) and all(map(Sample.__eq__, self, other)))

    def __hash__(self) -> int:
        return hash(tuple(self))

    def take(self, numbers: Sequence[int], earlier_ms: float = 0.0) -> "SampleColumns":
        """Take some of the samples.

        Args:
            numbers: Which, from 0, in the order in which they are wanted.
            earlier_ms: By how much the clock is set back.
        """
        return SampleColumns(
            began_ms=array("d", [self.began_ms[at] - earlier_ms for at in numbers]),
            response_ms=array("d", map(self.response_ms.__getitem__, numbers)),
            successful=bytes(map(self.successful.__getitem__, numbers)),
            counts=array("d", map(self.counts.__getitem__, numbers)),
            failures={new: self.failures[at] for new, at in enumerate(numbers) if at in self.failures},
        )

    def remember(self, key: Hashable, work_out: Callable[[], T]) -> T:
        """Work something out of these samples once, however often it is asked for.

        Args:
            key: What is asked for, with all that the answer depends on beside the samples.
            work_out: Gives the answer; called at the first time.
        """
        if key not in self.known:
            self.known[key] = work_out()
        return cast("T", self.known[key])

    def _sample(self, at: int) -> Sample:
        time = self.response_ms[at]
        return Sample(
            began_ms=self.began_ms[at],
            response_ms=None if isnan(time) else time,
            successful=bool(self.successful[at]),
            count=self.counts[at],
            failure=self.failures.get(at, ""),
        )


def columns_of(samples: Iterable[Sample]) -> SampleColumns:
    """Return samples as columns; what is in columns already stays as it is.

    Args:
        samples: In the order in which their jobs ended.
    """
    if isinstance(samples, SampleColumns):
        return samples
    rows = list(samples)
    return SampleColumns(
        began_ms=array("d", map(attrgetter("began_ms"), rows)),
        response_ms=array("d", [nan if sample.response_ms is None else sample.response_ms for sample in rows]),
        successful=bytes(map(attrgetter("successful"), rows)),
        counts=array("d", map(attrgetter("count"), rows)),
        failures={at: sample.failure for at, sample in enumerate(rows) if sample.failure},
    )
