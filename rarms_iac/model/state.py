"""The State of a host: what is there, or what is wanted to be there.

The same types serve for both. What moves by itself (load, uptime, assigned memory) is not in them; the memory
that is left is.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum

from rarms_iac.model.claims import ANY_THREAD, WHOLE, Claim, CoreSharing
from rarms_iac.model.host import ProviderKind, SchedulerType
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.quantities import LogicalProcessors, per_virtual_processor
from rarms_iac.model.setting import TEST_PARTITIONS


class Rights(StrEnum):
    """The caller's rights to change the host; without them an empty list of machines proves nothing (windows.md 5)."""

    PROVEN = "proven"
    MISSING = "missing"
    UNKNOWN = "unknown"


USUAL_DEADLINE_PERCENT = 95
"""The kernel's own: `sched_rt_runtime_us` 950000 of `sched_rt_period_us` 1000000."""


@dataclass(frozen=True, slots=True, kw_only=True, order=True)
class ProcessorKind:
    """Logical processors of a host that are alike; 0: the host does not say."""

    processors: int  # so many of them
    threads: int = 0  # of each of their cores
    capacity: int = 0  # Linux' `cpu_capacity`: 1024 is the fastest
    base_mhz: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class HostFacts:
    """The facts of a host that decisions use."""

    name: str  # as the manifest calls it
    id: str  # `model.host.host_identity`; of a simulated host one that is made with its state
    provider: ProviderKind
    computer_name: str  # as its own operating system calls it
    os_build: int  # Windows build, 0 where there is none
    client: bool  # a client Windows
    scheduler: SchedulerType
    smt: bool
    logical_processors: int
    memory: int  # bytes
    rights: Rights
    disk_folder: str = ""  # where new disks lie unless a partition says otherwise
    # Of each processor, what Linux admits for SCHED_DEADLINE: 0 where its control groups hold only some processors.
    deadline_percent: int | None = None  # None: `USUAL_DEADLINE_PERCENT`
    real_time_percent: int | None = None  # of each processor, for the real-time budgets of groups; None: there are none
    governor: str = ""  # what sets the processors' frequency, as of `MachineSpeed`
    processor_kinds: tuple[ProcessorKind, ...] = ()  # several; empty: the processors are alike, or it is not known


class RunState(StrEnum):
    """The state of a partition; the transitional states of Hyper-V are `busy`, the critical ones `critical`."""

    OFF = "off"
    RUNNING = "running"
    PAUSED = "paused"
    SAVED = "saved"
    BUSY = "busy"
    CRITICAL = "critical"


class StartAction(StrEnum):
    """The host's action on the partition when the host starts."""

    NOTHING = "nothing"
    START_IF_RUNNING = "start_if_running"
    START = "start"


class StopAction(StrEnum):
    """The host's action on the partition when the host stops."""

    TURN_OFF = "turn_off"
    SAVE = "save"
    SHUT_DOWN = "shut_down"


class Checkpoints(StrEnum):
    """The checkpoints that may be taken of a partition."""

    DISABLED = "disabled"
    PRODUCTION = "production"
    PRODUCTION_ONLY = "production_only"
    STANDARD = "standard"


NO_GENERATION = 0
"""The generation of what is not a virtual machine: a control group."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PartitionSettings:
    """All that rarms decides about a partition, in the provider's own units; a mark's `set` is its digest."""

    name: str
    generation: int
    processors: int  # virtual processors
    reserve: int  # whole per cent of each virtual processor (windows.md 1.1)
    limit: int  # the same, 100: no limit
    weight: int  # 1..10000
    memory: int  # bytes at start
    dynamic_memory: bool
    start_action: StartAction
    stop_action: StopAction
    checkpoints: Checkpoints
    running: bool
    secure_boot: str = ""  # its template, or `SECURE_BOOT_OFF`; empty: generation 1, unknown, or as the host makes it
    quota_period_us: int = 0  # on Linux, how often its limit is counted again; 0: nothing limits it
    threads: str = ""  # on Linux, priorities by the names of threads, as `rules_text` writes them


SECURE_BOOT_OFF = "off"


@dataclass(frozen=True, slots=True, kw_only=True)
class Starting:
    """A larger reservation while a partition starts, as `cpu: { starting: { reserve: 1 LP, for: 30 s } }` asks for."""

    reserve: LogicalProcessors
    time_ms: int


def settings_at_start(settings: PartitionSettings, starting: Starting | None) -> PartitionSettings | None:
    """Return the settings of a partition for the time of its start.

    A limit below the larger reservation is raised with it.

    Args:
        settings: The lasting ones.

    Returns:
        None where it starts with no more than it keeps.
    """
    if starting is None:
        return None
    reserve = min(WHOLE, per_virtual_processor(starting.reserve, settings.processors))
    if reserve <= settings.reserve:
        return None
    return replace(settings, reserve=reserve, limit=max(settings.limit, reserve))


class StoppedBy(StrEnum):
    """The cause of a stop of a partition that is wanted running; a value is the word in its mark."""

    NO_USER = ""
    USER = "stopped"  # `rarms stop`: it stays so until `rarms start`
    MEASUREMENT = "measuring"  # `rarms measure`, which starts it again; after a kill the next run does


ID_DIGITS = 8
"""How much of a machine's id its mark repeats."""

PROTECTED = "protected"
"""The word in the mark of a partition that the manifest protects."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """Whose a thing on a host is, and what rarms last wrote there: one line in its notes."""

    application: str
    name: str  # the partition's, as the manifest calls it
    machine: str  # first 8 characters of the machine's id
    set: str  # 12 hex digits: digest of the settings last written
    stopped_by: StoppedBy = StoppedBy.NO_USER
    robot: str = ""  # of `Application`; empty: it was written without overlays
    protected: bool = False  # the manifest said so of the partition at the last apply

    @property
    def written(self) -> str:
        """What stands behind `set=`: the digest, who stopped the partition, its robot and its protection."""
        robot = f"robot={self.robot}" if self.robot else ""
        words = (self.set, self.stopped_by.value, robot, PROTECTED if self.protected else "")
        return " ".join(word for word in words if word)


class Tie(StrEnum):
    """A system that decides over a machine apart from its host."""

    REPLICA = "replica"  # of a machine elsewhere, whose id and notes it has
    CLUSTER = "cluster"
    CPU_GROUP = "cpu_group"


@dataclass(frozen=True, slots=True, kw_only=True)
class Partition:
    """A machine of a host, managed or not. A wanted one has no id before it exists."""

    settings: PartitionSettings
    id: str = ""
    state: RunState = RunState.OFF
    mark: Mark | None = None  # only one that is valid: it names this id and stands on one machine
    other_notes: str = ""  # the lines of the notes that are the user's
    foreign_mark: str = ""  # why a line that looks like our mark does not count (a finding); empty: there is none
    checkpoints: int = 0  # how many were taken of it and are still there
    sharing: CoreSharing = ANY_THREAD
    guest_build: int = 0  # of the Windows that runs in it, as it claims; 0: not known, or no Windows
    cpu_group: str = ""  # id of its CPU group; empty: none
    can_be_asked: bool = True  # its guest, to shut down; where that is unknown, it is tried
    ties: tuple[Tie, ...] = ()  # in their order

    @property
    def claim(self) -> Claim:
        """The partition's claim while it runs, whether or not it runs now."""
        return self.sharing.claim(self.settings.processors, self.settings.reserve, self.settings.memory)

    @property
    def shown_name(self) -> str:
        """The name in its mark; without a mark, that of the machine."""
        return self.mark.name if self.mark else self.settings.name

    @property
    def is_test(self) -> bool:
        """Whether it is a P1 or P2, finished or still under its pending name, of any application."""
        if self.mark is not None:
            return self.mark.name in TEST_PARTITIONS
        return any(self.settings.name.startswith(f"{name}.") for name in TEST_PARTITIONS)

    @property
    def claims_resources(self) -> bool:
        """Whether it counts against the host: it runs, is on its way, is paused or starts by itself.

        A replica starts at a failover only.
        """
        return (
            self.settings.running
            or self.state in {RunState.RUNNING, RunState.PAUSED, RunState.BUSY, RunState.CRITICAL}
            or (self.settings.start_action is not StartAction.NOTHING and Tie.REPLICA not in self.ties)
        )


class ValueKind(StrEnum):
    """Types of registry values. rarms writes the first two; the others are what other programs may have written."""

    DWORD = "dword"
    SZ = "sz"
    QWORD = "qword"
    EXPAND_SZ = "expandstring"
    MULTI_SZ = "multistring"
    BINARY = "binary"
    OTHER = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class RegistryValue:
    """A value with its type: right data of a wrong type is not as wanted (windows.md 6.6)."""

    kind: ValueKind
    data: int | str

    @property
    def is_restorable(self) -> bool:
        """Whether scripts read it whole and can write it back: numbers without sign and plain text.

        Text with variables is read with their values put in, lists and bytes as one text. MMCSS knows neither
        (windows.md 6.1).
        """
        if self.kind is ValueKind.QWORD:
            return isinstance(self.data, int) and self.data >= 0
        return self.kind in {ValueKind.DWORD, ValueKind.SZ}


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskRecord:
    """The record that rarms keeps of a task class that it wrote, outside the multimedia keys."""

    application: str
    set: str  # digest of the values last written
    before: Mapping[str, RegistryValue] | None  # what was there; None: the class did not exist
    robot: str = ""  # of `Application`


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskClass:
    """An MMCSS task class in one operating system."""

    name: str
    inside: str = ""  # the partition in whose guest it lies; empty: the host's own operating system
    values: Mapping[str, RegistryValue] = field(default_factory=dict)
    record: TaskRecord | None = None
    machine: str = field(default="", compare=False)  # id of that partition, where it exists


class DiskKind(StrEnum):
    """The content of a virtual disk's file: the whole disk, its written part, or its difference from a parent."""

    FIXED = "fixed"
    DYNAMIC = "dynamic"
    DIFFERENCING = "differencing"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class Disk:
    """The file of a virtual disk; one that two machines have is there twice."""

    path: str
    kind: DiskKind
    parent: str = ""  # path of the disk that it grows out of
    machine: str = ""  # id of the machine that it is attached to; empty: to none


@dataclass(frozen=True, slots=True, kw_only=True)
class Responsiveness:
    """SystemResponsiveness of the host's own Windows (windows.md 6.1)."""

    value: RegistryValue | None = None  # None: it is not there
    record: TaskRecord | None = None  # `before` holds at most this one value

    @property
    def values(self) -> Mapping[str, RegistryValue]:
        """The value by its name, as those of a task class; nothing where it is not there."""
        return {} if self.value is None else {SYSTEM_RESPONSIVENESS: self.value}


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """One host: facts, machines by name, then id, task classes by place and name, serials by application."""

    facts: HostFacts
    partitions: tuple[Partition, ...] = ()
    tasks: tuple[TaskClass, ...] = ()
    serials: Mapping[str, int] = field(default_factory=dict)  # how many applies and undos there were
    responsiveness: Responsiveness | None = None  # wanted, None: as it is; observed, None: it could not be looked at
    switches: tuple[str, ...] | None = (
        None  # names of its virtual switches; None: not known, or there are no such things
    )
    disks: tuple[Disk, ...] = ()  # those that are attached to a machine, and what else is known, by path
    # Bytes of its largest NUMA node, where no machine may lie on two of them; None: any may, or it is not known.
    largest_node: int | None = None
    # Bytes that machines which start can still have, and those of the NUMA node with most left; None: not known, or no
    # machine takes memory when it starts.
    memory_left: int | None = None
    node_left: int | None = None
    attached: str = ""  # `the service nav2`, held by a measurement, also by a killed one; empty: none is

    def holds_nothing(self, machine: str) -> bool:
        """Tell whether a machine of this host can be removed and made again as it was.

        Returns:
            False for a machine of Hyper-V, and for one with a disk: what is on it would be lost.
        """
        has_disk = any(disk.machine == machine for disk in self.disks)
        return self.facts.provider is not ProviderKind.HYPERV and not has_disk

    def of(self, application: str) -> "State":
        """Return only what carries this application's mark; facts and serials stay."""
        return replace(
            self,
            partitions=tuple(p for p in self.partitions if p.mark and p.mark.application == application),
            tasks=tuple(t for t in self.tasks if t.record and t.record.application == application),
            responsiveness=self.responsiveness if _is_of(self.responsiveness, application) else None,
        )


def _is_of(responsiveness: Responsiveness | None, application: str) -> bool:
    return (
        responsiveness is not None
        and responsiveness.record is not None
        and responsiveness.record.application == application
    )
