"""The condition of a host: what `rarms doctor` looks at beside the host's State. Nothing is planned by it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from rarms_iac.model.state import RegistryValue


class PolicyScope(StrEnum):
    """Where an execution policy is set, in PowerShell's own words; the first that is set decides."""

    MACHINE_POLICY = "MachinePolicy"
    USER_POLICY = "UserPolicy"
    PROCESS = "Process"
    CURRENT_USER = "CurrentUser"
    LOCAL_MACHINE = "LocalMachine"

    @property
    def is_group_policy(self) -> bool:
        """Whether it outranks what a PowerShell was started with."""
        return self in {PolicyScope.MACHINE_POLICY, PolicyScope.USER_POLICY}


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineCondition:
    """What is odd about a virtual machine and no setting of ours; its settings are in its Partition of the same id."""

    id: str
    clustered: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class HostCondition:
    """How a host is, as far as it could be looked at; None: it could not, and `unread` says why."""

    powershell: str | None = None  # version of the PowerShell that looked: 5.1.26100.2161
    bits: int | None = None  # of the process that looked
    policies: Mapping[PolicyScope, str] = field(default_factory=dict)  # Restricted, RemoteSigned, ...
    module: tuple[str, ...] | None = None  # versions of the Hyper-V module; empty: it is not installed
    role: bool | None = None  # Windows has Hyper-V's WMI namespace
    hypervisor_running: bool | None = None
    counters: bool | None = None  # of the hypervisor, which prove contention
    elevated: bool | None = None  # who looked: only such a one may change the host
    hyperv_administrator: bool | None = None  # who looked is a member of that group
    script_running: bool | None = None  # of rarms, on that host; only a look on the host itself tells
    seen_processors: int | None = None  # logical processors that the host's own Windows sees
    numa_nodes: int | None = None
    machines: tuple[MachineCondition, ...] = ()
    responsiveness: RegistryValue | None = None  # SystemResponsiveness of the host's own Windows, where it is set
    unread: Mapping[str, str] = field(default_factory=dict)  # what could not be looked at -> why
