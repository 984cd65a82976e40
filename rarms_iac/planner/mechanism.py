"""How a host keeps a reservation, and which hosts a check of the plan would refuse for a partition.

A Linux host keeps it as a share, a quota or a deadline. The search leaves out the hosts that a check would refuse while
a partition has others. The checks come after the search, name the fault, and ask the functions of this module.
"""

from collections.abc import Collection, Iterator, Sequence

from rarms_iac.model.host import Host, LinuxHost, Mechanism, ProviderKind, SchedulerType
from rarms_iac.model.indexes import index_named
from rarms_iac.model.layout import PlacedPartition
from rarms_iac.model.quantities import Unit
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import USUAL_DEADLINE_PERCENT, HostFacts, PartitionSettings, State
from rarms_iac.model.system import AtMost, Policy
from rarms_iac.planner.groups import Group

LEAST_QUOTA_US = 1_000
LONGEST_PERIOD_US, SHORTEST_PERIOD_US = 100_000, 1_000
"""The kernel takes no smaller quota than 1 ms; we take no period outside 1 to 100 ms, its own default."""

_EFFECTS = {
    Mechanism.SHARE: "a share, so that idle processors are used",
    Mechanism.QUOTA: "a quota, so that it never gets more",
    Mechanism.DEADLINE: "a deadline, so that the first thread of its component runs before all others",
}


def mechanism_of(group: Group, host: Host) -> tuple[Mechanism, str]:
    """Return the mechanism by which a Linux host keeps the reservation of a partition.

    Args:
        group: its own request counts first.
        host: where it would be; of another provider, it has nothing to choose.

    Returns:
        Never `automatic`: that is a share, as it was measured; and the reason in words, none on other providers.
    """
    if host.provider is not ProviderKind.LINUX:
        return Mechanism.SHARE, ""
    usual = host.settings.mechanism if isinstance(host.settings, LinuxHost) else Mechanism.AUTOMATIC
    wanted = group.request.linux.mechanism or usual
    chosen = Mechanism.SHARE if wanted is Mechanism.AUTOMATIC else wanted
    source = "chosen by rarms" if wanted is Mechanism.AUTOMATIC else "set in the manifest"
    return chosen, f"kept as {_EFFECTS[chosen]} ({source})"


def shortest_apt_ms(group: Group) -> float | None:
    """Find the shortest response time that a partition promises.

    Returns:
        Milliseconds; None: it promises none.
    """
    return min(
        (
            float(threshold.value)
            for member in group.members
            for name, threshold in member.apt.items()
            if isinstance(threshold, AtMost) and index_named(name).unit is Unit.TIME
        ),
        default=None,
    )


def quota_period_us(apt_ms: float | None, quota_percent: int) -> int:
    """Return the period of a quota: a tenth of the threshold, within the limits of the kernel.

    With the kernel's own 100 ms, a response time is a staircase: who used up the quota waits for the next period.

    Args:
        apt_ms: the shortest response time that is promised; None: none is.
        quota_percent: of one logical processor, above 0.

    Returns:
        Microseconds, 1,000 to 100,000; more where the quota would be less than the kernel's 1,000.
    """
    wanted = LONGEST_PERIOD_US if apt_ms is None else round(apt_ms * 100)
    period = min(max(wanted, SHORTEST_PERIOD_US), LONGEST_PERIOD_US)
    return max(period, -(-LEAST_QUOTA_US * 100 // max(1, quota_percent)))


def deadline_period_us(group: Group, host: Host) -> int | None:
    """Return the period of SCHED_DEADLINE for the component of a partition.

    Args:
        group: the partition's members and request.

    Returns:
        Microseconds, a tenth of the shortest threshold as of a quota; None: the mechanism is another one.
    """
    if mechanism_of(group, host)[0] is not Mechanism.DEADLINE:
        return None
    return quota_period_us(shortest_apt_ms(group), 100)


def deadline_percent(reserve: int, processors: int) -> int:
    """Return the share of the first thread of a partition's component, in per cent of one logical processor.

    Args:
        reserve: per cent of each processor of the partition.

    Returns:
        All that the partition reserves: under a share, too, one thread may use all of it. At most the kernel's 95.
    """
    return min(reserve * processors, USUAL_DEADLINE_PERCENT)


def cannot_have_deadline(group: Group) -> bool:
    """Tell whether a partition cannot have a deadline: it has several components, or one with a task class.

    Returns:
        True: the kernel would refuse it on each host.
    """
    return len(group.members) > 1 or bool(group.members[0].task_class)


def deadline_problems(
    partitions: Sequence[tuple[PlacedPartition, Group]], host: Host, processors: int, admitted: int
) -> Iterator[tuple[str, str, str]]:
    """Find the deadlines of a host that its kernel would refuse, or that would not mean what the manifest says.

    Args:
        partitions: those of the host with the mechanism `deadline`, with their groups.
        admitted: per cent of each that the kernel admits; 0: control groups hold only some processors.

    Yields:
        The partition's name, what is wrong, and what to do.
    """
    for partition, group in partitions:
        if len(group.members) > 1:
            message = f"{partition.name} has {len(group.members)} components, but a deadline applies to one thread."
            yield partition.name, message, "Give each component its own partition, or use `share` or `quota`."
        elif group.members[0].task_class:
            message = f"{group.members[0].name} has a task class, but a thread has either a deadline or a priority."
            yield partition.name, message, "Remove `task`, or use `share` or `quota`, which work with task classes."
    if not partitions:
        return
    name = partitions[0][0].name
    wanted = {
        partition.name: deadline_percent(partition.settings.reserve, partition.settings.processors)
        for partition, _ in partitions
    }
    if not admitted:
        message = f"The control groups of {host.name} have only some of its {processors} processors."
        message += " The kernel refuses SCHED_DEADLINE to a thread that cannot run on all processors."
        yield name, message, "Give the groups all processors (cpuset.cpus), or use `share` or `quota`."
    elif sum(wanted.values()) > admitted * processors:
        sizes = " + ".join(f"{percent} % ({partition})" for partition, percent in wanted.items())
        message = f"Deadlines on {host.name} need {sizes} = {sum(wanted.values())} % of a processor. The kernel admits "
        message += f"{admitted * processors} %: {admitted} % of each of {processors} (sched_rt_runtime_us)."
        yield name, message, "Reserve less, or use `share` or `quota` for a partition."


IGNORED_RESERVES = "RARMS159"
"""The finding about a host whose scheduler ignores reserves; the policy may accept it there."""


def ignores_reserves(facts: HostFacts) -> bool:
    """Return whether the host's scheduler honours no reserve, limit or weight.

    Args:
        facts: of the host; a client Windows that does not tell its scheduler has the root scheduler.

    Returns:
        False also where it is not known.
    """
    is_unknown_client = facts.scheduler is SchedulerType.UNKNOWN and facts.client
    return facts.scheduler is SchedulerType.ROOT or is_unknown_client


def asks_for_processors(settings: PartitionSettings) -> bool:
    """Return whether a partition has a reserve or a limit that a scheduler has to honour.

    Returns:
        False: any scheduler will do.
    """
    return bool(settings.reserve) or settings.limit < 100


def takes_image(generation: int, image: str) -> bool:
    """Return whether a new machine can have a disk that grows out of this image.

    Args:
        generation: of the machine; 2 takes no .vhd, and a child has its parent's format.

    Returns:
        False: Hyper-V would refuse it.
    """
    return generation != 2 or not image.lower().endswith(".vhd")


def has_switch(switches: Collection[str] | None, switch: str) -> bool:
    """Return whether the host has the virtual switch that a machine is to be connected to.

    Args:
        switches: of the host; None: not known.
        switch: its name, in any case of letters; empty: none is wanted.

    Returns:
        True also where it is not known.
    """
    return not switch or switches is None or switch.lower() in {name.lower() for name in switches}


def is_larger_than_node(memory: int, largest_node: int | None) -> bool:
    """Return whether a machine fits no single NUMA node of a host where none may span two.

    Args:
        memory: of the machine, bytes.

    Returns:
        Whether Hyper-V would not start it.
    """
    return largest_node is not None and memory > largest_node


def cannot_be_made(partition: PlacedPartition, host: State) -> bool:
    """Return whether a check refuses to make a partition on a host where it is not yet.

    Args:
        switches: names of the host's virtual switches; None: not known.

    Returns:
        True: the plan could not be made.
    """
    making, settings = partition.making, partition.settings
    has_all = takes_image(settings.generation, making.image) and has_switch(host.switches, making.switch)
    return not has_all or is_larger_than_node(settings.memory, host.largest_node)


def cannot_have_reserve(settings: PartitionSettings, group: Group, seen: SeenHost, policy: Policy) -> bool:
    """Return whether a check refuses what a partition asks of a host's scheduler, with others or alone.

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
