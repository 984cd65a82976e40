"""The System: what the manifest says, with units read, defaults filled in and names resolved.

Maps keep the manifest's order; they are not changed. Where a value may be left to the planner, that is a value of
its own (`MEASURED`, `None` said to mean "open"), never a guess.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from datetime import date
from enum import StrEnum
from fractions import Fraction
from typing import Annotated, Literal

from rarms_iac.model.host import MECHANISM, Connect, Host, Mechanism, SecureBoot
from rarms_iac.model.keys import (
    Filled,
    Form,
    Key,
    Name,
    OneOrSeveral,
    OwnName,
    PositiveAmount,
    PositiveMemory,
    PositiveTime,
    Processors,
    Quantity,
    Shape,
    Share,
    TaskName,
    Time,
    Within,
)
from rarms_iac.model.loads import DEFAULT_LOADS, Interference
from rarms_iac.model.output import Internal, output
from rarms_iac.model.quantities import Bytes, CpuAmount, Milliseconds, Percent, Unit
from rarms_iac.model.run import SIMULATED_ONLY, Run
from rarms_iac.model.wording import in_a_row


class Disruption(StrEnum):
    """What a change does to what runs; later members disturb more."""

    LIVE = "live"
    PARTITION_STOP = "partition_stop"
    HOST_RESTART = "host_restart"
    REMOVAL = "removal"

    def exceeds(self, limit: "Disruption") -> bool:
        """Return whether it disturbs more than the limit allows."""
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
    """Its name, and what it is for."""

    name: Annotated[Name, Key("The application's name; it is in the mark of everything that rarms makes.")]
    description: Annotated[str, Key("What it does, for people.")] = ""
    requires_rarms: Annotated[
        str | None, Form.LEAST_VERSION, Key("The least version of rarms that reads this manifest right: `>=0.2`.")
    ] = None
    robot: str = ""  # name of the last overlay's file without its ending; empty: there are no overlays


@dataclass(frozen=True, slots=True, kw_only=True)
class AtMost:
    """The index must not be larger: response times, jitter, miss rates."""

    value: Internal[Fraction]  # in the index's own unit
    unit: Internal[str] = field(default="", compare=False)  # that the user wrote; empty: the index's own

    @output
    def at_most(self) -> Fraction:
        """The bound."""
        return self.value


@dataclass(frozen=True, slots=True, kw_only=True)
class AtLeast:
    """The index must not be smaller: success rates, throughput."""

    value: Internal[Fraction]
    unit: Internal[str] = field(default="", compare=False)

    @output
    def at_least(self) -> Fraction:
        """The bound."""
        return self.value


Threshold = AtMost | AtLeast


@dataclass(frozen=True, slots=True, kw_only=True)
class CpuRequest:
    """What is fixed of the CPU; the rest is left to the planner."""

    reserve: Annotated[
        CpuAmount | Measured | None,
        Quantity(kinds=(Unit.SHARE, Unit.PROCESSORS)),
        Key(
            "What is guaranteed: `measured` (the least that meets the thresholds, from the data log), a share of the "
            "host `70 %`, or processors `1.4 LP`. Absent: measured for a component with thresholds (apt), else nothing."
        ),
    ] = None
    limit: Annotated[
        PositiveAmount | None,
        Key("The most that it may use: `60 %` or `1.2 LP`. Absent: the planner chooses."),
    ] = None
    weight: Annotated[
        int | None,
        Within(1, MOST_WEIGHT),
        Key("Its relative share of what is not reserved: 1 to 10000, usually 100."),
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulation:
    """What a job demands on a simulated host."""

    work: Annotated[PositiveTime, Key("Processor time of a job: `61.6 ms`.")]
    blocked: Annotated[Time, Key("Time a job waits without the processor: `26.4 ms`.")] = Milliseconds(Fraction(0))
    varies: Annotated[Share, Key("How much the work varies: its standard deviation over its mean, `5 %`.")] = Percent(
        Fraction(0)
    )
    threads: Annotated[int, Within(1, 4096), Key("How many threads share the work.")] = 1
    success_within: Annotated[
        PositiveTime | None, Key("A job succeeds if it answers within this time; absent: always.")
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Component:
    """A component."""

    name: OwnName
    criticality: Annotated[
        int, Within(0, 1_000_000), Key("How bad it is when it misses its thresholds; larger is worse.")
    ]
    apt: Annotated[
        Mapping[str, Threshold],
        Shape.THRESHOLDS,
        Key("Acceptable performance thresholds: what is good enough, by performance index. Absent: it has none."),
    ] = field(default_factory=dict)
    run: Annotated[Run | None, Key("How it is started and measured; absent: rarms does not run it.")] = None
    interference: Annotated[
        OneOrSeveral[Name], Key("The load, or loads, that its reservation is measured against; absent: the policy's.")
    ] = ()
    memory: Annotated[PositiveMemory, Key("The memory it needs: `512 MiB`.")] = Bytes(512 * 2**20)
    processors: Annotated[
        Processors | None,
        Key("Virtual processors of its partition; absent: as many as it was seen to use at once, else the host's."),
    ] = None
    task: Annotated[
        TaskName | None, Key("Its robotic task class (RC SS): what kind of work it does, never a priority.")
    ] = None
    cpu: Annotated[CpuRequest, Key("What is fixed of its CPU: reserve, limit, weight.")] = CpuRequest()
    together: Annotated[tuple[Name, ...], Key("Components that must share its partition.")] = ()
    apart: Annotated[tuple[Name, ...], Key("Components that must never share its partition.")] = ()
    dedicated: Annotated[bool, Key("Whether it is alone in its partition.")] = False
    hosts: Annotated[
        Filled[tuple[Name, ...]] | None,
        Key("Hosts it may run on; absent: any whose platform has its measurements, or all where its reserve is fixed."),
    ] = None
    runs_on: Annotated[
        RunsOn,
        Key("`partition`, or `host`: in the host's own operating system, with a task class but without a reserve."),
    ] = RunsOn.PARTITION
    simulation: Annotated[Simulation | None, Key("What a job demands on a simulated host.")] = None
    new: Annotated[bool, Key("In an overlay: the manifest has no component of this name.")] = False

    def may_run_on(self, host: str) -> bool:
        """Return whether the manifest allows it on the host of this name.

        Returns:
            True where it names no hosts, too.
        """
        return self.hosts is None or host in self.hosts


def run_of(component: Component) -> Run:
    """Return how a component is run; without a `run`, as on a simulated host, with the usual values."""
    run = SIMULATED_ONLY if component.run is None else component.run
    within = None if component.simulation is None else component.simulation.success_within
    return replace(run, success_within=within, rates_success="success_rate" in component.apt)


@dataclass(frozen=True, slots=True, kw_only=True)
class HypervPartition:
    """Settings of Hyper-V; absent: those of the host's `hyperv` block."""

    generation: Annotated[int | None, Within(1, 2), Key("1 or 2; it never changes after creation.")] = None
    switch: Annotated[Filled[str] | None, Key("The virtual switch it is connected to.")] = None
    image: Annotated[Filled[str] | None, Key("The disk image its disk is a child of.")] = None
    vm_path: Annotated[Filled[str] | None, Key("The folder on the host for its virtual machine.")] = None
    secure_boot: Annotated[
        SecureBoot | None, Key("Secure boot of generation 2: `off`, or the template of its guest.")
    ] = None
    clustered: Annotated[
        bool | None, Key("Whether its machine may be changed although it belongs to a failover cluster.")
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LinuxPartition:
    """Settings of Linux; absent: those of the host's `linux` block."""

    mechanism: Annotated[Mechanism | None, MECHANISM] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Guest:
    """How rarms reaches inside."""

    connect: Annotated[Connect | None, Key("How the guest is reached.")] = None
    credential: Annotated[
        Filled[str] | None, Key("The name under which a credential is stored; never the credential itself.")
    ] = None
    windows_build: Annotated[
        int | None,
        Within(2600, 99999),
        Key(
            "The build of its Windows, where the guest does not tell its host. From 10240 on memory changes while it "
            "runs."
        ),
    ] = None


GRACE = Milliseconds(Fraction(120_000))


@dataclass(frozen=True, slots=True, kw_only=True)
class PartitionStop:
    """How a partition is stopped, where a change needs it off: its guest is asked, forced, then it is turned off."""

    grace: Annotated[
        Milliseconds,
        Quantity(kinds=(Unit.TIME,), most="1 h"),
        Key(
            "How long its guest may take to shut down before it is turned off: `90 s`; at most 1 h. A guest on Hyper-V "
            "is forced to from half of it on, in the last five minutes at most."
        ),
    ] = GRACE


@dataclass(frozen=True, slots=True, kw_only=True)
class PartitionRequest:
    """What is fixed of a partition."""

    name: OwnName
    components: Annotated[
        Filled[tuple[Name, ...]], Key("The components in it; absent: the component of its name.")
    ] = ()
    processors: Annotated[
        Processors | None,
        Key("Its virtual processors; absent: those of its components together, at most the host's."),
    ] = None
    memory: Annotated[PositiveMemory | None, Key("Its memory; absent: the sum of its components'.")] = None
    cpu: Annotated[CpuRequest, Key("What is fixed of its CPU; absent: as its components say.")] = CpuRequest()
    protect: Annotated[bool, Key("Whether its removal is an error.")] = False
    start: Annotated[StartMode, Key("`automatic`: rarms starts it; `manual`: you start it.")] = StartMode.AUTOMATIC
    stop: Annotated[PartitionStop, Key("How it is stopped; absent: its guest has 120 s of grace.")] = PartitionStop()
    hyperv: Annotated[HypervPartition, Key("Settings of Hyper-V.")] = HypervPartition()
    linux: Annotated[LinuxPartition, Key("Settings of Linux.")] = LinuxPartition()
    guest: Annotated[Guest, Key("How rarms reaches inside.")] = Guest()
    new: Annotated[bool, Key("In an overlay: the manifest has no partition of this name.")] = False


Level = Annotated[int | None, Within(1, 8)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskRequest:
    """What is fixed of a robotic task class; the rest is left to the planner."""

    name: OwnName
    category: Annotated[
        TaskCategory | None,
        Key("The band of thread priorities: `High` (one priority for all), `Medium` or `Low`."),
    ] = None
    priority: Annotated[
        Level, Key("1 to 8, larger goes first; orders threads in category Medium only, where 8 counts as 7.")
    ] = None
    background_priority: Annotated[Level, Key("1 to 8, larger goes first; orders threads in category Low only.")] = None
    replace_shipped: Annotated[bool, Key("Needed to change a task class that comes with Windows.")] = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Acceptance:
    """A finding that is known and accepted."""

    code: OwnName
    at: Annotated[Filled[tuple[Filled[str], ...]], Key("Where: addresses as the finding names them.")]
    reason: Annotated[str, Key("Why it is accepted.")] = ""
    until: Annotated[date | None, Key("The last day (UTC) of the acceptance: `2027-01-31`; absent: no end.")] = None


class Unused(StrEnum):
    """What becomes of a stopped partition that the manifest no longer names and that holds what could be lost."""

    KEEP = "keep"
    REMOVE = "remove"  # where `max_disruption` allows removals, too


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuringLimits:
    """How long may be measured to make one thing clear, in the host's own time."""

    setting: Annotated[PositiveTime, Key("A setting, with all of its loads together, before and after a kill.")] = (
        Milliseconds(Fraction(600_000))
    )
    proof: Annotated[PositiveTime, Key("A proof (`rarms prove`), with all of its loads together.")] = Milliseconds(
        Fraction(1_200_000)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Policy:
    """What rarms may do and prefers."""

    interference: Annotated[
        OneOrSeveral[Name],
        Key(f"The load, or loads, that reservations are measured against; absent: {in_a_row(DEFAULT_LOADS)}."),
    ] = DEFAULT_LOADS
    minimise: Annotated[
        Minimise,
        Key("`combining`: rather reserve more than combine; `reservation`: rather combine than reserve more."),
    ] = Minimise.COMBINING
    headroom: Annotated[Headroom, Key("Who gets what is not reserved: `by_criticality`, `equal` or `none`.")] = (
        Headroom.BY_CRITICALITY
    )
    max_disruption: Annotated[
        Disruption,
        Key("The most that a change may disrupt: `live`, `partition_stop`, `host_restart` or `removal`."),
    ] = Disruption.HOST_RESTART
    measuring: Annotated[MeasuringLimits, Key("How long may be measured to make one thing clear.")] = MeasuringLimits()
    unused: Annotated[
        Unused,
        Key(
            "What becomes of a partition on Hyper-V that the manifest no longer names: `keep`, stopped, or `remove`, "
            "which needs `max_disruption: removal`. Elsewhere it is removed in any case: it holds nothing that could "
            "be lost."
        ),
    ] = Unused.KEEP
    signed_plans: Annotated[
        bool,
        Key(
            "Whether plans are applied only where a key is set (`RARMS_PLAN_KEY`, `RARMS_PLAN_KEY_FILE`) that they are "
            "signed with."
        ),
    ] = False
    accept: Annotated[
        Mapping[Annotated[str, Form.CODE], Acceptance], Key("Findings that are known and accepted, by their id.")
    ] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class System:
    """A manifest: the components of an application, what they must achieve, and the hosts they run on."""

    schema: Annotated[Literal["rarms/v1"], Key("The version of this format.")]
    application: Annotated[Application, Key("Its name, and what it is for.")]
    hosts: Annotated[Filled[Mapping[Name, Host]], Key("The machines that partitions are made on, by name.")]
    components: Annotated[
        Mapping[Name, Component],
        Key("The components of interest (CoIs), and those that are merely there, by name."),
    ]
    partitions: Annotated[
        Mapping[Name, PartitionRequest],
        Key("What is fixed of partitions; without an entry each component has one of its own name."),
    ] = field(default_factory=dict)
    interference: Annotated[
        Mapping[Name, Interference],
        Key(
            "Loads against which reservations are measured. `busy-loop`, `bursts-5` to `bursts-200` and "
            "`bursts-5-half` to `bursts-200-half` (by `every`: 5, 10, 20, 50, 100 or 200 ms) exist without an entry."
        ),
    ] = field(default_factory=dict)
    tasks: Annotated[Mapping[TaskName, TaskRequest], Key("What is fixed of robotic task classes, by name.")] = field(
        default_factory=dict
    )
    policy: Annotated[Policy, Key("What rarms may do and prefers.")] = Policy()
    moved: Annotated[
        Mapping[Name, Name],
        Key("Partitions with a new name: old name to new name, so that they are renamed and not replaced."),
    ] = field(default_factory=dict)

    def loads_of(self, members: Iterable[str]) -> tuple[str, ...]:
        """List the loads under which a reservation of these must hold: their own where they agree, else the policy's.

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
        """Return the section of the manifest that asks for a partition.

        That is its own entry, or the component that it is named after.
        """
        return "partitions" if partition in self.partitions else "components"


def bound_together(components: Mapping[str, Component]) -> dict[str, str]:
    """Find which components `together` binds, however many steps apart.

    Args:
        components: by name; what else `together` names is left out.

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
