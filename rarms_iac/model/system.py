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
    ThreadPattern,
    Time,
    Within,
)
from rarms_iac.model.loads import DEFAULT_LOADS, Interference
from rarms_iac.model.output import Internal, output
from rarms_iac.model.quantities import Bytes, CpuAmount, Milliseconds, Percent, Unit
from rarms_iac.model.run import SIMULATED_ONLY, Run


class Disruption(StrEnum):
    """The disruption of a change; later members disturb more."""

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
    """The system that a component runs in: a partition, or the host's own operating system."""

    PARTITION = "partition"
    HOST = "host"


class Minimise(StrEnum):
    """The rule for the better of two layouts: the one that combines less, or the one that reserves less."""

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
    """The receiver of the capacity that is left over."""

    BY_CRITICALITY = "by_criticality"
    EQUAL = "equal"
    NONE = "none"


class StartMode(StrEnum):
    """The rule for whether a partition is wanted running."""

    AUTOMATIC = "automatic"
    MANUAL = "manual"


class TaskCategory(StrEnum):
    """The bands of thread priorities of MMCSS (windows.md 6.2)."""

    HIGH = "High"
    MEDIUM = "Medium"
    LOW = "Low"


@dataclass(frozen=True, slots=True, kw_only=True)
class Application:
    """The name and the purpose of the application."""

    name: Annotated[Name, Key("The name of the application; all marks contain it.")]
    description: Annotated[str, Key("A description for readers.")] = ""
    requires_rarms: Annotated[
        str | None, Form.LEAST_VERSION, Key("The smallest version of rarms for this manifest: `>=0.2`.")
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
class StartRequest:
    """A larger reservation during a start."""

    reserve: Annotated[PositiveAmount, Key("The reservation during the start: `1 LP`, or a share of the host `50 %`.")]
    time: Annotated[
        Milliseconds,
        Quantity(kinds=(Unit.TIME,), positive=True, most="5 min"),
        Key("The duration of the larger reservation: `30 s`; at most 5 min.", "for"),
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class CpuRequest:
    """Fixed CPU settings; the planner chooses the rest."""

    reserve: Annotated[
        CpuAmount | Measured | None,
        Quantity(kinds=(Unit.SHARE, Unit.PROCESSORS)),
        Key(
            "The reservation: `measured` (the smallest that meets the thresholds), a share of the host `70 "
            "%`, or processors `1.4 LP`. Absent: measured for a component with thresholds (apt), otherwise "
            "none."
        ),
    ] = None
    limit: Annotated[
        PositiveAmount | None,
        Key("The limit: `60 %` or `1.2 LP`. Absent: the planner chooses."),
    ] = None
    weight: Annotated[
        int | None,
        Within(1, MOST_WEIGHT),
        Key(
            "Its relative share of the unreserved processor time, 1 to 10000. Absent: according to "
            "`policy.headroom`. With the default `by_criticality`, the weight is 100 times the "
            "criticality, at most 10000."
        ),
    ] = None
    starting: Annotated[
        StartRequest | None,
        Key("The reservation during its start, if the host has enough free capacity; absent: the normal reservation."),
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulation:
    """Demand of a job on a simulated host."""

    work: Annotated[PositiveTime, Key("Processor time of a job: `61.6 ms`.")]
    blocked: Annotated[Time, Key("Waiting time of a job without a processor: `26.4 ms`.")] = Milliseconds(Fraction(0))
    varies: Annotated[Share, Key("The variation of the work, its standard deviation over its mean: `5 %`.")] = Percent(
        Fraction(0)
    )
    threads: Annotated[int, Within(1, 4096), Key("The number of threads that share the work.")] = 1
    success_within: Annotated[
        PositiveTime | None, Key("The maximum response time of a successful job; absent: every job is successful.")
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ThreadsTask:
    """The task class of some threads of a component, by their names, without a change of the program (Linux)."""

    task_class: Annotated[TaskName, Key("The name of the task class.", "class")]
    threads: Annotated[
        Filled[tuple[ThreadPattern, ...]],
        Key(
            "Names of the threads with the priority of the class: `controller*`. The kernel keeps 15 "
            "characters. A thread without its own name has the name of its program."
        ),
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class Component:
    """A component."""

    name: OwnName
    criticality: Annotated[int, Within(0, 1_000_000), Key("The importance of its thresholds; larger is more critical.")]
    apt: Annotated[
        Mapping[str, Threshold],
        Shape.THRESHOLDS,
        Key("Acceptable performance thresholds, by performance index. Absent: none."),
    ] = field(default_factory=dict)
    run: Annotated[
        Run | None, Key("The start and the measurement of the component; absent: rarms does not run the component.")
    ] = None
    interference: Annotated[
        OneOrSeveral[Name], Key("The loads for the measurement of its reservation; absent: the loads of the policy.")
    ] = ()
    memory: Annotated[PositiveMemory, Key("The memory of the component: `512 MiB`.")] = Bytes(512 * 2**20)
    processors: Annotated[
        Processors | None,
        Key(
            "Virtual processors of its partition; absent: the number that it used at once in the "
            "measurement, otherwise the number of the host."
        ),
    ] = None
    task: Annotated[
        TaskName | ThreadsTask | None,
        Key(
            "The robotic task class of its work (RC SS). On Linux, `{class: NAME, threads: "
            "[...]}` applies the class to threads by name."
        ),
    ] = None
    cpu: Annotated[CpuRequest, Key("Fixed CPU settings: reserve, limit, weight.")] = CpuRequest()
    together: Annotated[tuple[Name, ...], Key("Components that must share its partition.")] = ()
    apart: Annotated[tuple[Name, ...], Key("Components that must never share its partition.")] = ()
    dedicated: Annotated[bool, Key("Whether the component must be alone in its partition.")] = False
    hosts: Annotated[
        Filled[tuple[Name, ...]] | None,
        Key("The permitted hosts; absent: all hosts for which it is measured, or all hosts if its reserve is fixed."),
    ] = None
    runs_on: Annotated[
        RunsOn,
        Key("`partition`, or `host` for the host's own operating system, without a reserve."),
    ] = RunsOn.PARTITION
    simulation: Annotated[Simulation | None, Key("The demand of a job on a simulated host.")] = None
    new: Annotated[bool, Key("In an overlay: the component is new, not in the manifest.")] = False

    @property
    def task_class(self) -> str | None:
        """The name of its task class."""
        return self.task.task_class if isinstance(self.task, ThreadsTask) else self.task

    @property
    def threads(self) -> tuple[str, ...]:
        """The names of the threads that are to have its task class; empty: its threads join it, or all have it."""
        return self.task.threads if isinstance(self.task, ThreadsTask) else ()

    def may_run_on(self, host: str) -> bool:
        """Return whether the manifest allows it on the host of this name.

        Returns:
            True where it names no hosts, too.
        """
        return self.hosts is None or host in self.hosts


def run_of(component: Component) -> Run:
    """Return the `run` of a component; without one, as on a simulated host, the usual values."""
    run = SIMULATED_ONLY if component.run is None else component.run
    within = None if component.simulation is None else component.simulation.success_within
    return replace(run, success_within=within, rates_success="success_rate" in component.apt)


@dataclass(frozen=True, slots=True, kw_only=True)
class HypervPartition:
    """Settings of Hyper-V; absent: those of the host's `hyperv` block."""

    generation: Annotated[int | None, Within(1, 2), Key("The generation, 1 or 2. You cannot change it afterwards.")] = (
        None
    )
    switch: Annotated[Filled[str] | None, Key("Its virtual switch.")] = None
    image: Annotated[Filled[str] | None, Key("The parent image of its disk.")] = None
    vm_path: Annotated[Filled[str] | None, Key("The folder on the host for its virtual machine.")] = None
    secure_boot: Annotated[
        SecureBoot | None, Key("Secure boot of generation 2: `off`, or the template of its guest.")
    ] = None
    clustered: Annotated[bool | None, Key("Whether rarms may change its machine in a failover cluster.")] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LinuxPartition:
    """Settings of Linux; absent: those of the host's `linux` block."""

    mechanism: Annotated[Mechanism | None, MECHANISM] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Guest:
    """Access to the guest of a partition."""

    connect: Annotated[Connect | None, Key("The connection to the guest.")] = None
    credential: Annotated[Filled[str] | None, Key("The name of a stored credential; never the credential itself.")] = (
        None
    )
    windows_build: Annotated[
        int | None,
        Within(2600, 99999),
        Key(
            "The build of its Windows, if the guest does not report the build. From build 10240, the memory of a "
            "running guest can change."
        ),
    ] = None


GRACE = Milliseconds(Fraction(120_000))


@dataclass(frozen=True, slots=True, kw_only=True)
class PartitionStop:
    """Shutdown of a partition for a change that needs the partition off: a request, a forced shutdown, a power-off."""

    grace: Annotated[
        Milliseconds,
        Quantity(kinds=(Unit.TIME,), most="1 h"),
        Key(
            "The time for the guest to shut down before its machine is turned off: `90 s`; at most 1 h. On "
            "Hyper-V, the second half is a forced shutdown, at most five minutes."
        ),
    ] = GRACE


@dataclass(frozen=True, slots=True, kw_only=True)
class PartitionRequest:
    """Fixed settings of a partition; the planner chooses the rest."""

    name: OwnName
    components: Annotated[
        Filled[tuple[Name, ...]], Key("Its components; absent: the component with the same name.")
    ] = ()
    processors: Annotated[
        Processors | None,
        Key("Its virtual processors; absent: the sum of its components', at most those of the host."),
    ] = None
    memory: Annotated[PositiveMemory | None, Key("Its memory; absent: the sum of its components'.")] = None
    cpu: Annotated[CpuRequest, Key("Fixed CPU settings; absent: from its components.")] = CpuRequest()
    protect: Annotated[
        bool,
        Key(
            "Whether its removal by a plan is an error. `rarms undo` of the apply that created the "
            "partition still removes it."
        ),
    ] = False
    start: Annotated[StartMode, Key("`automatic`: rarms starts it; `manual`: you start it.")] = StartMode.AUTOMATIC
    stop: Annotated[PartitionStop, Key("The time for its shutdown; absent: its guest has 120 s to shut down.")] = (
        PartitionStop()
    )
    hyperv: Annotated[HypervPartition, Key("Settings of Hyper-V.")] = HypervPartition()
    linux: Annotated[LinuxPartition, Key("Settings of Linux.")] = LinuxPartition()
    guest: Annotated[Guest, Key("The guest in the partition.")] = Guest()
    new: Annotated[bool, Key("In an overlay: the partition is new, not in the manifest.")] = False


Level = Annotated[int | None, Within(1, 8)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskRequest:
    """Fixed settings of a robotic task class; the planner chooses the rest."""

    name: OwnName
    category: Annotated[
        TaskCategory | None,
        Key("The band of thread priorities: `High` (one priority for all), `Medium` or `Low`."),
    ] = None
    priority: Annotated[
        Level, Key("The priority in category Medium, 1 to 8; larger runs first, and 8 counts as 7.")
    ] = None
    background_priority: Annotated[Level, Key("The priority in category Low, 1 to 8; larger runs first.")] = None
    replace_shipped: Annotated[bool, Key("Whether rarms may change a task class that comes with Windows.")] = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Acceptance:
    """An accepted finding."""

    code: OwnName
    at: Annotated[Filled[tuple[Filled[str], ...]], Key("The addresses in the finding.")]
    reason: Annotated[str, Key("The reason.")] = ""
    until: Annotated[
        date | None, Form.DAY, Key("The last day (UTC) of the acceptance: `2027-01-31`; absent: no end.")
    ] = None


class Unused(StrEnum):
    """The treatment of a stopped partition that the manifest no longer names and that holds data."""

    KEEP = "keep"
    REMOVE = "remove"  # where `max_disruption` allows removals, too


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuringLimits:
    """Time limits of measurements, in the host's own time."""

    setting: Annotated[PositiveTime, Key("The longest time for one setting with all of its loads.")] = Milliseconds(
        Fraction(600_000)
    )
    proof: Annotated[
        PositiveTime | None,
        Key(
            "The longest time for a proof (`rarms prove`) with all of its loads. Absent: `setting` for each "
            "load, at least 20 min."
        ),
    ] = None
    slow_job: Annotated[
        int,
        Within(1, 1000),
        Key(
            "The longest assumed unseen job, as a multiple of the mean. If a threshold would be "
            "missed with such jobs, it is met on a condition, with the mark `*`. 1 means no "
            "conditions."
        ),
    ] = 20
    precision: Annotated[
        Percent,
        Quantity(kinds=(Unit.SHARE,), most="50 %"),
        Key(
            "The accuracy of a search: the largest difference between the result and the smallest "
            "sufficient reservation. One per cent of the partition's processors is always allowed."
        ),
    ] = Percent(Fraction(3))


@dataclass(frozen=True, slots=True, kw_only=True)
class Policy:
    """Permissions and preferences of rarms."""

    interference: Annotated[
        OneOrSeveral[Name],
        Key(f"The loads for the measurement of reservations; absent: {', '.join(DEFAULT_LOADS)}."),
    ] = DEFAULT_LOADS
    minimise: Annotated[
        Minimise,
        Key(
            "The objective of tuning: `combining` for the fewest combined components, or `reservation` for the least "
            "reserved processor time."
        ),
    ] = Minimise.COMBINING
    headroom: Annotated[Headroom, Key("The use of unreserved processor time: `by_criticality`, `equal` or `none`.")] = (
        Headroom.BY_CRITICALITY
    )
    max_disruption: Annotated[
        Disruption,
        Key("The largest disruption that a change may cause: `live`, `partition_stop`, `host_restart` or `removal`."),
    ] = Disruption.HOST_RESTART
    measuring: Annotated[MeasuringLimits, Key("The limits of measurements.")] = MeasuringLimits()
    unused: Annotated[
        Unused,
        Key(
            "Partitions on Hyper-V that are no longer in the manifest: `keep` them stopped, or `remove` them, "
            "which needs `max_disruption: removal`. On other hosts, rarms always removes them, "
            "because they contain no data."
        ),
    ] = Unused.KEEP
    signed_plans: Annotated[
        bool,
        Key("Whether plans must be signed with the key in `RARMS_PLAN_KEY` or `RARMS_PLAN_KEY_FILE`."),
    ] = False
    accept: Annotated[Mapping[Annotated[str, Form.CODE], Acceptance], Key("Accepted findings, by id.")] = field(
        default_factory=dict
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class System:
    """A manifest: the components of an application, their thresholds, and their hosts."""

    schema: Annotated[Literal["rarms/v1"], Key("The version of this format.")]
    application: Annotated[Application, Key("The name and description of the application.")]
    hosts: Annotated[Filled[Mapping[Name, Host]], Key("The hosts of the partitions, by name.")]
    components: Annotated[
        Mapping[Name, Component],
        Key("The components of interest (CoIs) and other components, by name."),
    ]
    partitions: Annotated[
        Mapping[Name, PartitionRequest],
        Key("Fixed settings of partitions, by name; a component without an entry has its own partition with its name."),
    ] = field(default_factory=dict)
    interference: Annotated[
        Mapping[Name, Interference],
        Key(
            "The loads for the measurement of reservations, by name. `busy-loop`, `bursts-5` to "
            "`bursts-200` and `bursts-5-half` to `bursts-200-half` (by `every`: 5, 10, 20, 50, 100 or 200 "
            "ms) exist without an entry."
        ),
    ] = field(default_factory=dict)
    tasks: Annotated[Mapping[TaskName, TaskRequest], Key("Fixed settings of robotic task classes, by name.")] = field(
        default_factory=dict
    )
    policy: Annotated[Policy, Key("Permissions and preferences of rarms.")] = Policy()
    moved: Annotated[
        Mapping[Name, Name],
        Key("Renamed partitions, old name to new name. rarms then does not replace them."),
    ] = field(default_factory=dict)

    def loads_of(self, members: Iterable[str]) -> tuple[str, ...]:
        """List the loads under which a reservation of these must hold: their own where they agree, else the policy's.

        Args:
            members: names of components that run together.

        Returns:
            Names of `interference`, in the order in which they are measured; each once. Names that it does not have
                are left out: RARMS042 reports them.
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
