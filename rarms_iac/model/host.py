"""Hosts of the System: their provider, what they have to give, and what a simulated host does."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from fractions import Fraction
from typing import Annotated, Literal

from rarms_iac.model.keys import (
    Filled,
    Form,
    Key,
    Memory,
    Name,
    OwnName,
    PositiveMemory,
    Processors,
    Quantity,
    Time,
    Within,
)
from rarms_iac.model.quantities import Bytes, CpuAmount, Milliseconds, Percent, ShareOfHost, Unit
from rarms_iac.model.run import FromEnvironment

SCHEDULER_WINDOW_MS = 100
"""Over how many ms a scheduler gives a partition its share, on every provider (docs/scheduling-model.md)."""


class ProviderKind(StrEnum):
    """The kind of system that enforces a reservation on a host."""

    SIMULATED = "simulated"
    HYPERV = "hyperv"
    LINUX = "linux"


@dataclass(frozen=True, slots=True, kw_only=True)
class KeepForHost:
    """Capacity that is kept for the host."""

    processor: Annotated[
        CpuAmount,
        Quantity(kinds=(Unit.SHARE, Unit.PROCESSORS), most="100 %"),
        Key("Processor time for the host's own operating system: `10 %` or `0.5 LP`, at most 100 %."),
    ] = ShareOfHost(Percent(Fraction(0)))
    memory: Annotated[Memory, Key("Memory for the host's own operating system: `1 GiB`.")] = Bytes(0)


class Receiver(StrEnum):
    """The program that takes the scripts that rarms sends to a Windows host."""

    SENT = "sent"  # a text of rarms, sent ahead of them: nothing has to be there
    INSTALLED = "installed"  # the module Rarms there, of this very version


Shell = Literal["pwsh", "powershell"]
_SHELL = Key("The shell at the other end: `pwsh` (PowerShell 7) or `powershell` (Windows PowerShell 5.1).")
_RECEIVER = Key(
    "The receiver of scripts on the host: `sent` (rarms sends it before the scripts) or `installed` "
    "(the module Rarms of this version, for hosts that run only signed scripts)."
)
Port = Annotated[int, Within(1, 65535)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Connect:
    """Connection to a remote system by ssh."""

    ssh: Annotated[str, Form.SSH, Key("The ssh address: `user@host`, or a name in your ssh configuration.")]
    shell: Annotated[Shell, _SHELL] = "pwsh"
    receiver: Annotated[Receiver, _RECEIVER] = Receiver.SENT
    port: Annotated[Port | None, Key("The ssh port; absent: from your ssh configuration.")] = None
    key: Annotated[
        str | None,
        Form.SSH_FILE,
        Key("The file with the private key; absent: from your ssh configuration."),
    ] = None
    jump: Annotated[str | None, Form.SSH, Key("The jump host, `user@host`; absent: none.")] = None
    control_path: Annotated[
        str | None,
        Form.SSH_FILE,
        Key(
            "The socket for shared connections with a single login (`ControlPath` of ssh). Absent: "
            "from your ssh configuration."
        ),
    ] = None
    folder: Annotated[
        str | None,
        Form.ABSOLUTE_FOLDER,
        Key(
            "The folder on a Linux host with the manifest's files and the components' files: `/opt/robot`. "
            "Measuring, proving and `rarms run` need it."
        ),
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class WinRmConnect:
    """Connection to a remote Windows by WinRM over HTTPS. rarms checks the certificate."""

    winrm: Annotated[str, Form.HOST, Key("The name or address of the host in its certificate.")]
    shell: Annotated[Shell, _SHELL] = "pwsh"
    receiver: Annotated[Receiver, _RECEIVER] = Receiver.SENT
    port: Annotated[Port | None, Key("The port of its HTTPS listener; absent: 5986.")] = None
    user: Annotated[
        Filled[str] | None,
        Key("The account, such as `CELL\\rarms`; absent, with `password`: the account of the Kerberos ticket."),
    ] = None
    password: Annotated[
        FromEnvironment | None,
        Key("The environment variable of rarms with the password; absent: the Kerberos ticket."),
    ] = None


class SchedulerType(StrEnum):
    """The hypervisor's scheduler of virtual processors (windows.md 2); under `root` reserves have no effect."""

    CLASSIC = "classic"
    CORE = "core"
    ROOT = "root"
    UNKNOWN = "unknown"
    NONE = "none"  # no hypervisor: Linux


class FaultEffect(StrEnum):
    """The fault of a simulated host, where the manifest asks for one."""

    REFUSE = "refuse"
    FAIL_AFTER = "fail_after"
    LATE = "late"


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A fault of a simulated host, for tests."""

    operation: Annotated[
        str, Form.OPERATION, Key("The kind of operation that fails: `start_partition`, `set_cpu`, ...")
    ]
    at: Annotated[Filled[str], Key("The address of the fault, or `*` for any.")] = "*"
    effect: Annotated[
        FaultEffect,
        Key(
            "`refuse`: refuses the operation; `fail_after`: does the operation, then fails; `late`: "
            "answers after `delay`."
        ),
    ]
    delay: Annotated[Time, Key("The delay of the answer: `2 s`.")] = Milliseconds(Fraction(0))
    times: Annotated[int | None, Within(1, 1_000_000), Key("The number of faults; absent: no limit.")] = None


SERVER_2019 = 17763
"""The build from which servers have the core scheduler, and new machines SMT, unless said otherwise (windows.md 2)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedHost:
    """The simulated machine."""

    windows_build: Annotated[
        int, Within(6000, 99999), Key("The build of the host's Windows; 26100 is Server 2025.")
    ] = 26100
    guest_windows_build: Annotated[int, Within(2600, 99999), Key("The build of the guests' Windows.")] = 26100
    client: Annotated[bool, Key("Whether the host runs a client Windows instead of a server.")] = False
    scheduler: Annotated[
        SchedulerType | None,
        Key(
            "The hypervisor's scheduler; under `root` reserves have no effect; absent: `core` with `smt` on a server "
            "since 2019, otherwise `classic`."
        ),
    ] = None
    smt: Annotated[
        bool,
        Key(
            "Whether two logical processors share a core. The setting changes the number of "
            "processors that partitions reserve, but not measurements."
        ),
    ] = False
    administrator: Annotated[bool, Key("Whether rarms has the necessary rights on the host.")] = True
    faults: Annotated[Mapping[Name, Fault], Key("Faults of the simulated host, by name.")] = field(default_factory=dict)

    @property
    def scheduler_type(self) -> SchedulerType:
        """The hypervisor's scheduler: the core one of servers since 2019 where logical processors share cores."""
        if self.scheduler is not None:
            return self.scheduler
        has_core = self.windows_build >= SERVER_2019 and not self.client
        return SchedulerType.CORE if self.smt and has_core else SchedulerType.CLASSIC


SecureBoot = Literal["off", "MicrosoftWindows", "MicrosoftUEFICertificateAuthority"]


@dataclass(frozen=True, slots=True, kw_only=True)
class HypervHost:
    """Defaults for the partitions of a Hyper-V host."""

    generation: Annotated[
        int,
        Within(1, 2),
        Key("The generation of new machines, 1 or 2. You cannot change the generation of an existing machine."),
    ] = 2
    switch: Annotated[Filled[str] | None, Key("The virtual switch of the partitions; absent: none.")] = None
    image: Annotated[Filled[str] | None, Key("The parent image of the partitions' disks; absent: no disk.")] = None
    vm_path: Annotated[
        Filled[str] | None, Key("The folder on the host for virtual machines; absent: the default of the host.")
    ] = None
    secure_boot: Annotated[
        SecureBoot | None,
        Key(
            "Secure boot of generation 2: `off`, or the template `MicrosoftWindows` or, for Linux, "
            "`MicrosoftUEFICertificateAuthority`. Absent: a new machine gets `MicrosoftWindows`, the "
            "default of Hyper-V; an existing machine is not changed."
        ),
    ] = None
    credential: Annotated[
        Filled[str] | None,
        Key("The name of the stored credential for guests, never the secret itself. Measurements in guests need it."),
    ] = None


class Mechanism(StrEnum):
    """The mechanism by which a Linux host keeps a reservation."""

    AUTOMATIC = "automatic"  # rarms chooses, and says why
    SHARE = "share"  # of the processors, counted against the shares of the others as soon as they are short
    QUOTA = "quota"  # also a limit: no more than is reserved, even where processors are idle
    DEADLINE = "deadline"  # SCHED_DEADLINE: so much in each period of the component's first thread, before all others


MECHANISM = Key(
    "The mechanism of a reservation: `share` (a weight when processors are short), `quota` (also a "
    "limit, with a period of a tenth of the shortest threshold), `deadline` (SCHED_DEADLINE for the "
    "first thread of a component, a share for the others), or `automatic` (`share`)."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class LinuxHost:
    """Settings of the control groups of a Linux host."""

    slice: Annotated[str, Form.SLICE, Key("The control group that holds all partitions.")] = "rarms"
    control_groups: Annotated[
        Literal["automatic", "v1", "v2"],
        Key(
            "The version of control groups: `automatic` uses v2 if it is available or systemd is process 1, "
            "otherwise v1."
        ),
    ] = "automatic"
    mechanism: Annotated[Mechanism, MECHANISM] = Mechanism.AUTOMATIC


HostSettings = SimulatedHost | HypervHost | LinuxHost


@dataclass(frozen=True, slots=True, kw_only=True)
class Host:
    """A machine with partitions."""

    name: OwnName
    provider: Annotated[
        ProviderKind, Key("The platform that enforces reservations: `simulated`, `hyperv` or `linux`.")
    ] = ProviderKind.SIMULATED
    platform: Annotated[Name, Key("Hosts of one platform share measurements; absent: the host's own name.")] = ""
    connect: Annotated[Connect | WinRmConnect | None, Key("The connection to the host; absent: this machine.")] = None
    logical_processors: Annotated[Processors, Key("The number of logical processors (LPs) of the host.")]
    memory: Annotated[PositiveMemory, Key("The memory of the host: `4 GiB`.")]
    keep_for_host: Annotated[
        KeepForHost, Key("Processor time and memory that are kept for the host; absent: none.")
    ] = KeepForHost()
    system_responsiveness: Annotated[
        int | None,
        Within(0, 0xFFFFFFFF),
        Key(
            "The per cent of a processor that MMCSS leaves to other threads in the host's own Windows: 10, "
            "20, ... 90. It takes effect when the host restarts. Absent: not changed."
        ),
    ] = None
    simulated: Annotated[SimulatedHost, Key("Settings of a host with `provider: simulated`.")] = SimulatedHost()
    hyperv: Annotated[HypervHost, Key("Settings of a host with `provider: hyperv`.")] = HypervHost()
    linux: Annotated[LinuxHost, Key("Settings of a host with `provider: linux`.")] = LinuxHost()
    new: Annotated[bool, Key("In an overlay: the host is new, not in the manifest.")] = False

    @property
    def settings(self) -> HostSettings:
        """The block of its provider."""
        match self.provider:
            case ProviderKind.SIMULATED:
                return self.simulated
            case ProviderKind.HYPERV:
                return self.hyperv
            case ProviderKind.LINUX:
                return self.linux


def host_identity(machine_id: str) -> str:
    """Return the identity of a machine for marks, plans, journals and proofs: `HostFacts.id`.

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
