"""`hosts`: the machines that partitions are made on."""

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Discriminator, Field, Tag

from rarms_iac.manifest.document.components import FromEnvironmentBlock
from rarms_iac.manifest.document.fields import Block, Maybe, by_name, needed, optional
from rarms_iac.manifest.document.quantities import AmountOfHost, Memory, PositiveMemory, Time
from rarms_iac.manifest.document.rules import BLOCK_OF
from rarms_iac.manifest.document.text_forms import (
    AbsoluteFolder,
    Filled,
    HostName,
    Name,
    Operation,
    SliceName,
    SshFile,
    SshTarget,
)
from rarms_iac.model.host import FaultEffect, Mechanism, ProviderKind, Receiver, SchedulerType


def _only_its_own_block() -> dict[str, Any]:
    """A key that is not allowed here is refused by the JSON Schema too; a host without `provider` is simulated."""

    def rule(kind: ProviderKind) -> dict[str, Any]:
        message: dict[str, Any] = {"properties": {"provider": {"const": kind.value}}}
        if kind is not ProviderKind.SIMULATED:
            message["required"] = ["provider"]
        others = [block for other, block in BLOCK_OF.items() if other is not kind]
        return {"if": message, "then": {"not": {"anyOf": [{"required": [block]} for block in others]}}}

    return {"allOf": [rule(kind) for kind in ProviderKind]}


class KeepForHostBlock(Block):
    """What partitions never get."""

    processor: AmountOfHost = optional(
        "Processor time the host's own operating system keeps: `10 %` or `0.5 LP`, at most 100 %.", "0 %"
    )
    memory: Memory = optional("Memory the host's own operating system keeps: `1 GiB`.", "0 B")


RECEIVER = (
    "What takes scripts at the other end: `sent` (a text that rarms sends ahead of them) or `installed` (the module "
    "Rarms of this version there, for hosts that run signed scripts only)."
)


class ConnectBlock(Block):
    """How a remote system is reached: by the system's own ssh."""

    ssh: SshTarget = needed("Where ssh connects to: `user@host`, or a name of your ssh configuration.")
    shell: Literal["pwsh", "powershell"] = optional(
        "The shell at the other end: `pwsh` (PowerShell 7) or `powershell` (Windows PowerShell 5.1).", "pwsh"
    )
    receiver: Annotated[Receiver, Field(strict=False)] = optional(RECEIVER, Receiver.SENT)
    port: Maybe[Annotated[int, Field(ge=1, le=65535)]] = optional(
        "The port that sshd listens at; absent: as your ssh configuration says."
    )
    key: Maybe[SshFile] = optional("The file of the private key; absent: as your ssh configuration says.")
    jump: Maybe[SshTarget] = optional("The host that is jumped through, `user@host`; absent: none.")
    control_path: Maybe[SshFile] = optional(
        "The socket over which connections are shared (ssh's `ControlPath`): one login for all. Absent: as your "
        "ssh configuration says."
    )
    folder: Maybe[AbsoluteFolder] = optional(
        "Where a Linux host has the manifest's folder with the components' files: `/opt/robot`. Measuring, proving and "
        "`rarms run` need it."
    )


class WinRmBlock(Block):
    """How a remote Windows is reached: by WinRM over HTTPS, whose certificate is checked."""

    winrm: HostName = needed("The name or address of the host, as its certificate has it.")
    shell: Literal["pwsh", "powershell"] = optional(
        "The shell at the other end: `pwsh` (PowerShell 7) or `powershell` (Windows PowerShell 5.1).", "pwsh"
    )
    receiver: Annotated[Receiver, Field(strict=False)] = optional(RECEIVER, Receiver.SENT)
    port: Maybe[Annotated[int, Field(ge=1, le=65535)]] = optional("The port of its HTTPS listener; absent: 5986.")
    user: Maybe[Filled] = optional(
        "The account, such as `CELL\\rarms`; absent, with `password`: that of the Kerberos ticket."
    )
    password: Maybe[FromEnvironmentBlock] = optional(
        "The variable of rarms' own environment that holds the password; absent: the Kerberos ticket."
    )


def _connection(value: Any) -> str:
    return "winrm" if isinstance(value, WinRmBlock) or (isinstance(value, dict) and "winrm" in value) else "ssh"


Connection = Annotated[
    Annotated[ConnectBlock, Tag("ssh")] | Annotated[WinRmBlock, Tag("winrm")], Discriminator(_connection)
]
"""How a host is reached: by the key that it has."""


class FaultBlock(Block):
    """A fault of a simulated host, to try what happens then."""

    operation: Operation = needed("The kind of operation that goes wrong: `start_partition`, `set_cpu`, ...")
    at: Filled = optional("The address where it happens, or `*` for any.", "*")
    effect: Annotated[FaultEffect, Field(strict=False)] = needed(
        "`refuse`: refuses the operation; `fail_after`: does it, then fails; `late`: answers after `delay`."
    )
    delay: Time = optional("How late the answer comes: `2 s`.", "0 ms")
    times: Maybe[Annotated[int, Field(ge=1, le=1_000_000)]] = optional("How often it happens; absent: always.")


class SimulatedBlock(Block):
    """The machine that a simulated host simulates."""

    windows_build: int = optional("The build of the host's Windows; 26100 is Server 2025.", 26100, ge=6000, le=99999)
    guest_windows_build: int = optional("The build of the guests' Windows.", 26100, ge=2600, le=99999)
    client: bool = optional("Whether the host runs a client Windows instead of a server.", False)
    scheduler: Maybe[Annotated[SchedulerType, Field(strict=False)]] = optional(
        "The hypervisor's scheduler; under `root` reserves have no effect; absent: `core` with `smt` on a server since "
        "2019, otherwise `classic`."
    )
    smt: bool = optional(
        "Whether two logical processors share a core. It changes what partitions take, and not what is measured.", False
    )
    administrator: bool = optional("Whether rarms has the rights it needs there.", True)
    faults: Maybe[Annotated[dict[Name, FaultBlock], by_name]] = optional("Faults that happen there, by name.")


SecureBoot = Literal["off", "MicrosoftWindows", "MicrosoftUEFICertificateAuthority"]


class HypervHostBlock(Block):
    """What the partitions of a Hyper-V host use unless they say otherwise."""

    generation: int = optional("The generation of new machines, 1 or 2; it never changes afterwards.", 2, ge=1, le=2)
    switch: Maybe[Filled] = optional("The virtual switch that partitions are connected to; absent: none.")
    image: Maybe[Filled] = optional("The disk image that partitions' disks are children of; absent: no disk.")
    vm_path: Maybe[Filled] = optional("The folder on the host for virtual machines; absent: the default of the host.")
    secure_boot: Maybe[SecureBoot] = optional(
        "Secure boot of generation 2: `off`, or the template that the guest boots with, `MicrosoftWindows` or, for "
        "Linux, `MicrosoftUEFICertificateAuthority`. Absent: a new machine gets "
        "`MicrosoftWindows`, the default of Hyper-V, and one that exists keeps what it has."
    )
    credential: Maybe[Filled] = optional(
        "The name under which the host keeps what guests are entered with, to measure in them; never the secret itself."
    )


MechanismName = Annotated[Mechanism, Field(strict=False)]
MECHANISM = (
    "How a reservation is kept: `share` (weight against the others as soon as processors are short), `quota` (also a "
    "limit, counted anew ten times within the shortest threshold), `deadline` (SCHED_DEADLINE for a component's first "
    "thread, a share for its others), or `automatic` (`share`)."
)


class LinuxBlock(Block):
    """Where control groups are made."""

    slice: SliceName = optional("The control group that holds all partitions.", "rarms")
    control_groups: Literal["automatic", "v1", "v2"] = optional(
        "The version of control groups: `automatic` takes v2 where it is there or systemd is process 1, else v1.",
        "automatic",
    )
    mechanism: MechanismName = optional(MECHANISM, "automatic")


class HostBlock(Block):
    """A machine that partitions are made on."""

    model_config = ConfigDict(json_schema_extra=_only_its_own_block())

    provider: Annotated[ProviderKind, Field(strict=False)] = optional(
        "What enforces reservations there: `simulated` (needs nothing), `hyperv` or `linux`.", "simulated"
    )
    platform: Maybe[Name] = optional("Hosts of one platform share measurements; absent: the host's own name.")
    connect: Maybe[Connection] = optional("How the host is reached; absent: it is this machine.")
    logical_processors: int = needed("How many logical processors (LPs) the host has.", ge=1, le=2048)
    memory: PositiveMemory = needed("How much memory the host has: `4 GiB`.")
    keep_for_host: Maybe[KeepForHostBlock] = optional("What partitions never get; absent: nothing.")
    system_responsiveness: Maybe[Annotated[int, Field(ge=0, le=0xFFFFFFFF)]] = optional(
        "The per cent of a processor that MMCSS leaves to all other threads in the host's own Windows: 10, 20, ... 90. "
        "It takes effect when the host starts again. Absent: rarms does not change it."
    )
    simulated: Maybe[SimulatedBlock] = optional("Settings of a host with `provider: simulated`.")
    hyperv: Maybe[HypervHostBlock] = optional("Settings of a host with `provider: hyperv`.")
    linux: Maybe[LinuxBlock] = optional("Settings of a host with `provider: linux`.")
    new: bool = optional("In an overlay: the manifest has no host of this name.", False)
