"""The digests that marks carry, and the values that another tool set and an apply replaced.

A mark has only the digest of the settings that rarms wrote last. If the manifest's values in place of some settings
give that digest, other tools changed these settings. The smallest such set counts; an undo sets them again. Begin at
`was_changed` and `foreign_values`.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

from rarms_iac.model.changes import Address, Change, Update
from rarms_iac.model.facets import LABELS, setting_values, settings_of
from rarms_iac.model.state import (
    Partition,
    PartitionSettings,
    RegistryValue,
    Responsiveness,
    StartAction,
    StoppedBy,
    TaskClass,
)
from rarms_iac.storage.json_text import digest, short
from rarms_iac.texts.plans import setting_text


def set_of_settings(settings: PartitionSettings) -> str:
    """Return 12 hex digits of a partition's wanted settings.

    Whether a partition that does not start by itself runs is its user's affair, so it is not part of the digest; nor is
    secure boot where it is not fixed.

    Args:
        settings: as rarms writes them to a host; secure boot only where the manifest fixes it.

    Returns:
        The `set` of a mark: where the host's settings have another one, they were changed with another tool.
    """
    by_hand = settings.start_action is StartAction.NOTHING
    values = dict(setting_values(settings, settings_of(settings.generation)))
    if by_hand:
        values["running"] = False
    if not settings.secure_boot:
        values.pop("secure_boot", None)
    return short(digest(values))


def was_changed(there: Partition, *, by_hand: bool) -> bool:
    """Tell whether a marked partition is not as rarms wrote it.

    Args:
        by_hand: its user starts it, so whether it runs counts for nothing.
    """
    assert there.mark is not None
    # One that a measurement stops or starts carries its mark while it runs, and keeps it after a kill.
    is_started = there.mark.stopped_by is StoppedBy.USER and there.settings.running
    unfixed = replace(there, settings=replace(there.settings, secure_boot=""))
    digests = {_digest_now(partition, by_hand=by_hand) for partition in (there, unfixed)}
    return is_started or there.mark.set not in digests


def _digest_now(there: Partition, *, by_hand: bool) -> str:
    """Return the digest of what is there.

    Whether a partition that is started by hand runs counts for nothing, nor that rarms itself stopped one.
    """
    settings = there.settings
    if there.mark is not None and there.mark.stopped_by is not StoppedBy.NO_USER:
        settings = replace(settings, running=True)
        by_hand = by_hand or settings.start_action is StartAction.NOTHING
    if settings.start_action is StartAction.NOTHING and settings.running and not by_hand:
        return "running"  # no digest: it was written as stopped
    return set_of_settings(replace(settings, running=False) if by_hand else settings)


def set_of_values(values: Mapping[str, RegistryValue]) -> str:
    """Return 12 hex digits of a task class's values, with their types.

    Args:
        values: the registry values that rarms wrote, with their types.

    Returns:
        The `set` of a record.
    """
    return short(digest({name: [value.kind.value, value.data] for name, value in values.items()}))


_MOST_COMPARED = 8
"""Largest number of different settings whose sets are all compared; of more, all count as changed by others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ForeignValue:
    """A value that rarms had not set, and the value of the manifest that an apply put in its place."""

    address: Address
    name: str  # of the setting, or of the registry value
    foreign: str
    applied: str


def foreign_values(changes: Iterable[Change]) -> tuple[ForeignValue, ...]:
    """List the values that these changes replace and that rarms had not set.

    Args:
        changes: of one host, in order.

    Returns:
        In the same order; nothing for a resource without a mark or record, or one that is as rarms wrote it.
    """
    return tuple(value for change in changes if isinstance(change, Update) for value in _of_update(change))


def _of_update(change: Update) -> Iterator[ForeignValue]:
    match change.before, change.after:
        case Partition() as before, Partition() as after:
            for field in _foreign_fields(before, after):
                texts = setting_text(field, before.settings), setting_text(field, after.settings)
                yield ForeignValue(address=change.address, name=LABELS[field], foreign=texts[0], applied=texts[1])
        case (TaskClass() | Responsiveness()) as before, (TaskClass() | Responsiveness()) as after:
            if before.record is not None and set_of_values(before.values) != before.record.set:
                yield from _foreign_registry(change.address, before.values, after.values)
        case _:
            pass


def _foreign_fields(before: Partition, after: Partition) -> tuple[str, ...]:
    if before.mark is None or not _is_changed(before):
        return ()
    old, new = before.settings, after.settings
    differing = [field for field in LABELS if getattr(old, field) != getattr(new, field)]
    sizes = range(1, len(differing)) if len(differing) <= _MOST_COMPARED else ()
    for fields in (fields for size in sizes for fields in combinations(differing, size)):
        written = replace(old, **{field: getattr(new, field) for field in fields})
        if not _is_changed(replace(before, settings=written)):
            return fields
    return tuple(differing)


def _is_changed(there: Partition) -> bool:
    return was_changed(there, by_hand=there.settings.start_action is StartAction.NOTHING)


def _foreign_registry(
    address: Address, before: Mapping[str, RegistryValue], after: Mapping[str, RegistryValue]
) -> Iterator[ForeignValue]:
    for name in sorted({*before, *after}):
        old, new = (_typed(values.get(name)) for values in (before, after))
        if old != new:
            yield ForeignValue(address=address, name=name, foreign=old, applied=new)


def _typed(value: RegistryValue | None) -> str:
    return "no value" if value is None else f"{value.data} ({value.kind.value})"
