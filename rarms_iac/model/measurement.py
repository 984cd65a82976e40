"""What measuring yields: samples of jobs, a series a component, a setting a reservation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

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
    samples: Sequence[Sample]  # `sample_columns.SampleColumns`, wherever there may be many
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
