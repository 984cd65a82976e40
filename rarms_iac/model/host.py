"""Hosts of the System: their provider, what they have to give, and what a simulated host does."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from fractions import Fraction

from rarms_iac.model.quantities import Bytes, CpuAmount, Milliseconds, Percent, ShareOfHost
from rarms_iac.model.run import FromEnvironment

SCHEDULER_WINDOW_MS = 100
"""Over how many ms a scheduler gives a partition its share, on every provider (docs/scheduling-model.md)."""


class ProviderKind(StrEnum):
    """What enforces a reservation on a host."""

    SIMULATED = "simulated"
    HYPERV = "hyperv"
    LINUX = "linux"


@dataclass(frozen=True, slots=True, kw_only=True)
class KeepForHost:
    """What is never promised to a partition."""

    processor: CpuAmount = field(default_factory=lambda: ShareOfHost(Percent(Fraction(0))))
    memory: Bytes = Bytes(0)


class Receiver(StrEnum):
    """What takes the scripts that rarms sends to a Windows host."""

    SENT = "sent"  # a text of rarms, sent ahead of them: nothing has to be there
    INSTALLED = "installed"  # the module Rarms there, of this very version


@dataclass(frozen=True, slots=True, kw_only=True)
class Connect:
    """How a remote system is reached: the system's own ssh."""

    ssh: str  # user@host, or a name of the ssh configuration
    shell: str = "pwsh"  # pwsh or powershell
    receiver: Receiver = Receiver.SENT
    # Of ssh; what is None is as the user's own configuration says.
    port: int | None = None
    key: str | None = None  # path of a private key
    jump: str | None = None  # user@host
    control_path: str | None = None
    folder: str | None = None  # of the manifest with the components' files, on a Linux host


@dataclass(frozen=True, slots=True, kw_only=True)
class WinRmConnect:
    """How a remote Windows is reached: WinRM over HTTPS, whose certificate is checked."""

    winrm: str  # the host's name or address
    shell: str = "pwsh"  # pwsh or powershell
    receiver: Receiver = Receiver.SENT
    port: int | None = None  # of its HTTPS listener; None: 5986
    user: str | None = None  # None: the account of the Kerberos ticket
    password: FromEnvironment | None = None


class SchedulerType(StrEnum):
    """How the hypervisor schedules virtual processors (windows.md 2); under `root` reserves have no effect."""

    CLASSIC = "classic"
    CORE = "core"
    ROOT = "root"
    UNKNOWN = "unknown"
    NONE = "none"  # no hypervisor: Linux


class FaultEffect(StrEnum):
    """What a simulated host does wrong when asked to."""

    REFUSE = "refuse"
    FAIL_AFTER = "fail_after"
    LATE = "late"


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A fault that is asked of a simulated host."""

    operation: str  # the operation's kind: start_partition, set_cpu, ...
    at: str  # an address, or `*`
    effect: FaultEffect
    delay: Milliseconds = Milliseconds(Fraction(0))
    times: int | None = None  # how often it strikes; None: always


SERVER_2019 = 17763
"""The build from which servers have the core scheduler, and new machines SMT, unless said otherwise (windows.md 2)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedHost:
    """The machine that a simulated host pretends to be."""

    windows_build: int = 26100  # Windows Server 2025
    guest_windows_build: int = 26100
    client: bool = False  # a client Windows, not a server
    scheduler: SchedulerType | None = None  # None: the one that its Windows comes with, where that makes a difference
    smt: bool = False
    administrator: bool = True
    faults: Mapping[str, Fault] = field(default_factory=dict)

    @property
    def scheduler_type(self) -> SchedulerType:
        """The hypervisor's scheduler: the core one of servers since 2019 where logical processors share cores."""
        if self.scheduler is not None:
            return self.scheduler
        has_core = self.windows_build >= SERVER_2019 and not self.client
        return SchedulerType.CORE if self.smt and has_core else SchedulerType.CLASSIC


@dataclass(frozen=True, slots=True, kw_only=True)
class HypervHost:
    """What partitions of a Hyper-V host use unless they say otherwise."""

    switch: str | None = None
    image: str | None = None
    vm_path: str | None = None
    generation: int = 2
    secure_boot: str | None = None
    # Under which name the host keeps what guests are entered with.
    credential: str | None = None


class Mechanism(StrEnum):
    """How a Linux host keeps a reservation."""

    AUTOMATIC = "automatic"  # rarms chooses, and says why
    SHARE = "share"  # of the processors, counted against the shares of the others as soon as they are short
    QUOTA = "quota"  # also a limit: no more than is reserved, even where processors are idle
    DEADLINE = "deadline"  # SCHED_DEADLINE: so much in each period of the component's first thread, before all others


@dataclass(frozen=True, slots=True, kw_only=True)
class LinuxHost:
    """Where control groups are made, and how they keep what is reserved unless a partition says otherwise."""

    slice: str = "rarms"
    control_groups: str = "automatic"  # automatic, v1 or v2
    mechanism: Mechanism = Mechanism.AUTOMATIC


HostSettings = SimulatedHost | HypervHost | LinuxHost


@dataclass(frozen=True, slots=True, kw_only=True)
class Host:
    """A machine that partitions are made on."""

    name: str
    provider: ProviderKind
    logical_processors: int
    memory: Bytes
    keep_for_host: KeepForHost
    platform: str  # hosts of one platform share measurements
    connect: Connect | WinRmConnect | None
    settings: HostSettings
    system_responsiveness: int | None = None  # per cent that MMCSS leaves to everybody else; None: left as it is

    @property
    def processor_word(self) -> str:
        """What a processor of a partition is called there: a control group has no virtual ones."""
        return "processor" if self.provider is ProviderKind.LINUX else "virtual processor"


def host_identity(machine_id: str) -> str:
    """Return what tells a machine from every other, for marks, plans, journals and proofs: `HostFacts.id`.

    NOTE: the machine's own id stays on it: who has it can work out what other programs made of it. On a Windows that is
    not this machine, `observe.ps1` and the scripts work out the same.

    Args:
        machine_id: `/etc/machine-id`, or `MachineGuid` of a Windows, as text; blanks around it and case do not matter.

    Returns:
        The first 32 hex digits, in lower case, of the SHA-256 of `rarms host ` and the id in lower case, as UTF-8;
        empty where the id is.
    """
    text = machine_id.strip().lower()
    return hashlib.sha256(f"rarms host {text}".encode()).hexdigest()[:32] if text else ""
