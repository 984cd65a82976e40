"""The System: what the manifest says, with units read, defaults filled in and names resolved.

Maps keep the manifest's order; they are not changed. Where a value may be left to the planner, that is a value of
its own (`MEASURED`, `None` said to mean "open"), never a guess.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from datetime import date
from enum import StrEnum
from fractions import Fraction

from rarms_iac.model.host import Connect, Host, Mechanism
from rarms_iac.model.loads import DEFAULT_LOADS, Interference
from rarms_iac.model.output import Internal, output
from rarms_iac.model.quantities import Bytes, CpuAmount, Milliseconds, Percent
from rarms_iac.model.run import SIMULATED_ONLY, Run


class Disruption(StrEnum):
    """What a change does to what runs; later members disturb more."""

    LIVE = "live"
    PARTITION_STOP = "partition_stop"
    HOST_RESTART = "host_restart"
    REMOVAL = "removal"

    def exceeds(self, limit: "Disruption") -> bool:
        """Whether it disturbs more than the limit allows."""
        order = list(Disruption)
        return order.index(self) > order.index(limit)


class Measured(StrEnum):
    """The reservation comes from a data log."""

    MEASURED = "measured"


class RunsOn(StrEnum):
    """Where a component runs: in a partition, or in the host's own operating system."""

    PARTITION = "partition"
    HOST = "host"


class Minimise(StrEnum):
    """Which of two layouts is better: the one that combines less, or the one that reserves less."""

    COMBINING = "combining"
    RESERVATION = "reservation"


USUAL_WEIGHT = 100
"""The weight of a machine of which nothing is said, and with which components are measured."""

MOST_WEIGHT = 10_000


def weight_of_criticality(criticality: int) -> int:
    """Return the weight of a partition under `headroom: by_criticality`; no other partition moves it.

    Args:
        criticality: of its most critical member.

    Returns:
        100 times the criticality, within 100 to 10,000: those of 100 and above are alike.
    """
    return min(MOST_WEIGHT, max(USUAL_WEIGHT, USUAL_WEIGHT * criticality))


class Headroom(StrEnum):
    """Who gets what is left over."""

    BY_CRITICALITY = "by_criticality"
    EQUAL = "equal"
    NONE = "none"


class StartMode(StrEnum):
    """Whether a partition is wanted running."""

    AUTOMATIC = "automatic"
    MANUAL = "manual"


class TaskCategory(StrEnum):
    """The bands of thread priorities of MMCSS (windows.md 6.2)."""

    HIGH = "High"
    MEDIUM = "Medium"
    LOW = "Low"


@dataclass(frozen=True, slots=True, kw_only=True)
class Application:
    """What all of it is for; its name is in every mark on every host."""

    name: str
    description: str = ""
    requires_rarms: str | None = None  # `>=0.2`; None: any version
    robot: str = ""  # name of the last overlay's file without its ending; empty: there are no overlays


@dataclass(frozen=True, slots=True, kw_only=True)
class AtMost:
    """The index must not be larger: response times, jitter, miss rates."""

    value: Internal[Fraction]  # in the index's own unit

    @output
    def at_most(self) -> Fraction:
        """The bound."""
        return self.value


@dataclass(frozen=True, slots=True, kw_only=True)
class AtLeast:
    """The index must not be smaller: success rates, throughput."""

    value: Internal[Fraction]

    @output
    def at_least(self) -> Fraction:
        """The bound."""
        return self.value


Threshold = AtMost | AtLeast


@dataclass(frozen=True, slots=True, kw_only=True)
class CpuRequest:
    """What the manifest fixes of a component's or partition's CPU; None is left to the planner."""

    reserve: CpuAmount | Measured | None = None
    limit: CpuAmount | None = None
    weight: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulation:
    """What a component demands on a simulated host, a job."""

    work: Milliseconds  # processor time
    blocked: Milliseconds = Milliseconds(Fraction(0))
    varies: Percent = Percent(Fraction(0))  # coefficient of variation
    threads: int = 1
    success_within: Milliseconds | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Component:
    """A component of interest (CoI), or one that is merely there."""

    name: str
    criticality: int
    apt: Mapping[str, Threshold]  # by performance index
    run: Run | None
    memory: Bytes
    processors: int | None  # VPs; None: as many as the host has LPs
    cpu: CpuRequest
    together: tuple[str, ...]
    apart: tuple[str, ...]
    dedicated: bool
    task: str | None
    hosts: tuple[str, ...] | None
    runs_on: RunsOn
    interference: tuple[str, ...]  # loads; none: the policy's
    simulation: Simulation | None

    def may_run_on(self, host: str) -> bool:
        """Whether the manifest allows it on the host of this name.

        Args:
            host: a host of the manifest.

        Returns:
            True where it names no hosts, too.
        """
        return self.hosts is None or host in self.hosts


def run_of(component: Component) -> Run:
    """How a component is run; on a simulated host it needs no `run`, and what that would say has its usual value."""
    run = SIMULATED_ONLY if component.run is None else component.run
    within = None if component.simulation is None else component.simulation.success_within
    return replace(run, success_within=within, rates_success="success_rate" in component.apt)


@dataclass(frozen=True, slots=True, kw_only=True)
class HypervPartition:
    """What only Hyper-V needs to know; None: as the host's own `hyperv` block says."""

    generation: int | None = None
    switch: str | None = None
    image: str | None = None
    vm_path: str | None = None
    secure_boot: str | None = None
    clustered: bool | None = None  # it may be changed although a failover cluster has it too


@dataclass(frozen=True, slots=True, kw_only=True)
class Guest:
    """How rarms reaches inside a partition; a credential is only ever a reference."""

    connect: Connect | None = None
    credential: str | None = None
    windows_build: int | None = None  # of its Windows, where it does not tell its host


GRACE = Milliseconds(Fraction(120_000))


@dataclass(frozen=True, slots=True, kw_only=True)
class PartitionRequest:
    """What the manifest says of a partition; without an entry each component has one of its own name."""

    name: str
    components: tuple[str, ...]
    processors: int | None = None
    memory: Bytes | None = None  # None: the sum of its components'
    cpu: CpuRequest = field(default_factory=CpuRequest)
    protect: bool = False
    start: StartMode = StartMode.AUTOMATIC
    grace: Milliseconds = GRACE  # for its guest to shut down, before it is turned off
    hyperv: HypervPartition = field(default_factory=HypervPartition)
    guest: Guest = field(default_factory=Guest)
    mechanism: Mechanism | None = None  # on a Linux host; None: as the host's own `linux` block says


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskRequest:
    """What the manifest fixes of a robotic task class; None is left to the planner."""

    name: str
    category: TaskCategory | None = None
    priority: int | None = None
    background_priority: int | None = None
    replace_shipped: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Acceptance:
    """A finding that is known and borne, where, why, and until the end of which day (UTC)."""

    code: str
    at: tuple[str, ...]
    reason: str
    until: date | None


class Unused(StrEnum):
    """What becomes of a stopped partition that the manifest no longer names and that holds what could be lost."""

    KEEP = "keep"
    REMOVE = "remove"  # where `max_disruption` allows removals, too


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuringLimits:
    """How long may be measured to make one thing clear: its budget, in the host's own time."""

    setting: Milliseconds = Milliseconds(Fraction(600_000))  # beside all of its loads together
    proof: Milliseconds = Milliseconds(Fraction(1_200_000))  # likewise


@dataclass(frozen=True, slots=True, kw_only=True)
class Policy:
    """What rarms may do and prefers."""

    interference: tuple[str, ...] = DEFAULT_LOADS  # a reservation must stand up to each of them
    minimise: Minimise = Minimise.COMBINING
    headroom: Headroom = Headroom.BY_CRITICALITY
    max_disruption: Disruption = Disruption.HOST_RESTART
    measuring: MeasuringLimits = MeasuringLimits()
    unused: Unused = Unused.KEEP
    signed_plans: bool = False  # nothing is applied where no key is set that plans are signed with
    accept: Mapping[str, Acceptance] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class System:
    """Everything a manifest says."""

    application: Application
    hosts: Mapping[str, Host]
    components: Mapping[str, Component]
    partitions: Mapping[str, PartitionRequest]
    interference: Mapping[str, Interference]
    tasks: Mapping[str, TaskRequest]
    policy: Policy
    moved: Mapping[str, str]  # old partition name -> new

    def loads_of(self, members: Iterable[str]) -> tuple[str, ...]:
        """List the loads that a reservation of these must stand up to: their own where they agree, else the policy's.

        Args:
            members: names of components that run together.

        Returns:
            Names of `interference`, in the order in which they are measured; each once. Names that it does not have
                are left out: RARMS042 tells of them.
        """
        own = {self.components[name].interference for name in members}
        only = own.pop() if len(own) == 1 else ()
        loads = dict.fromkeys(only or self.policy.interference)
        return tuple(name for name in loads if name in self.interference)

    def section_of(self, partition: str) -> str:
        """The section of the manifest that asks for a partition: its own entry, or the component it is called after."""
        return "partitions" if partition in self.partitions else "components"


def bound_together(components: Mapping[str, Component]) -> dict[str, str]:
    """Find which components `together` binds, however many steps apart.

    Args:
        components: by name; what `together` names beside them is left out.

    Returns:
        For each component the name of one of those that it is bound to, the same for all of them; its own where there
            is none.
    """
    first = {name: name for name in components}

    def find(name: str) -> str:
        while first[name] != name:
            first[name] = first[first[name]]
            name = first[name]
        return name

    for component in components.values():
        for other in component.together:
            if other in first:
                lower, higher = sorted((find(component.name), find(other)))
                first[higher] = lower
    return {name: find(name) for name in components}
