"""Drift: who moved, the host or the manifest? The `set` of a mark tells, without other memory (DESIGN section 4)."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum

from rarms_iac.model.changes import RESPONSIVENESS, Address
from rarms_iac.model.state import Partition, Responsiveness, StartAction, State, TaskClass
from rarms_iac.storage.digest import set_of_settings, set_of_values


class DriftKind(StrEnum):
    """What became of a resource since rarms last wrote it."""

    HOST_CHANGED = "host_changed"  # it is not as it was written
    NOT_APPLIED = "not_applied"  # the manifest wants something else than was written
    BOTH = "both"
    MISSING = "missing"  # wanted, and there is nothing of ours: never applied, or taken away again
    REMOVED = "removed"  # rarms left it on the host, and it is gone
    UNUSED = "unused"  # ours, and the manifest no longer wants it; stopped already

    @property
    def is_of_the_host(self) -> bool:
        """Whether somebody changed the host behind rarms' back."""
        return self in {DriftKind.HOST_CHANGED, DriftKind.BOTH, DriftKind.REMOVED}


@dataclass(frozen=True, slots=True, kw_only=True)
class Drifted:
    """A resource that is not as wanted, and why."""

    address: Address
    kind: DriftKind
    says: str


def drift(
    desired: State,
    observed: State,
    application: str,
    unused: frozenset[str] = frozenset(),
    left: frozenset[str] | None = None,
) -> tuple[Drifted, ...]:
    """What drifted, by address. Only what is ours or wanted is looked at; reads, and changes nothing.

    Args:
        desired: what the manifest wants.
        observed: what is there.
        application: whose.
        unused: partitions that the manifest no longer wants.
        left: partitions that the last run left on the host; None where nobody knows.
    """
    found = [
        *_partitions(desired, observed, application, unused, left),
        *_tasks(desired, observed, application, unused),
        *_responsiveness(desired.responsiveness, observed.of(application).responsiveness),
    ]
    return tuple(sorted(found, key=lambda one: one.address))


def _partitions(
    desired: State, observed: State, application: str, unused: frozenset[str], left: frozenset[str] | None
) -> Iterator[Drifted]:
    there = {partition.mark.name: partition for partition in observed.of(application).partitions if partition.mark}
    wanted = {partition.settings.name: partition for partition in desired.partitions}
    for name in sorted({*there, *wanted}):
        address = Address(partition=name, machine=there[name].id if name in there else "")
        kind = _kind(wanted.get(name), there.get(name), is_unused=name in unused)
        if kind is DriftKind.MISSING and left is not None:
            yield _gone(address) if name in left else _not_there(address)
        elif kind is not None:
            yield Drifted(address=address, kind=kind, says=_says(kind))


def _gone(address: Address) -> Drifted:
    return Drifted(address=address, kind=DriftKind.REMOVED, says=_says(DriftKind.REMOVED))


def _not_there(address: Address) -> Drifted:
    says = "the host has nothing of ours under this name: never applied, or taken away again by rarms itself"
    return Drifted(address=address, kind=DriftKind.MISSING, says=says)


def _kind(wanted: Partition | None, there: Partition | None, *, is_unused: bool) -> DriftKind | None:
    if there is None or there.mark is None:
        return DriftKind.MISSING
    if wanted is None or wanted.mark is None:
        return DriftKind.NOT_APPLIED
    host = _set_now(there, by_hand=_runs_by_hand(wanted) and not is_unused) != there.mark.set
    manifest = wanted.mark.set != there.mark.set
    if not host and not manifest and is_unused:
        return DriftKind.UNUSED
    return _of(host=host, manifest=manifest)


def _runs_by_hand(wanted: Partition) -> bool:
    return wanted.settings.start_action is StartAction.NOTHING


def _set_now(there: Partition, *, by_hand: bool) -> str:
    """The digest of what is there. Whether a partition that is started by hand runs counts for nothing."""
    settings = there.settings
    if settings.start_action is StartAction.NOTHING and settings.running and not by_hand:
        return "running"  # no digest: it was written as stopped
    return set_of_settings(replace(settings, running=False) if by_hand else settings)


def _of(*, host: bool, manifest: bool) -> DriftKind | None:
    match host, manifest:
        case True, True:
            return DriftKind.BOTH
        case True, False:
            return DriftKind.HOST_CHANGED
        case False, True:
            return DriftKind.NOT_APPLIED
        case _:
            return None


def _tasks(desired: State, observed: State, application: str, unused: frozenset[str]) -> Iterator[Drifted]:
    kept = {partition.settings.name for partition in desired.partitions} - unused
    there = {
        (task.inside, task.name.lower()): task
        for task in observed.of(application).tasks
        if not task.inside or task.inside in kept
    }
    wanted = {(task.inside, task.name.lower()): task for task in desired.tasks}
    for key in sorted({*there, *wanted}):
        old, new = there.get(key), wanted.get(key)
        named = old or new
        assert named is not None
        address = Address(partition=key[0], task=(new or named).name)
        kind = _kind_in_registry(old, new)
        if kind is not None:
            yield Drifted(address=address, kind=kind, says=_says(kind))


def _responsiveness(wanted: Responsiveness | None, there: Responsiveness | None) -> Iterator[Drifted]:
    kind = _kind_in_registry(there, wanted) if wanted or there else None
    if kind is not None:
        yield Drifted(address=RESPONSIVENESS, kind=kind, says=_says(kind))


def _kind_in_registry(
    there: TaskClass | Responsiveness | None, wanted: TaskClass | Responsiveness | None
) -> DriftKind | None:
    if there is None or there.record is None:
        return DriftKind.MISSING
    host = set_of_values(there.values) != there.record.set
    return _of(host=host, manifest=wanted is None or wanted.record is None or wanted.record.set != there.record.set)


def _says(kind: DriftKind) -> str:
    match kind:
        case DriftKind.HOST_CHANGED:
            return "somebody changed it on the host since rarms wrote it"
        case DriftKind.NOT_APPLIED:
            return "the manifest wants something else than was last applied"
        case DriftKind.BOTH:
            return "somebody changed it on the host, and the manifest wants something else than was last applied"
        case DriftKind.MISSING:
            return "the host has nothing of ours under this name: never applied, or removed by somebody"
        case DriftKind.REMOVED:
            return "rarms left it on the host, and it is gone: somebody removed it, or its mark"
        case DriftKind.UNUSED:
            return "the manifest no longer wants it; it is stopped"
