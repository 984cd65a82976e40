"""A host as it was seen: the one value that the planner, the doctor, status, drift and reports pass on."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from rarms_iac.model.capacity import Capacity, capacity_of, core_sharing, foreign_claimants
from rarms_iac.model.claims import Claim, CoreSharing
from rarms_iac.model.host import Host, SchedulerType
from rarms_iac.model.state import HostFacts, Partition, Rights, RunState, State


@dataclass(frozen=True, kw_only=True)
class SeenHost:
    """A host of the manifest, and what one look found there.

    `own` and all that is made of it are of one application. `unseen` makes the one of a host without a look.
    """

    host: Host
    application: str
    state: State

    @property
    def name(self) -> str:
        """The host's name in the manifest."""
        return self.host.name

    @property
    def facts(self) -> HostFacts:
        """Those that decisions rest on."""
        return self.state.facts

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
        """Whether the partition is there and may not be removed as it is."""
        there = self.present.get(partition)
        return there is not None and (bool(there.ties) or there.state in {RunState.BUSY, RunState.CRITICAL})

    def sharing(self, partition: str) -> CoreSharing:
        """Return how a partition takes cores there: as its machine does, or as one that is made now."""
        there = self.present.get(partition)
        return core_sharing(self.facts) if there is None else there.sharing


def unseen(host: Host, application: str) -> SeenHost:
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
