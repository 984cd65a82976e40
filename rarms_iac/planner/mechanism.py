"""How a Linux host keeps a reservation: share, quota or deadline, with its period and what the kernel admits."""

from collections.abc import Iterator, Sequence

from rarms_iac.model.host import Host, LinuxHost, Mechanism, ProviderKind
from rarms_iac.model.indexes import index_named
from rarms_iac.model.layout import PlacedPartition
from rarms_iac.model.quantities import Unit
from rarms_iac.model.state import USUAL_DEADLINE_PERCENT
from rarms_iac.model.system import AtMost
from rarms_iac.planner.groups import Group

LEAST_QUOTA_US = 1_000
LONGEST_PERIOD_US, SHORTEST_PERIOD_US = 100_000, 1_000
"""The kernel takes no smaller quota than 1 ms; we take no period outside 1 to 100 ms, its own default."""

_EFFECTS = {
    Mechanism.SHARE: "a share, for then idle processors serve everybody",
    Mechanism.QUOTA: "a quota, so that it gets no more where processors are idle",
    Mechanism.DEADLINE: "a deadline, so that its component's first thread goes before all others",
}


def mechanism_of(group: Group, host: Host) -> tuple[Mechanism, str]:
    """Return how a Linux host keeps the reservation of a partition.

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
    source = "chosen by rarms" if wanted is Mechanism.AUTOMATIC else "the manifest says so"
    return chosen, f"kept as {_EFFECTS[chosen]} ({source})"


def shortest_apt_ms(group: Group) -> float | None:
    """Find the shortest response time that a partition promises.

    Args:
        group: its members' thresholds count.

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
    """Return how often a quota is counted anew: ten times within a threshold, within what the kernel takes.

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
    """Return what the first thread of a partition's component gets, in per cent of one logical processor.

    Args:
        reserve: per cent of each processor of the partition.

    Returns:
        All that the partition reserves: under a share, too, one thread may use all of it. At most the kernel's 95.
    """
    return min(reserve * processors, USUAL_DEADLINE_PERCENT)


def cannot_have_deadline(group: Group) -> bool:
    """Tell whether a partition cannot have a deadline: it has several components, or one with a task class.

    Args:
        group: the partition's members.

    Returns:
        True: the kernel would refuse it on each host.
    """
    return len(group.members) > 1 or bool(group.members[0].task)


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
            message = f"{partition.name} has {len(group.members)} components, and a deadline is of one thread."
            yield partition.name, message, "Give each a partition of its own, or use `share` or `quota`."
        elif group.members[0].task:
            message = f"{group.members[0].name} has a task class, and a thread has either a deadline or a priority."
            yield partition.name, message, "Remove `task`, or use `share` or `quota`: they go with task classes."
    if not partitions:
        return
    name = partitions[0][0].name
    wanted = {
        partition.name: deadline_percent(partition.settings.reserve, partition.settings.processors)
        for partition, _ in partitions
    }
    if not admitted:
        message = f"The control groups of {host.name} hold only some of its {processors} processors."
        message += " The kernel refuses SCHED_DEADLINE to a thread that may not run on all of them."
        yield name, message, "Give the groups all processors (cpuset.cpus), or use `share` or `quota`."
    elif sum(wanted.values()) > admitted * processors:
        sizes = " + ".join(f"{percent} % ({partition})" for partition, percent in wanted.items())
        message = f"Deadlines on {host.name} need {sizes} = {sum(wanted.values())} % of a processor. The kernel admits "
        message += f"{admitted * processors} %: {admitted} % of each of {processors} (sched_rt_runtime_us)."
        yield name, message, "Reserve less, or use `share` or `quota` for a partition."
