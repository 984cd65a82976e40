"""Values that another tool set and that an apply replaced; an undo sets them again.

A mark has only the digest of the settings that rarms wrote last. If the manifest's values in place of some settings
give that digest, other tools changed these settings. The smallest such set counts. Begin at `foreign_values`.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

from rarms_iac.model.changes import Address, Change, Update
from rarms_iac.model.setting_texts import LABELS, setting_text
from rarms_iac.model.state import Partition, RegistryValue, Responsiveness, StartAction, TaskClass
from rarms_iac.storage.mark_digests import set_of_values, was_changed

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
