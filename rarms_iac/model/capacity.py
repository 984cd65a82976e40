"""Whether promises fit a host: processors in sum, virtual processors onto logical ones, memory."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import accumulate
from math import floor

from rarms_iac.model.claims import ANY_THREAD, WHOLE, Claim, CoreSharing, DeadlineClaim, load_of
from rarms_iac.model.host import SERVER_2019, Host, ProviderKind, SchedulerType
from rarms_iac.model.quantities import Bytes, LogicalProcessors, in_processors
from rarms_iac.model.state import HostFacts, Partition, State

SEARCH_NODES = 5_000
"""How far the exact packing looks before it says no: a count, not a time, so that equal inputs have equal answers."""

SEARCHED_UP_TO = 500
"""Virtual processors that it looks at: the stack grows by a frame each, and first fit is good at many small ones."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Capacity:
    """The processors and memory that a host can promise: all of it less what is kept for itself."""

    logical_processors: int
    processors: LogicalProcessors  # that may be promised; at most the logical ones
    memory: Bytes  # that may be promised
    sharing: CoreSharing = ANY_THREAD  # of a machine that is made there

    @property
    def cores(self) -> int:
        """What virtual processors are laid onto: what two machines never have at once."""
        return self.logical_processors // self.sharing.threads


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedCapacity(Capacity):
    """A capacity with what else refuses a layout: what a script can place, and the deadlines a kernel admits."""

    by_script: bool = False  # a script gives the promises, which places the largest reserve first
    deadline: int | None = None  # per cent of one logical processor, in all; None: no deadline counts

    def admits(self, claims: Iterable[Claim]) -> bool:
        """Return whether the kernel admits the deadlines among these claims.

        Returns:
            True also where no deadline counts.
        """
        wanted = sum(claim.deadline for claim in claims if isinstance(claim, DeadlineClaim))
        return self.deadline is None or wanted <= self.deadline


SMT_THREADS = 2


def core_sharing(facts: HostFacts, threads_per_core: int | None = None) -> CoreSharing:
    """Work out how a machine takes cores.

    Under the core scheduler with SMT, one that has no SMT itself leaves the other thread of each of its cores idle. A
    server that does not tell its scheduler is taken to have the one that its Windows comes with (windows.md 2).

    Args:
        threads_per_core: the machine's HwThreadCountPerCore, 0: as the host; None: it is made now.

    Returns:
        How its virtual processors take logical ones.
    """
    is_default = facts.os_build >= SERVER_2019
    is_core = facts.scheduler is SchedulerType.CORE
    is_core |= facts.scheduler is SchedulerType.UNKNOWN and is_default and not facts.client
    if not (facts.smt and is_core):
        return ANY_THREAD
    used = int(not is_default) if threads_per_core is None else threads_per_core
    return CoreSharing(threads=SMT_THREADS, used=min(used or SMT_THREADS, SMT_THREADS))


def foreign_claims(state: State, application: str) -> tuple[Claim, ...]:
    """Return the claims of `foreign_claimants`, in their order."""
    return tuple(machine.claim for machine in foreign_claimants(state, application))


def foreign_claimants(state: State, application: str) -> tuple[Partition, ...]:
    """List the machines of others that run, start, or start by themselves.

    Args:
        application: whose own machines do not count.
    """
    return tuple(
        partition
        for partition in state.partitions
        if partition.claims_resources and (partition.mark is None or partition.mark.application != application)
    )


def capacity_of(host: Host, facts: HostFacts) -> Capacity:
    """Return the capacity of a host by the manifest, or by what was observed where that is less.

    Returns:
        What may be promised, `keep_for_host` taken off; nothing is below 0.
    """
    processors, memory = min(host.logical_processors, facts.logical_processors), min(int(host.memory), facts.memory)
    withheld = in_processors(host.keep_for_host.processor, host.logical_processors)
    return Capacity(
        logical_processors=processors,
        processors=LogicalProcessors(max(Fraction(0), processors - withheld)),
        memory=Bytes(max(0, memory - host.keep_for_host.memory)),
        sharing=core_sharing(facts),
    )


def shared_processors(host: Host, logical_processors: int) -> LogicalProcessors:
    """Return the LPs that all partitions of a host can use together.

    On Linux a limit keeps `keep_for_host` from them, also while nothing else uses it, in whole per cent of an LP. On
    other hosts they use what the host's own system leaves idle.
    """
    withheld = in_processors(host.keep_for_host.processor, logical_processors)
    if host.provider is not ProviderKind.LINUX or not withheld:
        return LogicalProcessors(Fraction(logical_processors))
    return LogicalProcessors(Fraction(max(1, floor(100 * (logical_processors - withheld))), 100))


def fits(capacity: Capacity, claims: Iterable[Claim]) -> bool:
    """Return whether the host can keep all promises at once; False if unknown, as of `decide_fit`.

    Args:
        claims: all promises, those to unmanaged machines included.

    Returns:
        True: it is known to hold.
    """
    return decide_fit(capacity, claims) is True


@dataclass(slots=True)
class Effort:
    """Steps that searches for places may still take together: a count, so that equal inputs have equal answers."""

    steps: int


def decide_fit(capacity: Capacity, claims: Iterable[Claim], effort: Effort | None = None) -> bool | None:
    """Return whether the host can keep all promises at once; None: the search for places gave up.

    What is kept for the host counts against the sum only: its own virtual processors lie on every logical one, so it
    can use what is left on each (windows.md 2, minroot).

    Args:
        claims: all promises, those to unmanaged machines included.
        effort: steps that several searches share; None: this one has its own.

    Returns:
        False where sum, memory, or the places of virtual processors are too few.
    """
    together = tuple(claims)
    load = load_of(together)
    if load.percent > WHOLE * capacity.processors or load.memory > capacity.memory:
        return False
    if isinstance(capacity, CheckedCapacity) and not capacity.admits(together):
        return False
    return decide_packing(together, capacity, effort)


def packs(claims: Iterable[Claim], capacity: Capacity) -> bool:
    """Return whether each reserved virtual processor finds an LP, or a core, with room (windows.md 1.2).

    Where the exact search gives up, the answer is no: a promise that cannot be shown to hold is not made.

    Args:
        claims: all promises, those to unmanaged machines included.

    Returns:
        True: it is known to pack; sums and memory are not looked at.
    """
    return decide_packing(claims, capacity) is True


def decide_packing(claims: Iterable[Claim], capacity: Capacity, effort: Effort | None = None) -> bool | None:
    """Return whether claims pack onto a host; None: the exact search gave up.

    It takes `SEARCH_NODES` steps at most, and where an effort is given, no more than that has left.

    A reserve is not guaranteed to a partition of more virtual processors than the host has logical ones, so such a
    one does not pack. Where a script gives the promises, places that only a search finds count as not known.

    Args:
        effort: steps that several searches share; None: this one has its own.

    Returns:
        True, False, or None.
    """
    reserved, bins = reserved_by_core(claims, capacity), capacity.cores
    if any(claim.processors > bins for claim in reserved):
        return False
    if load_of(reserved).percent > WHOLE * bins:
        return False
    if _spread(reserved, bins):
        return True
    found = _search(_sizes(reserved), bins, effort or Effort(SEARCH_NODES))
    return None if found and isinstance(capacity, CheckedCapacity) and capacity.by_script else found


def packs_by_first_fit(claims: Iterable[Claim], capacity: Capacity) -> bool:
    """Return whether first fit, the largest first, places all, as Hyper-V scripts ask before each promise.

    Partitions that are as wide as the host are laid over all of it before. Where it finds none there may yet be one.

    Returns:
        False also where an exact search would find places.
    """
    return _spread(reserved_by_core(claims, capacity), capacity.cores)


def reserved_by_core(claims: Iterable[Claim], capacity: Capacity) -> list[Claim]:
    """Return the claims that reserve anything, with the cores that they take for their processors.

    Returns:
        What is laid onto `capacity.cores`.
    """
    reserved, threads = [claim for claim in claims if claim.reserve and claim.processors], capacity.sharing.threads
    if threads == 1:
        return reserved
    return [replace(claim, processors=-(-claim.processors // threads)) for claim in reserved]


def _spread(claims: list[Claim], bins: int) -> bool:
    full_width = sum(claim.reserve for claim in claims if claim.processors == bins)
    if full_width > WHOLE:
        return False
    narrow = _sizes([claim for claim in claims if claim.processors != bins])
    return not narrow or _first_fit(narrow, [WHOLE - full_width] * bins)


def _sizes(claims: list[Claim]) -> list[int]:
    return sorted((claim.reserve for claim in claims for _ in range(claim.processors)), reverse=True)


def _first_fit(sizes: list[int], free: list[int]) -> bool:
    for size in sizes:
        for at, remaining in enumerate(free):
            if size <= remaining:
                free[at] -= size
                break
        else:
            return False
    return True


def _search(sizes: list[int], bins: int, effort: Effort) -> bool | None:
    """Search depth first, the largest size first; what is left on all processors is tried once, in any order.

    None: it gave up.
    """
    if _first_fit(sizes, [WHOLE] * bins):
        return True
    waiting = [*accumulate(reversed(sizes), initial=0)][::-1]  # by number: what is still to be placed
    failed = set[tuple[int, ...]]()  # what was left; its sum gives the number
    allowed = nodes = min(SEARCH_NODES, effort.steps)

    def place(number: int, free: tuple[int, ...]) -> bool:
        nonlocal nodes
        if number == len(sizes):
            return True
        nodes -= 1
        # What is left in pieces that are too small for the smallest is lost.
        if (
            nodes < 0
            or free in failed
            or sum(remaining for remaining in free if remaining >= sizes[-1]) < waiting[number]
        ):
            return False
        size = sizes[number]
        for at, remaining in enumerate(free):
            if remaining < size or remaining in free[:at]:
                continue
            if place(number + 1, tuple(sorted((*free[:at], remaining - size, *free[at + 1 :])))):
                return True
        failed.add(free)
        return False

    if len(sizes) > SEARCHED_UP_TO:
        return None
    found = place(0, (WHOLE,) * bins)
    effort.steps -= allowed - max(0, nodes)
    if found:
        return True
    return False if nodes >= 0 else None
