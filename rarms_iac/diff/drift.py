"""Drift: was the host changed, or the manifest?

The `set` of a mark shows changes since the last apply. Changes since a plan was made are shown by a digest of every
part that the plan uses; nothing that moves by itself is in them: no load, no uptime, no assigned memory.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

from rarms_iac.diff.readings import partition_readings, task_readings
from rarms_iac.model.changes import RESPONSIVENESS, Address, Adopt, Change, Create, Delete, Release
from rarms_iac.model.facets import Readings, with_values
from rarms_iac.model.journal import Closing, Journal, RunKind, ScriptRun, open_starts
from rarms_iac.model.operations import Set
from rarms_iac.model.state import HostFacts, Partition, Responsiveness, StartAction, State, StoppedBy, TaskClass
from rarms_iac.storage.json_text import digest, short
from rarms_iac.storage.marks import set_of_values, was_changed


class DriftKind(StrEnum):
    """The difference of a resource from what rarms last wrote, or from the manifest."""

    HOST_CHANGED = "host_changed"  # it is not as it was written
    NOT_APPLIED = "not_applied"  # the manifest wants something else than was written
    BOTH = "both"
    MISSING = "missing"  # wanted, and there is nothing of ours: never applied, or taken away again
    UNMANAGED = "unmanaged"  # wanted, and a machine of its name does not carry our mark
    REMOVED = "removed"  # rarms left it on the host, and it is gone
    UNUSED = "unused"  # ours, and the manifest no longer wants it; stopped already

    @property
    def is_of_the_host(self) -> bool:
        """Whether the host was changed with other tools."""
        return self in {DriftKind.HOST_CHANGED, DriftKind.BOTH, DriftKind.REMOVED}


_MESSAGES = {
    DriftKind.HOST_CHANGED: "it was changed on the host since rarms wrote it",
    DriftKind.NOT_APPLIED: "the manifest changed after the last apply",
    DriftKind.BOTH: "it was changed on the host, and the manifest changed after the last apply",
    DriftKind.MISSING: "it is not on the host: not applied yet, or removed by another tool",
    DriftKind.UNMANAGED: "the host has a machine of this name without the mark of rarms",
    DriftKind.REMOVED: "another tool removed it or its mark of rarms",
    DriftKind.UNUSED: "it is no longer in the manifest; it is stopped",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ResourceDrift:
    """A resource that is not as wanted, and why."""

    address: Address
    drift: DriftKind
    message: str
    components: tuple[str, ...] = ()  # of the partition, the most critical first; none where the layout has no such one
    change: Change | None = None  # that would bring it back, where that is known


def drift(
    desired: State,
    observed: State,
    application: str,
    unused: frozenset[str] = frozenset(),
    last_run: frozenset[str] | None = None,
) -> tuple[ResourceDrift, ...]:
    """Find what drifted on a host. Only what is managed or wanted is looked at.

    Args:
        application: the application whose marks and records count.
        unused: partitions that the manifest no longer wants.
        last_run: partitions that were on the host when its last run ended; None where that is unknown.

    Returns:
        One entry a resource that is not as wanted, by address.
    """
    drifts = [
        *_partitions(desired, observed, application, unused, last_run),
        *_tasks(desired, observed, application, unused),
        *_responsiveness(desired.responsiveness, observed.of(application).responsiveness),
    ]
    return tuple(sorted(drifts, key=lambda drift: drift.address))


def drift_of_marks(observed: State, application: str, last_run: frozenset[str] | None) -> tuple[ResourceDrift, ...]:
    """Find what was changed on a host, by what rarms last wrote there: needs neither manifest nor data logs.

    Args:
        application: the application whose marks and records count.
        last_run: partitions that were on the host when its last run ended; None where that is unknown.

    Returns:
        One entry a resource that was changed or removed, by address.
    """
    own = observed.of(application)
    records: list[tuple[Address, TaskClass | Responsiveness]] = [
        (Address(partition=task.inside, task=task.name), task) for task in own.tasks
    ]
    if own.responsiveness is not None:
        records.append((RESPONSIVENESS, own.responsiveness))
    changed = [
        *(
            Address(partition=there.mark.name, machine=there.id)
            for there in own.partitions
            if there.mark is not None and was_changed(there, by_hand=there.settings.start_action is StartAction.NOTHING)
        ),
        *(address for address, there in records if there.record and set_of_values(there.values) != there.record.set),
    ]
    present = {there.mark.name for there in own.partitions if there.mark is not None}
    drifts = [
        *(_of_kind(address, DriftKind.HOST_CHANGED) for address in changed),
        *(_of_kind(Address(partition=name), DriftKind.REMOVED) for name in (last_run or frozenset()) - present),
    ]
    return tuple(sorted(drifts, key=lambda drift: drift.address))


def _partitions(
    desired: State, observed: State, application: str, unused: frozenset[str], last_run: frozenset[str] | None
) -> Iterator[ResourceDrift]:
    there = {partition.mark.name: partition for partition in observed.of(application).partitions if partition.mark}
    wanted = {partition.settings.name: partition for partition in desired.partitions}
    others = {partition.settings.name for partition in observed.partitions if partition.mark is None}
    for name in sorted({*there, *wanted}):
        address = Address(partition=name, machine=there[name].id if name in there else "")
        kind = _kind(wanted.get(name), there.get(name), is_unused=name in unused)
        if kind is DriftKind.MISSING and name in (last_run or frozenset()):
            yield _of_kind(address, DriftKind.REMOVED)
        elif kind is DriftKind.MISSING and name in others:
            yield _of_kind(address, DriftKind.UNMANAGED)
        elif kind is DriftKind.MISSING and last_run is not None:
            yield _of_kind(address, kind, "it is not on the host: not applied yet, or removed by rarms")
        elif kind is DriftKind.NOT_APPLIED and name in there and _is_left_by_measurement(there[name]):
            message = "`rarms measure` stopped it and was interrupted; `rarms start` starts it"
            if there[name].settings.running:
                message = (
                    "it is running, but it is marked as stopped by `rarms measure`; `rarms start` corrects the mark"
                )
            yield _of_kind(address, kind, message)
        elif kind is not None:
            yield _of_kind(address, kind)


def _of_kind(address: Address, kind: DriftKind, message: str = "") -> ResourceDrift:
    return ResourceDrift(address=address, drift=kind, message=message or _MESSAGES[kind])


def _kind(wanted: Partition | None, there: Partition | None, *, is_unused: bool) -> DriftKind | None:
    if there is None or there.mark is None:
        return DriftKind.MISSING
    if wanted is None or wanted.mark is None:
        return DriftKind.NOT_APPLIED
    host = was_changed(there, by_hand=wanted.settings.start_action is StartAction.NOTHING and not is_unused)
    manifest = wanted.mark.set != there.mark.set or wanted.mark.protected != there.mark.protected
    manifest = manifest or _is_left_by_measurement(there)
    if not host and not manifest and is_unused:
        return DriftKind.UNUSED
    return _combine(host=host, manifest=manifest)


def _is_left_by_measurement(there: Partition) -> bool:
    """Return whether a measurement stopped the machine: apart from that, it is wanted running."""
    return there.mark is not None and there.mark.stopped_by is StoppedBy.MEASUREMENT


def _combine(*, host: bool, manifest: bool) -> DriftKind | None:
    match host, manifest:
        case True, True:
            return DriftKind.BOTH
        case True, False:
            return DriftKind.HOST_CHANGED
        case False, True:
            return DriftKind.NOT_APPLIED
        case _:
            return None


def _tasks(desired: State, observed: State, application: str, unused: frozenset[str]) -> Iterator[ResourceDrift]:
    used = {partition.settings.name for partition in desired.partitions} - unused
    there = {
        (task.inside, task.name.lower()): task
        for task in observed.of(application).tasks
        if not task.inside or task.inside in used
    }
    wanted = {(task.inside, task.name.lower()): task for task in desired.tasks}
    for key in sorted({*there, *wanted}):
        old, new = there.get(key), wanted.get(key)
        named = old or new
        assert named is not None
        address = Address(partition=key[0], task=(new or named).name)
        kind = _kind_in_registry(old, new)
        if kind is not None:
            yield _of_kind(address, kind)


def _responsiveness(wanted: Responsiveness | None, there: Responsiveness | None) -> Iterator[ResourceDrift]:
    kind = _kind_in_registry(there, wanted) if wanted or there else None
    if kind is not None:
        yield _of_kind(RESPONSIVENESS, kind)


def _kind_in_registry(
    there: TaskClass | Responsiveness | None, wanted: TaskClass | Responsiveness | None
) -> DriftKind | None:
    if there is None or there.record is None:
        return DriftKind.MISSING
    host = set_of_values(there.values) != there.record.set
    return _combine(
        host=host, manifest=wanted is None or wanted.record is None or wanted.record.set != there.record.set
    )


PARTITION_PREFIX = "partition/"
"""What the name of a partition's digest begins with."""


def partitions_after_last_run(journal: Journal | ScriptRun | None, application: str) -> frozenset[str] | None:
    """Return the partitions that were on the host when its last run ended.

    A partition that is missing now was removed with another tool.

    The plan's digests name what was there before it. An undo brings that back, except for what the plan removed.

    Args:
        journal: the last run on the host; None: there was none.
        application: the application whose partitions are asked for.

    Returns:
        Their names; None where that is not known.
    """
    if journal is None:
        return frozenset()
    started = journal.started
    if not isinstance(journal, Journal) or started.application != application:
        return None
    if journal.closed is None or journal.closed.closing is not Closing.DONE:
        return None
    plan = journal.started.host_plan
    before = {name.removeprefix(PARTITION_PREFIX) for name in plan.digests if name.startswith(PARTITION_PREFIX)}
    changes = [change for change in plan.changes if change.address.partition and not change.address.task]
    made = {change.address.partition for change in changes if isinstance(change, Create | Adopt)}
    gone = {change.address.partition for change in changes if isinstance(change, Delete | Release)}
    if started.run is RunKind.UNDO:
        return frozenset(before - made - gone)
    return frozenset((before | made) - gone)


def without_unfinished(
    drifts: Iterable[ResourceDrift], run: Journal | ScriptRun | None, application: str
) -> tuple[ResourceDrift, ...]:
    """Tell what an unfinished run has yet to do as not applied: no other tool changed or removed that.

    Args:
        run: the last one there; None: there was none. What a script changes is not known: all counts.

    Returns:
        As many, in the same order.
    """
    if run is None or not run.unfinished or run.started.application != application:
        return tuple(drifts)
    changes = run.started.host_plan.changes if isinstance(run, Journal) else None
    names = None if changes is None else {change.address.in_short for change in changes}
    return tuple(
        _of_kind(drift.address, DriftKind.NOT_APPLIED, "its run is unfinished")
        if drift.drift is not DriftKind.UNUSED and (names is None or drift.address.in_short in names)
        else drift
        for drift in drifts
    )


def lasting_settings(run: Journal | ScriptRun | None) -> Mapping[str, Readings]:
    """Return the partitions that have more for their start now, with the settings that they have afterwards.

    Args:
        run: the last one on a host; of a script it is not known.
    """
    steps = open_starts(run) if isinstance(run, Journal) else ()
    return {step.address.partition: step.operation.after for _, step in steps if isinstance(step.operation, Set)}


def with_lasting_settings(state: State, lasting: Mapping[str, Readings]) -> State:
    """Return a host as it is once starts are over: what partitions have for their starts is not drift.

    Args:
        lasting: as of `lasting_settings`.
    """
    partitions = (
        replace(each, settings=with_values(each.settings, lasting.get(each.mark.name, {}))) if each.mark else each
        for each in state.partitions
    )
    return replace(state, partitions=tuple(partitions))


def part_digests(state: State, application: str) -> Mapping[str, str]:
    """Digest each part of the state that a plan uses.

    Args:
        application: the application that the plan belongs to; machines of others count only with what they claim.

    Returns:
        12 hex digits by what people call the part: facts, every setting of managed partitions, claims of other
        machines, task classes with types, SystemResponsiveness, and the application's serial.
    """
    parts: dict[str, object] = {
        "the host itself": _facts(state.facts),
        "the count of applies": state.serials.get(application, 0),
    }
    for partition in state.partitions:
        if partition.mark is not None and partition.mark.application == application:
            attached = sorted(disk.path for disk in state.disks if disk.machine == partition.id)
            parts[f"{PARTITION_PREFIX}{partition.mark.name}"] = {
                **partition_readings(partition),
                "disks": attached,
                "takes": partition.claim.processors,
            }
        else:
            parts[f"machine {partition.settings.name} ({partition.id})"] = _claims_on_host(partition)
    guests: dict[str, dict[str, object]] = {}
    for task in state.tasks:
        if task.inside:
            # One digest a guest: there are eight classes in each, and hosts with hundreds of guests.
            guests.setdefault(_guest_title(task), {})[task.name] = dict(task_readings(task))
        else:
            parts[f"task/{task.name}"] = dict(task_readings(task))
    parts.update(guests)
    if state.responsiveness is not None:
        parts[str(RESPONSIVENESS)] = dict(task_readings(state.responsiveness))
    return {name: short(digest(part)) for name, part in parts.items()}


def moved_parts(before: Mapping[str, str], after: Mapping[str, str]) -> tuple[str, ...]:
    """Compare two digests of a host.

    Args:
        before: by part of the host, as `part_digests` made them when the plan was made.
        after: the same of the host as it is now.

    Returns:
        What is new, gone or changed, in words, by name; empty where the host is as it was.
    """
    gone = (f"{name} is gone" for name in before.keys() - after.keys())
    new = (f"{name} is new" for name in after.keys() - before.keys())
    changed = (f"{name} has changed" for name in before.keys() & after.keys() if before[name] != after[name])
    return tuple(sorted([*gone, *new, *changed]))


def _facts(facts: HostFacts) -> dict[str, object]:
    return {
        "id": facts.id,
        "computer": facts.computer_name,
        "build": facts.os_build,
        "processors": facts.logical_processors,
        "smt": facts.smt,
        "scheduler": facts.scheduler.value,
        "memory": facts.memory,
        "rights": facts.rights.value,
    }


def _claims_on_host(partition: Partition) -> dict[str, object]:
    settings = partition.settings
    return {
        "claims": partition.claims_resources,
        "processors": settings.processors,
        "takes": partition.claim.processors,
        "reserve": settings.reserve,
        "limit": settings.limit,
        "memory": settings.memory,
    }


def _guest_title(task: TaskClass) -> str:
    guest = f"the list of task classes inside partition/{task.inside}"
    return f"{guest} (machine {task.machine})" if task.machine else guest
