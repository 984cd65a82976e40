"""Which hosts a check of the plan would refuse for a partition: the search leaves them out while it has others.

The checks themselves come after the search and name what is wrong; they ask the same functions (for deadlines,
`mechanism.deadline_problems` says more).
"""

from collections.abc import Collection

from rarms_iac.model.host import Mechanism, SchedulerType
from rarms_iac.model.layout import PlacedPartition
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import HostFacts, PartitionSettings, State
from rarms_iac.model.system import Policy
from rarms_iac.planner.groups import Group
from rarms_iac.planner.mechanism import cannot_have_deadline, mechanism_of

IGNORED_RESERVES = "RARMS159"
"""The finding about a host whose scheduler ignores reserves; the policy may accept it there."""


def ignores_reserves(facts: HostFacts) -> bool:
    """Whether the host's scheduler honours no reserve, limit or weight.

    Args:
        facts: of the host; a client Windows that does not tell its scheduler has the root scheduler.

    Returns:
        False also where it is not known.
    """
    is_unknown_client = facts.scheduler is SchedulerType.UNKNOWN and facts.client
    return facts.scheduler is SchedulerType.ROOT or is_unknown_client


def asks_for_processors(settings: PartitionSettings) -> bool:
    """Whether a partition has a reserve or a limit that a scheduler has to honour.

    Returns:
        False: any scheduler will do.
    """
    return bool(settings.reserve) or settings.limit < 100


def takes_image(generation: int, image: str) -> bool:
    """Whether a new machine can have a disk that grows out of this image.

    Args:
        generation: of the machine; 2 takes no .vhd, and a child has its parent's format.
        image: its path; empty: none.

    Returns:
        False: Hyper-V would refuse it.
    """
    return generation != 2 or not image.lower().endswith(".vhd")


def has_switch(switches: Collection[str] | None, switch: str) -> bool:
    """Whether the host has the virtual switch that a machine is to be connected to.

    Args:
        switches: of the host; None: not known.
        switch: its name, in any case of letters; empty: none is wanted.

    Returns:
        True also where it is not known.
    """
    return not switch or switches is None or switch.lower() in {name.lower() for name in switches}


def is_larger_than_node(memory: int, largest_node: int | None) -> bool:
    """Whether a machine lies on no single NUMA node of a host where none may lie on two.

    Args:
        memory: of the machine, bytes.
        largest_node: `State.largest_node` of the host.

    Returns:
        Whether Hyper-V would not start it.
    """
    return largest_node is not None and memory > largest_node


def cannot_be_made(partition: PlacedPartition, host: State) -> bool:
    """Whether a check refuses to make a partition on a host where it is not yet.

    Args:
        switches: names of the host's virtual switches; None: not known.
        largest_node: `State.largest_node` of the host.

    Returns:
        True: the plan could not be made.
    """
    making, settings = partition.making, partition.settings
    has_all = takes_image(settings.generation, making.image) and has_switch(host.switches, making.switch)
    return not has_all or is_larger_than_node(settings.memory, host.largest_node)


def cannot_have_reserve(settings: PartitionSettings, group: Group, seen: SeenHost, policy: Policy) -> bool:
    """Whether a check refuses what a partition asks of the scheduler of a host, with other partitions or without.

    Args:
        facts: what was observed of the host; None: not looked at.
        policy: of the manifest; an acceptance of RARMS159 at the host counts.

    Returns:
        True: the plan could not be made.
    """
    is_deadline = bool(settings.reserve) and mechanism_of(group, seen.host)[0] is Mechanism.DEADLINE
    if is_deadline and (cannot_have_deadline(group) or seen.facts.deadline_percent == 0):
        return True
    accepted = policy.accept.get(IGNORED_RESERVES)
    is_accepted = accepted is not None and f"host/{seen.name}" in accepted.at
    return ignores_reserves(seen.facts) and asks_for_processors(settings) and not is_accepted
