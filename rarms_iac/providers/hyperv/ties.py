"""What decides over a machine beside its host: replication, a failover cluster, a CPU group. Pure."""

import re
from collections.abc import Iterator, Mapping

from rarms_iac.model.state import Tie
from rarms_iac.providers.hyperv.observation import HostObservation, ObservedMachine, ProcessorSetting, or_else

_NO_GROUP = "00000000-0000-0000-0000-000000000000"
_INSTANCE = re.compile(r"Microsoft:(?P<id>[0-9a-fA-F-]{36})\\")
_REPLICAS = frozenset({"Replica", "TestReplica", "ExtendedReplica"})

REPLICA_MARK = "the machine is a replica of one on another host"
"""Why a mark on it does not count."""


def processor_settings(observation: HostObservation) -> Iterator[tuple[str, ProcessorSetting]]:
    """Yield settings by the id of their machine; those of checkpoints carry ids that no machine has."""
    for setting in or_else(observation.cpu_groups, ()):
        if instance := _INSTANCE.match(setting.instance):
            yield instance["id"].lower(), setting


def cpu_groups_of(observation: HostObservation) -> Mapping[str, str]:
    """By id of a machine: its CPU group, where it is in one."""
    groups = ((machine, setting.group.strip("{}").lower()) for machine, setting in processor_settings(observation))
    return {machine: group for machine, group in groups if group not in {"", _NO_GROUP}}


def ties_of(machine: ObservedMachine, groups: Mapping[str, str]) -> tuple[Tie, ...]:
    """Return what a machine is tied to.

    Args:
        groups: by id of a machine: its CPU group.

    Returns:
        The ties in their order; none of what an older observation did not ask.
    """
    facts = {
        Tie.REPLICA: machine.replication_mode in _REPLICAS,
        Tie.CLUSTER: machine.clustered == "True",
        Tie.CPU_GROUP: machine.id in groups,
    }
    return tuple(tie for tie, holds in facts.items() if holds)
