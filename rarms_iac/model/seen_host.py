"""A host as it was seen: the one value that the planner, the doctor, status, drift and reports pass on."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property

from rarms_iac.model.capacity import Capacity, capacity_of, core_sharing, foreign_claimants
from rarms_iac.model.claims import Claim, CoreSharing
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import Host, SchedulerType
from rarms_iac.model.output import Internal, output
from rarms_iac.model.state import HostFacts, Partition, RegistryValue, Rights, RunState, State


class PolicyScope(StrEnum):
    """The scope of an execution policy, in PowerShell's own words; the first that is set decides."""

    MACHINE_POLICY = "MachinePolicy"
    USER_POLICY = "UserPolicy"
    PROCESS = "Process"
    CURRENT_USER = "CurrentUser"
    LOCAL_MACHINE = "LocalMachine"

    @property
    def is_group_policy(self) -> bool:
        """Whether it outranks the policy that a PowerShell was started with."""
        return self in {PolicyScope.MACHINE_POLICY, PolicyScope.USER_POLICY}


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """Facts of a host that no plan needs, for `rarms doctor`; None: not read, and `unread` says why."""

    powershell: str | None = None  # version of the PowerShell that looked: 5.1.26100.2161
    bits: int | None = None  # of the process that looked
    policies: Mapping[PolicyScope, str] = field(default_factory=dict)  # Restricted, RemoteSigned, ...
    module: tuple[str, ...] | None = None  # versions of the Hyper-V module; empty: it is not installed
    role: bool | None = None  # Windows has Hyper-V's WMI namespace
    hypervisor_running: bool | None = None
    counters: bool | None = None  # of the hypervisor, which prove contention
    elevated: bool | None = None  # who looked: only such a one may change the host
    hyperv_administrator: bool | None = None  # who looked is a member of that group
    script_running: bool | None = None  # of rarms, on that host; only a look on the host itself shows it
    seen_processors: int | None = None  # logical processors that the host's own Windows sees
    numa_nodes: int | None = None
    responsiveness: RegistryValue | None = None  # SystemResponsiveness of the host's own Windows, where it is set
    thread_watcher: bool | None = None  # it runs on this Linux, or will when it has rules; None: nothing needs it
    unread: Mapping[str, str] = field(default_factory=dict)  # what could not be looked at -> why


@dataclass(frozen=True, kw_only=True)
class SeenHost:
    """A host of the manifest, and what one look found there.

    `own` and all that is made of it are of one application. `unseen` makes the one of a host without a look.
    """

    host: Internal[Host]
    application: Internal[str]
    state: Internal[State]
    condition: Condition = Condition()
    findings: tuple[Diagnostic, ...] = ()  # the provider's; `rarms doctor` adds those of its checks

    @property
    def name(self) -> str:
        """The host's name in the manifest."""
        return self.host.name

    @output
    def facts(self) -> HostFacts:
        """The facts that decisions use."""
        return self.state.facts

    @output
    def memory_left(self) -> int | None:
        """Bytes that machines can still have; None: not known."""
        return self.state.memory_left

    @output
    def machines(self) -> int:
        """How many the host has."""
        return len(self.state.partitions)

    @output
    def managed(self) -> int:
        """How many of the machines are the application's."""
        return len(self.own)

    @output
    def running(self) -> int:
        """How many of all machines run."""
        return sum(machine.settings.running for machine in self.state.partitions)

    @cached_property
    def own(self) -> tuple[Partition, ...]:
        """The application's partitions there."""
        return self.state.of(self.application).partitions

    @cached_property
    def capacity(self) -> Capacity:
        """The processors and memory that the host can promise."""
        return capacity_of(self.host, self.facts)

    @cached_property
    def claimants(self) -> tuple[Partition, ...]:
        """The machines of others that run, start, or start by themselves."""
        return foreign_claimants(self.state, self.application)

    @cached_property
    def claims(self) -> tuple[Claim, ...]:
        """Those of the claimants, in their order."""
        return tuple(machine.claim for machine in self.claimants)

    @cached_property
    def present(self) -> Mapping[str, Partition]:
        """The application's partitions, by the names in their marks."""
        return {partition.mark.name: partition for partition in self.own if partition.mark}

    @cached_property
    def taken_names(self) -> frozenset[str]:
        """Names of unmanaged machines that none of the application's partitions has there."""
        own = {partition.settings.name for partition in self.own}
        return frozenset(machine.settings.name for machine in self.state.partitions) - own

    def is_pinned(self, partition: str) -> bool:
        """Return whether the partition is on the host and may not be removed as it is."""
        there = self.present.get(partition)
        return there is not None and (bool(there.ties) or there.state in {RunState.BUSY, RunState.CRITICAL})

    def sharing(self, partition: str) -> CoreSharing:
        """Return a partition's way of taking cores there: that of its machine, or of one that is made now."""
        there = self.present.get(partition)
        return core_sharing(self.facts) if there is None else there.sharing


def unseen(host: Host, application: str = "") -> SeenHost:
    """Return a host without a look: it is empty, and has what the manifest says."""
    facts = HostFacts(
        name=host.name,
        id="",
        provider=host.provider,
        computer_name="",
        os_build=0,
        client=False,
        scheduler=SchedulerType.UNKNOWN,
        smt=False,
        logical_processors=host.logical_processors,
        memory=int(host.memory),
        rights=Rights.UNKNOWN,
    )
    return SeenHost(host=host, application=application, state=State(facts=facts))


def seen_hosts(hosts: Mapping[str, Host], application: str, states: Mapping[str, State]) -> Mapping[str, SeenHost]:
    """Return every host of a manifest with its state; hosts without a state are `unseen`."""
    return {
        name: SeenHost(host=host, application=application, state=states[name])
        if name in states
        else unseen(host, application)
        for name, host in hosts.items()
    }
