"""The whole document."""

from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from rarms_iac.manifest.document.components import ComponentBlock, CpuBlock
from rarms_iac.manifest.document.fields import Block, KeysLike, Maybe, by_name, needed, one_or_several, optional
from rarms_iac.manifest.document.hosts import MECHANISM, ConnectBlock, HostBlock, MechanismName, SecureBoot
from rarms_iac.manifest.document.quantities import Duty, PositiveMemory, PositiveTime, Wait
from rarms_iac.manifest.document.text_forms import (
    CODE_PATTERN,
    Code,
    Day,
    Filled,
    LeastVersion,
    Name,
    Stressor,
    TaskName,
)
from rarms_iac.model.loads import DEFAULT_LOADS
from rarms_iac.model.system import Disruption, Headroom, Minimise, StartMode, TaskCategory, Unused
from rarms_iac.model.task_names import TASK_PATTERN
from rarms_iac.model.wording import in_a_row

Level = Annotated[int, Field(ge=1, le=8)]


class AcceptanceBlock(Block):
    """A finding that is known and accepted."""

    at: Annotated[list[Filled], Field(min_length=1)] = needed("Where: addresses as the finding names them.")
    reason: str = optional("Why it is accepted.", "")
    until: Maybe[Day] = optional("The last day (UTC) of the acceptance: `2027-01-31`; absent: no end.")


class MeasuringLimitsBlock(Block):
    """How long may be measured to make one thing clear, in the host's own time."""

    setting: PositiveTime = optional("A setting, beside all of its loads together, before and after a kill.", "10 min")
    proof: PositiveTime = optional("A proof (`rarms prove`), beside all of its loads together.", "20 min")


class PolicyBlock(Block):
    """What rarms may do and prefers."""

    interference: Maybe[one_or_several(Name)] = optional(  # type: ignore[valid-type]  # a type that a function makes
        f"The load, or loads, that reservations must stand up to; absent: {in_a_row(DEFAULT_LOADS)}."
    )
    minimise: Annotated[Minimise, Field(strict=False)] = optional(
        "`combining`: rather reserve more than combine; `reservation`: rather combine than reserve more.", "combining"
    )
    headroom: Annotated[Headroom, Field(strict=False)] = optional(
        "Who gets what is not reserved: `by_criticality`, `equal` or `none`.", "by_criticality"
    )
    max_disruption: Annotated[Disruption, Field(strict=False)] = optional(
        "The most that a change may disrupt: `live`, `partition_stop`, `host_restart` or `removal`.",
        "host_restart",
    )
    measuring: Maybe[MeasuringLimitsBlock] = optional("How long may be measured to make one thing clear.")
    unused: Annotated[Unused, Field(strict=False)] = optional(
        "What becomes of a partition on Hyper-V that the manifest no longer names: `keep`, stopped, or `remove`, which "
        "needs `max_disruption: removal`. Elsewhere it is removed in any case: it holds nothing that could be lost.",
        "keep",
    )
    signed_plans: bool = optional(
        "Whether plans are applied only where a key is set (`RARMS_PLAN_KEY`, `RARMS_PLAN_KEY_FILE`) that they are "
        "signed with.",
        False,
    )
    accept: Maybe[Annotated[dict[Code, AcceptanceBlock], KeysLike(CODE_PATTERN)]] = optional(
        "Findings that are known and accepted, by their id."
    )


class TaskBlock(Block):
    """What is fixed of a robotic task class; the rest is left to the planner."""

    category: Maybe[Annotated[TaskCategory, Field(strict=False)]] = optional(
        "The band of thread priorities: `High` (one priority for all), `Medium` or `Low`."
    )
    priority: Maybe[Level] = optional(
        "1 to 8, larger goes first; orders threads in category Medium only, where 8 counts as 7."
    )
    background_priority: Maybe[Level] = optional("1 to 8, larger goes first; orders threads in category Low only.")
    replace_shipped: bool = optional("Needed to change a task class that comes with Windows.", False)


Instances = Annotated[int, Field(ge=1, le=1000)]


class BusyLoopBlock(Block):
    """Threads that never wait (BLP)."""

    kind: Literal["busy_loop"] = needed("Threads that never wait.")
    threads: Maybe[Annotated[int, Field(ge=1, le=4096)]] = optional("How many; absent: one a logical processor.")


class BurstsBlock(Block):
    """Threads that sleep, wake at the same moment, and take in one piece what their partition saved meanwhile."""

    kind: Literal["bursts"] = needed("Threads that pause.")
    every: PositiveTime = needed("From burst to burst, on average, while nothing delays them: `50 ms`.")
    duty: Maybe[Duty] = optional("Which part of it each thread takes as processor time; absent: what P2 reserves.")
    threads: Maybe[Annotated[int, Field(ge=1, le=4096)]] = optional("How many; absent: one a logical processor.")


class BrowserBlock(Block):
    """Browsers that stream video: their interrupts run above every thread."""

    kind: Literal["browser"] = needed("Browsers that stream video.")
    instances: Instances = optional("How many at once.", 1)


class CommandLoadBlock(Block):
    """Any other program."""

    kind: Literal["command"] = needed("Any other program.")
    command: Annotated[list[str], Field(min_length=1)] = needed("The program and its arguments, word by word.")
    instances: Instances = optional("How many at once.", 1)


class StressBlock(Block):
    """Workers of stress-ng, which must be installed: `timer`, `hdd` (disk), `stream` (memory), `switch`, `sock`."""

    kind: Literal["stress"] = needed("Workers of stress-ng.")
    stressor: Stressor = needed(
        "What they do, by its name in `stress-ng --stressors`: `timer` (interrupts), `hdd` (disk), `stream` (memory "
        "bandwidth), `switch` (context switches), `sock` (soft interrupts of the network)."
    )
    workers: Maybe[Annotated[int, Field(ge=1, le=4096)]] = optional("How many; absent: one a logical processor.")


InterferenceBlock = Annotated[
    BusyLoopBlock | BurstsBlock | CommandLoadBlock | StressBlock | BrowserBlock, Field(discriminator="kind")
]


class HypervPartitionBlock(Block):
    """Settings of Hyper-V; absent: those of the host's `hyperv` block."""

    generation: Maybe[Annotated[int, Field(ge=1, le=2)]] = optional("1 or 2; it never changes after creation.")
    switch: Maybe[Filled] = optional("The virtual switch it is connected to.")
    image: Maybe[Filled] = optional("The disk image its disk is a child of.")
    vm_path: Maybe[Filled] = optional("The folder on the host for its virtual machine.")
    secure_boot: Maybe[SecureBoot] = optional("Secure boot of generation 2: `off`, or the template of its guest.")
    clustered: Maybe[bool] = optional("Whether its machine may be changed although it belongs to a failover cluster.")


class LinuxPartitionBlock(Block):
    """Settings of Linux; absent: those of the host's `linux` block."""

    mechanism: Maybe[MechanismName] = optional(MECHANISM)


class GuestBlock(Block):
    """How rarms reaches inside."""

    connect: Maybe[ConnectBlock] = optional("How the guest is reached.")
    credential: Maybe[Filled] = optional("The name under which a credential is stored; never the credential itself.")
    windows_build: Maybe[Annotated[int, Field(ge=2600, le=99999)]] = optional(
        "The build of its Windows, where the guest does not tell its host. From 10240 on memory changes while it runs."
    )


class PartitionStopBlock(Block):
    """How a partition is stopped, where a change needs it off: its guest is asked, forced, then it is turned off."""

    grace: Wait = optional(
        "How long its guest may take to shut down before it is turned off: `90 s`; at most 1 h. A guest on Hyper-V is "
        "forced to from half of it on, in the last five minutes at most.",
        "120 s",
    )


class PartitionBlock(Block):
    """What is fixed of a partition."""

    components: Maybe[Annotated[list[Name], Field(min_length=1)]] = optional(
        "The components in it; absent: the component of its name."
    )
    processors: Maybe[Annotated[int, Field(ge=1, le=2048)]] = optional(
        "Its virtual processors; absent: those of its components together, at most the host's."
    )
    memory: Maybe[PositiveMemory] = optional("Its memory; absent: the sum of its components'.")
    cpu: Maybe[CpuBlock] = optional("What is fixed of its CPU; absent: as its components say.")
    protect: bool = optional("Whether its removal is an error.", False)
    start: Annotated[StartMode, Field(strict=False)] = optional(
        "`automatic`: rarms starts it; `manual`: you start it.", "automatic"
    )
    stop: Maybe[PartitionStopBlock] = optional("How it is stopped; absent: its guest has 120 s of grace.")
    hyperv: Maybe[HypervPartitionBlock] = optional("Settings of Hyper-V.")
    linux: Maybe[LinuxPartitionBlock] = optional("Settings of Linux.")
    guest: Maybe[GuestBlock] = optional("How rarms reaches inside.")
    new: bool = optional("In an overlay: the manifest has no partition of this name.", False)


class ApplicationBlock(Block):
    """Its name, and what it is for."""

    name: Name = needed("The application's name; it is in the mark of everything that rarms makes.")
    description: str = optional("What it does, for people.", "")
    requires_rarms: Maybe[LeastVersion] = optional(
        "The least version of rarms that reads this manifest right: `>=0.2`."
    )


class ManifestDocument(Block):
    """A manifest: the components of an application, what they must achieve, and the hosts they run on."""

    model_config = ConfigDict(defer_build=False, title="rarms manifest")

    schema_name: Literal["rarms/v1"] = needed("The version of this format.", alias="schema")
    application: ApplicationBlock = needed("Its name, and what it is for.")
    hosts: Annotated[dict[Name, HostBlock], by_name, Field(min_length=1)] = needed(
        "The machines that partitions are made on, by name."
    )
    components: Annotated[dict[Name, ComponentBlock], by_name] = needed(
        "The components of interest (CoIs), and those that are merely there, by name."
    )
    partitions: Maybe[Annotated[dict[Name, PartitionBlock], by_name]] = optional(
        "What is fixed of partitions; without an entry each component has one of its own name."
    )
    interference: Maybe[Annotated[dict[Name, InterferenceBlock], by_name]] = optional(
        "Loads against which reservations are measured. `busy-loop`, `bursts-5` to `bursts-200` and `bursts-5-half` to "
        "`bursts-200-half` (by `every`: 5, 10, 20, 50, 100 or 200 ms) exist without an entry."
    )
    tasks: Maybe[Annotated[dict[TaskName, TaskBlock], KeysLike(TASK_PATTERN)]] = optional(
        "What is fixed of robotic task classes, by name."
    )
    policy: Maybe[PolicyBlock] = optional("What rarms may do and prefers.")
    moved: Maybe[Annotated[dict[Name, Name], by_name]] = optional(
        "Partitions with a new name: old name to new name, so that they are renamed and not replaced."
    )
