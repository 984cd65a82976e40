"""Reviews of a host as a whole: machines and task classes of others, and limits that hold nothing back."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

from rarms_iac.applying.desired_hosts import partition_after_change, partitions_after
from rarms_iac.applying.doctor.machines import check_cpu_group, check_unequal_processors
from rarms_iac.applying.plan_request import PlanRequest
from rarms_iac.model.capacity import packs_by_first_fit
from rarms_iac.model.changes import Change
from rarms_iac.model.claims import load_of
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.model.mmcss import thread_priority
from rarms_iac.model.plan import HostPlan, Purpose
from rarms_iac.model.quantities import guaranteed
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import Partition, PartitionSettings, RegistryValue, TaskClass, ValueKind
from rarms_iac.model.system import TaskCategory
from rarms_iac.planner.desired import Desired
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.mechanism import is_larger_than_node
from rarms_iac.planner.sizes import OPEN, limit_in_manifest
from rarms_iac.texts.findings import NEIGHBOURS, NO_ORDER, Finding
from rarms_iac.texts.messages import counted, in_a_row, list_names
from rarms_iac.texts.quantities import show_amount, show_bytes, show_processors

NO_MEMORY_LEFT = Finding.error("RARMS403", "The memory does not fit the host")


UNMANAGED_GETS_LESS = Finding.warning("RARMS223", "An unmanaged partition gets less processor time")

SMT_COSTS = Finding.note("RARMS231", "SMT leaves logical processors idle")


def review_smt(request: PlanRequest, desired: Desired, plan: HostPlan) -> Iterator[Diagnostic]:
    """Report reserves that a partition cannot use: with SMT a core never runs two machines (core scheduler)."""
    costs = {
        partition.settings.name: partition.claim
        for partition in partitions_after(desired.seen.state, request.application, plan.changes)
        if partition.claim.idle_percent
    }
    if plan.changes and costs:
        names = in_a_row(
            [f"{name} ({show_processors(load_of([claim]).idle_processors)})" for name, claim in costs.items()]
        )
        yield SMT_COSTS.of_host(
            desired.host,
            (
                "The core scheduler of {host} runs one machine on a core at a time. The reservation of {_names} "
                "leaves the same amount idle, because the number of virtual processors is odd or the machine does "
                "not use SMT."
            ),
            (
                "Give the partition an even number of `processors`, leave HwThreadCountPerCore at 0, or combine "
                "components."
            ),
            partitions=tuple(costs),
            idle_lp=float(load_of(costs.values()).idle_processors),
            _names=names,
        )


def review_numa_nodes(desired: Desired, plan: HostPlan) -> Iterator[Diagnostic]:
    """Report machines larger than a NUMA node: without spanning Hyper-V does not start them."""
    node = desired.seen.state.largest_node
    for change in plan.changes:
        partition = partition_after_change(change)
        before = change.before.settings.memory if isinstance(change.before, Partition) else 0
        if node is None or partition is None or (memory := partition.settings.memory) <= before:
            continue
        if is_larger_than_node(memory, node):
            name = partition.settings.name
            yield NO_MEMORY_LEFT.at(
                change.reason.place,
                (
                    '"{partition}" needs {_show_bytes}, but the largest NUMA node of {host} has {_show_bytes_}. '
                    "NUMA spanning is off, so a machine must fit on one node."
                ),
                (
                    "Give the partition less `memory`. Or allow NUMA spanning: run `Set-VMHost -NumaSpanningEnabled "
                    "$true`, then `Restart-Service vmms`. Then plan again."
                ),
                address=str(change.address),
                partition=name,
                memory=memory,
                node=node,
                host=desired.host,
                _show_bytes=show_bytes(memory, node),
                _show_bytes_=show_bytes(node, memory),
            )


def review_memory_left(seen: SeenHost, changes: Sequence[Change]) -> Iterator[Diagnostic]:
    """Find machines that cannot start because memory is not free: 0x800705AA (windows.md 5)."""
    before = {change.address: _running_memory(change.before) for change in changes}
    after = {change.address: _running_memory(partition_after_change(change)) for change in changes}
    more = {address: memory - before[address] for address, memory in after.items() if memory > before[address]}
    freed = sum(max(0, memory - after[address]) for address, memory in before.items())
    host_left, node = seen.memory_left, seen.state.node_left
    if host_left is not None and sum(more.values()) > host_left + freed:
        yield _no_memory_left(seen.name, {str(address): each for address, each in more.items()}, host_left, freed)
        return
    largest = seen.state.largest_node
    if node is None or largest is None:
        return
    most = min(largest, node + freed)  # freed memory may be on any node
    for change in changes:
        memory = after[change.address]
        if change.address in more and most < memory <= largest:
            yield NO_MEMORY_LEFT.at(
                change.reason.place,
                "{partition} needs {_show_bytes} on one NUMA node to start. The node of {host} with the most free "
                "memory has {_show_bytes_}, and NUMA spanning is off.",
                (
                    "Stop other machines on the host, or give the partition less `memory`. Or allow NUMA spanning: "
                    "run `Set-VMHost -NumaSpanningEnabled $true`, then `Restart-Service vmms`. Then plan again."
                ),
                address=str(change.address),
                partition=change.address.partition,
                memory=memory,
                left=most,
                host=seen.name,
                _show_bytes=show_bytes(memory, most),
                _show_bytes_=show_bytes(most, memory),
            )


def _running_memory(thing: object) -> int:
    return thing.settings.memory if isinstance(thing, Partition) and thing.settings.running else 0


def _no_memory_left(host: str, more: Mapping[str, int], host_left: int, freed: int) -> Diagnostic:
    total = sum(more.values())
    names = list_names((f"{address.removeprefix('partition/')} {show_bytes(each)}" for address, each in more.items()))
    after_stops = f" The plan first stops machines with {show_bytes(freed)}." if freed else ""
    return NO_MEMORY_LEFT.of_host(
        host,
        "The plan starts machines with {_show_bytes} on {host}: {_names}. {host} reports {_show_bytes_} free for "
        "machines.{_after_stops}",
        (
            "Stop other programs and machines on the host, give partitions less memory in the manifest, or add "
            "memory. Then plan again."
        ),
        partitions=tuple(more),
        starts_memory_bytes=total,
        left_memory_bytes=host_left,
        freed_memory_bytes=freed,
        _show_bytes=show_bytes(total, host_left),
        _names=names,
        _show_bytes_=show_bytes(host_left, total),
        _after_stops=after_stops,
    )


def review_cpu_groups(request: PlanRequest, desired: Desired, plan: HostPlan) -> Iterator[Diagnostic]:
    """Find CPU groups that limit unchanged partitions; the plan is refused for changed ones (RARMS152)."""
    if request.purpose is Purpose.APPLY:
        changed = {change.before.id for change in plan.changes if isinstance(change.before, Partition)}
        unchanged = tuple(partition for partition in desired.seen.own if partition.id not in changed)
        seen = replace(desired.seen, state=replace(desired.seen.state, partitions=unchanged))
        for finding in check_cpu_group(seen):
            yield replace(finding, place=request.places.key("hosts", desired.host))


def review_unequal_processors(request: PlanRequest, desired: Desired) -> Iterator[Diagnostic]:
    """Find hosts whose logical processors are unequal: a reserve counts all alike."""
    if request.purpose is Purpose.APPLY:
        for finding in check_unequal_processors(desired.seen):
            yield replace(finding, place=request.places.key("hosts", desired.host))


def review_script_placement(seen: SeenHost, changes: Sequence[Change]) -> Iterator[Diagnostic]:
    """Report placements that a Hyper-V script, which places the largest reserve first, cannot find.

    A plan that its script would stop half-way is refused before.
    """
    if seen.host.provider is not ProviderKind.HYPERV or not changes:
        return
    partitions = partitions_after(seen.state, seen.application, changes)
    managed = [partition.claim for partition in partitions if partition.settings.running]
    claims = (*seen.claims, *managed)
    if managed and not packs_by_first_fit(claims, seen.capacity):
        yield NO_ORDER.of_host(
            seen.name,
            (
                "On {host}, the virtual processors fit only in a certain order. A script starts the largest "
                "reserve first. A later start would then fail."
            ),
            "Lower a reserve, give a partition other `processors`, or move a component to another host.",
        )


def review_unmanaged_machines(request: PlanRequest, desired: Desired, plan: HostPlan) -> Iterator[Diagnostic]:
    """Report unmanaged machines that get less; rarms never changes their settings.

    When all machines are busy, each gets its reserve, and the rest is shared by weight, processor by processor
    (windows.md 1.1). A larger reserve or weight of ours leaves less for the others. While the host has idle time no
    partition loses.
    """
    if request.purpose in {Purpose.IMPORT, Purpose.RELEASE, Purpose.STOP, Purpose.START}:
        return  # a mark is written or erased, and no share changes; what starts again had it before
    managed = desired.seen.own
    unmanaged = [
        machine for machine in desired.seen.state.partitions if machine.settings.running and machine not in managed
    ]
    managed_before = (partition.settings for partition in managed)
    others = [machine.settings for machine in unmanaged]
    before = [*others, *(settings for settings in managed_before if settings.running)]
    remaining = partitions_after(desired.seen.state, request.application, plan.changes)
    after = [*others, *(partition.settings for partition in remaining if partition.settings.running)]
    available = desired.seen.state.facts.logical_processors
    losers: dict[str, str] = {}  # by machine id
    for machine in unmanaged:
        settings = machine.settings
        old, new = busy_share(settings, before, available), busy_share(settings, after, available)
        if new < old:
            losers[machine.id] = (
                f'"{settings.name}" ({machine.id[:8]}) about {show_processors(old)} -> {show_processors(new)}, '
                f"{show_processors(guaranteed(settings.reserve, settings.processors))} reserved"
            )
    if losers:
        yield UNMANAGED_GETS_LESS.of_host(
            desired.host,
            (
                "{application} does not manage these partitions on {host}. They get less processor time under full "
                "load: {_join}."
            ),
            prose(
                "If one of them has deadlines, give it a reserve first, or import it: ",
                command("import", "PARTITION", id="ID"),
                ".",
            ),
            machines=tuple(losers),
            application=request.application,
            _join="; ".join(losers.values()),
        )


def busy_share(settings: PartitionSettings, running: Sequence[PartitionSettings], logical_processors: int) -> Fraction:
    """Return a machine's LPs while all are busy: its reserve, and its share of the rest by weight."""
    reserved = Fraction(sum(other.reserve * other.processors for other in running), 100)
    weights = max(1, sum(other.weight * other.processors for other in running))
    free = max(Fraction(0), logical_processors - reserved)
    own = Fraction(settings.reserve * settings.processors, 100) + free * settings.weight * settings.processors / weights
    return min(own, Fraction(settings.limit * settings.processors, 100))


def review_task_classes(request: PlanRequest, desired: Desired, plan: HostPlan) -> Iterator[Diagnostic]:
    """Report foreign task classes that may run above robotic ones; they stay as they are.

    Once a host, where the plan writes task classes.
    """
    if not any(change.address.task for change in plan.changes):
        return
    systems: dict[str, list[str]] = {}
    for inside, task_class, priority in classes_above(request, desired, plan):
        systems.setdefault(f"{task_class.name} (priority {priority})", []).append(inside or "the host itself")
    if systems:
        concerned = sorted({system for names in systems.values() for system in names})
        yield NEIGHBOURS.of_host(
            desired.host,
            "On {host}, programs in the classes {_join} have priority over the robotic threads in {_join_}.",
            "Do not play or record sound or video in these systems. rarms does not change the classes.",
            _join=", ".join(sorted(systems)),
            _join_=", ".join(concerned),
        )


def classes_above(request: PlanRequest, desired: Desired, plan: HostPlan) -> Iterator[tuple[str, TaskClass, int]]:
    """Find foreign classes in Medium or High whose threads run above a robotic class of the same system.

    Yields:
        The partition (empty: the host itself), the class, and the priority of its threads.
    """
    lowest: dict[str, int] = {}
    for thread in plan.threads:
        lowest[thread.inside] = min(thread.thread_priority, lowest.get(thread.inside, thread.thread_priority))
    robotic = {(thread.inside, thread.task.lower()) for thread in plan.threads}
    for task in desired.seen.state.tasks:
        is_managed = task.record is not None and task.record.application == request.application
        if is_managed or task.inside not in lowest or (task.inside, task.name.lower()) in robotic:
            continue
        priority = _foreign_priority(task.values)
        if priority is not None and priority > lowest[task.inside]:
            yield task.inside, task, priority


def _foreign_priority(values: Mapping[str, RegistryValue]) -> int | None:
    """Return the priority of a foreign class's threads; None where its values do not say, or in Low."""
    by_name = {name.lower(): value for name, value in values.items()}
    category = by_name.get("scheduling category")
    priority = by_name.get("priority")
    categories = {category.value.lower(): category for category in TaskCategory}
    known = categories.get(str(category.data).lower() if category else "")
    level = priority.data if priority is not None and priority.kind is ValueKind.DWORD else None
    if known is TaskCategory.HIGH:
        return thread_priority(known, 1, 1)
    if known is TaskCategory.MEDIUM and isinstance(level, int):
        return thread_priority(known, level, 1)
    return None


NO_EFFECT = Finding.note("RARMS401", "A limit has no effect")

_REMOVE = "Remove the limit."


def review_limits_without_effect(request: PlanRequest, desired: Desired) -> Iterator[Diagnostic]:
    """Note each limit that another one replaces, that its partition does not get, or that is all of its VPs."""
    system = request.system
    blocks = [each.cpu for each in system.components.values()] + [each.cpu for each in system.partitions.values()]
    if not any(block.limit for block in blocks):
        return  # only then the whole system is worth grouping again
    groups = {group.name: group for group in groups_of(system)}
    for partition in desired.partitions:
        group, processors = groups[partition.name], partition.settings.processors
        for section, name, reason, advice in _without_effect(group, system.hosts[desired.host], processors):
            limit = (system.partitions[name] if section == "partitions" else system.components[name]).cpu.limit
            assert limit is not None, "each has one"
            yield NO_EFFECT.at(
                request.places.value(section, name, "cpu", "limit"),
                'The limit of {limit} of "{name}" has no effect: {reason}.',
                advice,
                address=f"partition/{partition.name}",
                name=name,
                limit=show_amount(limit),
                reason=reason,
            )


def _without_effect(group: Group, host: Host, processors: int) -> Iterator[tuple[str, str, str, str]]:
    """Yield section and name of each such limit, the reason, and the advice."""
    own = group.request.cpu.limit is not None
    limited = [member.name for member in group.members if member.cpu.limit is not None]
    open_members = [member.name for member in group.members if member.cpu.limit is None]
    if own and len(group.members) > 1:
        for name in limited:
            yield "components", name, f"the partition {group.name} has its own limit", _REMOVE
    elif not own and open_members:
        for name in limited:
            reason = f"it shares the partition {group.name} with {list_names(open_members)} without a limit"
            yield "components", name, reason, "Give the partition a limit, or remove this limit."
    if limit_in_manifest(group, host, processors) != OPEN:
        return
    reason = f"the partition {group.name} has {counted(processors, 'VP')} and can use no more than {processors} LP"
    for name in [group.name] if own else limited:
        yield "partitions" if own else "components", name, reason, _REMOVE
