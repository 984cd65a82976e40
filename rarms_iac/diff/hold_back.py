"""Changes that disturb more than is allowed are held back, and with them what rests on them."""

from collections.abc import Sequence
from dataclasses import dataclass

from rarms_iac.diff.claims import NO_CLAIM, claim_of
from rarms_iac.diff.step_context import StepBudget
from rarms_iac.model.changes import Change, Create, Delete, Update
from rarms_iac.model.claims import Claim
from rarms_iac.model.plan import HeldBack
from rarms_iac.model.state import Partition

_Held = dict[int, HeldBack]
"""By the position of the change."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldChanges:
    """The changes that may be done, and those that may not, both by address."""

    allowed: tuple[Change, ...]
    held_back: tuple[HeldBack, ...]


def hold_back(changes: Sequence[Change], budget: StepBudget) -> HeldChanges:
    """Split the changes at the budget's `max_disruption`.

    With a change that is held back goes what rests on it: a partition that would take its name, and growth that needs
    what it would have given back, the least critical first. A partition that stays on another host is not made here.

    Args:
        changes: those of one host, by address.
        budget: what the host can promise, what it promises now, and how much may be disturbed.

    Returns:
        Every change once, on one side or the other, in the given order.
    """
    held_back: _Held = {
        at: HeldBack(
            change=change,
            why=f"--max-disruption {change.disruption.value} allows it",
        )
        for at, change in enumerate(changes)
        if change.disruption.exceeds(budget.max_disruption)
    }
    held_back |= _changes_of_moves(changes, budget)
    while held_back:
        more = {**_changes_without_name(changes, held_back), **_changes_without_capacity(changes, held_back, budget)}
        if not more:
            break
        held_back = {**more, **held_back}
    return HeldChanges(
        allowed=tuple(change for at, change in enumerate(changes) if at not in held_back),
        held_back=tuple(held_back[at] for at in sorted(held_back)),
    )


def _changes_of_moves(changes: Sequence[Change], budget: StepBudget) -> _Held:
    """Return what makes partitions here that would then be on two hosts."""
    return {
        at: HeldBack(change=change, why=f"it is on {budget.remaining[name]}, and this plan does not remove it there")
        for at, change in enumerate(changes)
        if (name := change.address.partition) in budget.remaining
    }


def _changes_without_name(changes: Sequence[Change], held_back: _Held) -> _Held:
    """Move onto a name that its holder, held back, keeps."""
    holders = {_name_before(entry.change): entry.change for entry in held_back.values()}
    return {
        at: HeldBack(change=change, why=f"its name stays with {holders[change.address.partition].address}")
        for at, change in enumerate(changes)
        if at not in held_back
        and isinstance(change, Update)
        and not change.address.task
        and _name_before(change) != change.address.partition
        and change.address.partition in holders
    }


def _name_before(change: Change) -> str:
    match change:
        case Update(before=Partition(mark=mark)) | Delete(before=Partition(mark=mark)) if mark:
            return mark.name
        case _:
            return ""


def _changes_without_capacity(changes: Sequence[Change], held_back: _Held, budget: StepBudget) -> _Held:
    """Growth for which there is no capacity while what is held back keeps what it has."""
    pairs = {at: _claims(change) for at, change in enumerate(changes) if at not in held_back}
    claims = {key: claim_of(partition) for key, partition in budget.managed.items()}
    growing = []
    for at, (before, after) in pairs.items():
        if before.is_less_than(after):
            growing.append(at)
        else:
            claims[_key(changes[at])] = after
    everything = {**claims, **{_key(changes[at]): pairs[at][1] for at in growing}}
    if budget.fits(everything.values()):
        return {}
    why = "it needs what a change that is held back would have given back"
    more: _Held = {}
    for at in sorted(growing, key=lambda at: (-budget.rank(changes[at].address.partition)[0], changes[at].address)):
        claims_then = {**claims, _key(changes[at]): pairs[at][1]}
        if budget.fits(claims_then.values()):
            claims = claims_then
        else:
            more[at] = HeldBack(change=changes[at], why=why)
    return more


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
