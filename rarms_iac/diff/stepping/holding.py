"""Changes that disturb more than is allowed are held back, and with them what rests on them (DESIGN section 4)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rarms_iac.diff.claims import NO_CLAIM, claim_of, grows
from rarms_iac.diff.stepping.order import Room
from rarms_iac.model.capacity import fits
from rarms_iac.model.changes import Change, Create, Delete, Update
from rarms_iac.model.plan import Claim, HeldBack
from rarms_iac.model.state import Partition


@dataclass(frozen=True, slots=True, kw_only=True)
class Held:
    """What may be done, and what may not, both by address."""

    kept: tuple[Change, ...]
    held: tuple[HeldBack, ...]


def hold_back(changes: Sequence[Change], room: Room) -> Held:
    """Split the changes at the room's `max_disruption`.

    With a change that is held back goes what rests on it: a partition that would take its name, and growth that needs
    what it would have given back, the least critical first.
    """
    held = {
        at: HeldBack(change=change, why=_too_much(change, room))
        for at, change in enumerate(changes)
        if change.disruption.exceeds(room.max_disruption)
    }
    while held:
        more = {**_without_name(changes, held), **_without_room(changes, held, room)}
        if not more:
            break
        held = {**more, **held}
    return Held(
        kept=tuple(change for at, change in enumerate(changes) if at not in held),
        held=tuple(held[at] for at in sorted(held)),
    )


def _too_much(change: Change, room: Room) -> str:
    return f"it is {change.disruption.value}, and no more than {room.max_disruption.value} is allowed"


def _without_name(changes: Sequence[Change], held: dict[int, HeldBack]) -> dict[int, HeldBack]:
    """Moves onto a name that its holder, held back, keeps."""
    kept_names = {_name_before(one.change): one.change for one in held.values()} | {}
    return {
        at: HeldBack(change=change, why=f"its name stays with {kept_names[change.address.partition].address}")
        for at, change in enumerate(changes)
        if at not in held
        and isinstance(change, Update)
        and not change.address.task
        and _name_before(change) != change.address.partition
        and change.address.partition in kept_names
    }


def _name_before(change: Change) -> str:
    match change:
        case Update(before=Partition(mark=mark)) | Delete(before=Partition(mark=mark)) if mark:
            return mark.name
        case _:
            return ""


def _without_room(changes: Sequence[Change], held: dict[int, HeldBack], room: Room) -> dict[int, HeldBack]:
    """Growth for which there is no room while what is held back keeps what it has."""
    pairs = {at: _claims(change) for at, change in enumerate(changes) if at not in held}
    standing = {key: claim_of(partition) for key, partition in room.ours.items()}
    growing = []
    for at, (before, after) in pairs.items():
        if grows(before, after):
            growing.append(at)
        else:
            standing[_key(changes[at])] = after
    everything = {**standing, **{_key(changes[at]): pairs[at][1] for at in growing}}
    if _fit(room, everything.values()):
        return {}
    stay: dict[int, HeldBack] = {}
    for at in sorted(growing, key=lambda one: (-_criticality(changes[one], room), changes[one].address)):
        trial = {**standing, _key(changes[at]): pairs[at][1]}
        if _fit(room, trial.values()):
            standing = trial
        else:
            stay[at] = HeldBack(
                change=changes[at], why="it needs what a change that is held back would have given back"
            )
    return stay


def _fit(room: Room, claims: Iterable[Claim]) -> bool:
    return fits(room.capacity, (*room.foreign, *claims))


def _criticality(change: Change, room: Room) -> int:
    return room.criticality.get(change.address.partition, 0)


def _key(change: Change) -> str:
    return change.address.machine if change.address.machine and not change.address.task else f"name {change.address}"


def _claims(change: Change) -> tuple[Claim, Claim]:
    match change:
        case Create(after=Partition() as after):
            return NO_CLAIM, claim_of(after)
        case Update(before=Partition() as before, after=Partition() as after):
            return claim_of(before), claim_of(after)
        case Delete(before=Partition() as before):
            return claim_of(before), NO_CLAIM
        case _:
            return NO_CLAIM, NO_CLAIM
