"""Disruption: whether a change stops a partition, by its settings and by what the host can do live (windows.md 3).

Changes that disturb more than is allowed are held back, and with them those that depend on them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil, floor

from rarms_iac.diff.step_context import NO_CLAIM, StepContext, claim_of
from rarms_iac.model.changes import Change, Create, Delete, Update
from rarms_iac.model.claims import Claim, load_of
from rarms_iac.model.facets import FACETS, WHILE_OFF, Facet, differing
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.plan import HeldBack
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.state import Partition, PartitionSettings, RunState, settings_at_start
from rarms_iac.model.system import GRACE, Disruption
from rarms_iac.texts.quantities import show_lp_percent

WINDOWS_10 = 10240
SERVER_2016 = 14393
"""The builds from which the memory of a running static-memory machine may change, on host and guest alike."""


def grace_ms(graces: Mapping[str, Milliseconds], partition: str) -> int:
    """Return the grace of a partition's guest to shut down.

    Args:
        graces: by partition, in ms, as the manifest has them.

    Returns:
        Whole milliseconds, rounded up; the default where the manifest does not know the partition.
    """
    return ceil(graces.get(partition, GRACE))


def changed_facets(before: PartitionSettings, after: PartitionSettings) -> tuple[Facet, ...]:
    """Return the facets of which a setting differs, in their order."""
    return tuple(facet for facet in FACETS if differing(facet, before, after))


def needs_off(before: Partition, after: PartitionSettings, context: StepContext) -> bool:
    """Tell whether a setting changes for which the machine must be off.

    On Linux there is none: a control group takes every value while its processes run. A running machine's memory
    changes live where it is static and both Windows are new enough (windows.md 3).

    Args:
        context: the host's provider and version, and the guest's.

    Returns:
        Whether it must be off; the answer does not depend on whether it runs.
    """
    if context.seen.facts.provider is ProviderKind.LINUX:
        return False
    changed = {name for facet in FACETS for name in differing(facet, before.settings, after)}
    if changed & WHILE_OFF:
        return True
    return bool(why_memory_needs_off(before, after, context))


def why_memory_needs_off(before: Partition, after: PartitionSettings, context: StepContext) -> str:
    """Tell why a change of memory needs the machine off (windows.md 3).

    Args:
        context: the host's version, and the guest's.

    Returns:
        The reason as part of a sentence; empty where memory changes live, or stays.
    """
    if not differing(Facet.MEMORY, before.settings, after):
        return ""
    host_since = WINDOWS_10 if context.seen.facts.client else SERVER_2016
    guest_build = context.guest_builds.get(before.id, 0)
    if before.settings.dynamic_memory or after.dynamic_memory:
        return "its memory is or was dynamic"
    if context.seen.facts.os_build < host_since:
        return f"the host has Windows build {context.seen.facts.os_build}; {host_since} is needed"
    if not guest_build:
        return "its guest does not report its Windows build, and `guest.windows_build` is not set"
    if guest_build < WINDOWS_10:
        return f"its guest has Windows build {guest_build}; {WINDOWS_10} is needed"
    return ""


def stops(before: Partition, after: PartitionSettings, context: StepContext) -> bool:
    """Tell whether the change stops the partition, for good or for a while.

    Args:
        context: the host's provider and version.

    Returns:
        False where it does not run now.
    """
    running = before.settings.running
    return running and (not after.running or needs_off(before, after, context))


def disruption_of_update(before: Partition, after: PartitionSettings, context: StepContext) -> Disruption:
    """Return the disruption of a partition's change: removal, a stop, or live.

    Args:
        after: the settings that it is to have; another generation means that it is made again.
        context: which settings of this host change live.

    Returns:
        The least disruption with which this host can make the change.
    """
    if before.settings.generation != after.generation:
        return Disruption.REMOVAL  # never after creation: it is made again (windows.md 3)
    return Disruption.PARTITION_STOP if stops(before, after, context) else Disruption.LIVE


def disruption_of_task(inside: str) -> Disruption:
    """Return the disruption of a task class's change.

    It takes effect when its Windows starts again (windows.md 6.3), and rarms restarts none for it.

    Args:
        inside: the partition whose guest it is in; empty: the host itself.

    Returns:
        When it takes effect: at the next start of the guest, or of the host.
    """
    return Disruption.PARTITION_STOP if inside else Disruption.HOST_RESTART


def can_change_now(before: Partition, after: PartitionSettings, context: StepContext) -> bool:
    """Return whether rarms can do the change in the machine's state: off, running, or saved and live.

    What a saved machine is given, it gets once it runs: so it must be wanted running.

    Args:
        context: which settings of this host change live.

    Returns:
        False: nothing may be planned before the machine is off or runs (`not_at_rest`).
    """
    off_needed = needs_off(before, after, context)
    match before.state:
        case RunState.OFF | RunState.RUNNING:
            return True
        case RunState.SAVED:
            gets = any(FACETS[facet].capacity for facet in changed_facets(before.settings, after))
            return not off_needed and (after.running or not gets)
        case RunState.PAUSED | RunState.BUSY | RunState.CRITICAL:
            return not off_needed and after.running == before.settings.running


_Held = dict[int, HeldBack]
"""By the position of the change."""


def hold_back(changes: Sequence[Change], context: StepContext) -> tuple[tuple[Change, ...], tuple[HeldBack, ...]]:
    """Split the changes at the context's `max_disruption`.

    With a change that is held back goes what depends on it: a partition that would take its name, and growth that needs
    what it would have given back, the least critical first. A partition that is, or may be, on another host is
    not made here.

    Args:
        changes: those of one host, by address.
        context: what the host can promise, what it promises now, and how much may be disturbed.

    Returns:
        The changes that may be done, and those that may not, each in the given order.
    """
    held_back: _Held = {
        at: HeldBack(
            change=change,
            why=f"--max-disruption {change.disruption.value} allows it",
        )
        for at, change in enumerate(changes)
        if change.disruption.exceeds(context.max_disruption)
    }
    held_back |= _changes_of_moves(changes, context)
    while True:
        # What is held back keeps what it has, so each round may leave less room for starts.
        more = _starts_without_room(changes, held_back, context)
        if held_back:
            more |= _changes_without_capacity(changes, held_back, context) | _changes_without_name(changes, held_back)
        if not more:
            break
        held_back = {**more, **held_back}
    allowed = tuple(change for at, change in enumerate(changes) if at not in held_back)
    return allowed, tuple(held_back[at] for at in sorted(held_back))


def _changes_of_moves(changes: Sequence[Change], context: StepContext) -> _Held:
    """Find changes that make a partition which is, or may be, on another host."""
    return {
        at: HeldBack(change=change, why=context.remaining[name])
        for at, change in enumerate(changes)
        if (name := change.address.partition) in context.remaining
    }


def _starts_without_room(changes: Sequence[Change], held_back: _Held, context: StepContext) -> _Held:
    """Find changes that start a partition whose larger reservation for its start the host does not have free.

    What counts is what all partitions have in the end: so each of them can start again at any time later.
    """
    claims = {partition.id: claim_of(partition) for partition in context.seen.own}
    claims |= {_key(change): _claims(change)[1] for at, change in enumerate(changes) if at not in held_back}
    found: _Held = {}
    for at, change in enumerate(changes):
        starts = None if at in held_back else _claim_at_start(change, context)
        others = [claim for key, claim in claims.items() if key != _key(change)]
        if starts is not None and not context.fits((*others, starts)):
            free = 100 * context.seen.capacity.processors - load_of((*context.seen.claims, *others)).percent
            needs = show_lp_percent(starts.percent)
            why = f"its start needs {needs}, and the host has {show_lp_percent(max(0, floor(free)))} free"
            found[at] = HeldBack(change=change, why=why)
    return found


def _claim_at_start(change: Change, context: StepContext) -> Claim | None:
    """Return what a change claims for the time of a start; None where it starts nothing, or with no more than later."""
    match change:
        case Create(after=Partition() as after):
            starts = after.settings.running
        case Update(before=Partition() as before, after=Partition() as after):
            starts = after.settings.running and (not before.settings.running or stops(before, after.settings, context))
        case _:
            return None
    larger = settings_at_start(after.settings, context.starting.get(change.address.partition)) if starts else None
    return None if larger is None else replace(after, settings=larger).claim


def _changes_without_name(changes: Sequence[Change], held_back: _Held) -> _Held:
    """Find changes onto a name that its holder, which is held back, keeps."""
    holders = {_name_before(entry.change): entry.change for entry in held_back.values()}
    return {
        at: HeldBack(change=change, why=f"its name is used by {holders[change.address.partition].address}")
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


def _changes_without_capacity(changes: Sequence[Change], held_back: _Held, context: StepContext) -> _Held:
    """Find growth without capacity, while changes that are held back keep what they have."""
    pairs = {at: _claims(change) for at, change in enumerate(changes) if at not in held_back}
    claims = {partition.id: claim_of(partition) for partition in context.seen.own}
    growing = []
    for at, (before, after) in pairs.items():
        if before.is_less_than(after):
            growing.append(at)
        else:
            claims[_key(changes[at])] = after
    everything = {**claims, **{_key(changes[at]): pairs[at][1] for at in growing}}
    if context.fits(everything.values()):
        return {}
    why = "it needs capacity that a held-back change would free"
    more: _Held = {}
    for at in sorted(growing, key=lambda at: (-context.rank(changes[at].address.partition)[0], changes[at].address)):
        claims_then = {**claims, _key(changes[at]): pairs[at][1]}
        if context.fits(claims_then.values()):
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
