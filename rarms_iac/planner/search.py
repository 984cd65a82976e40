"""Partitions onto hosts: least reservation in all, then fewest moves, then names (DESIGN section 3, The problem).

Small problems are searched exactly; larger ones take the first host that has room, largest partition first, and the
answer is called proven only where no other could be better.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rarms_iac.model.capacity import WHOLE, Capacity, Load, fits, load_of
from rarms_iac.model.plan import Claim

EXACT_UP_TO = 30
"""Partitions that the exact search takes on."""

NODES = 4_000
"""How many placements it tries before it leaves the answer to the first fit: a count, never a time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """A partition that needs a host: what it claims on each that it may run on, and where it is now."""

    name: str
    claims: Mapping[str, Claim]  # by host, in name order
    now: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bin:
    """A host, with what machines that are not ours hold there."""

    name: str
    capacity: Capacity
    taken: tuple[Claim, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """A placement, or that there is none; `proven`: there is no better one, or none at all."""

    hosts: Mapping[str, str] | None  # partition -> host
    proven: bool


def place(items: Sequence[Item], bins: Sequence[Bin]) -> Found:
    """The best placement that was found; the same input always gives the same one."""
    ordered = sorted(items, key=lambda one: one.name)
    if any(not one.claims for one in ordered):
        return Found(hosts=None, proven=True)
    if _too_much(ordered, bins):
        return Found(hosts=None, proven=True)
    if all(len(one.claims) == 1 for one in ordered):
        return _only_way(ordered, bins)
    if len(ordered) <= EXACT_UP_TO:
        search = _Search(items=ordered, bins={one.name: one for one in bins})
        search.run()
        if search.complete:
            return Found(hosts=search.best, proven=True)
    quick = _first_fit(ordered, bins, _Room)
    if quick is not None and not _all_fit(ordered, bins, quick):
        # Who orders the steps packs anew, without the lanes of `_Room`, and must come to the same answer.
        quick = _first_fit(ordered, bins, _SureRoom)
    if quick is None:
        return Found(hosts=None, proven=False)
    return Found(hosts=quick, proven=_value(ordered, quick) == _bound(ordered))


def _only_way(items: Sequence[Item], bins: Sequence[Bin]) -> Found:
    """Where each partition has one host, there is nothing to search, only to check."""
    hosts = {item.name: next(iter(item.claims)) for item in items}
    return Found(hosts=hosts if _all_fit(items, bins, hosts) else None, proven=True)


def _all_fit(items: Sequence[Item], bins: Sequence[Bin], hosts: Mapping[str, str]) -> bool:
    """Whether every host that is used can keep all that is promised there."""
    there: dict[str, list[Claim]] = {one.name: list(one.taken) for one in bins}
    for item in items:
        there[hosts[item.name]].append(item.claims[hosts[item.name]])
    used = set(hosts.values())
    return all(fits(one.capacity, there[one.name]) for one in bins if one.name in used)


def cost(claim: Claim) -> int:
    """The reservation in per cent of one logical processor."""
    return claim.processors * claim.reserve


def _value(items: Sequence[Item], hosts: Mapping[str, str]) -> tuple[int, int]:
    total = sum(cost(one.claims[hosts[one.name]]) for one in items)
    return total, sum(bool(one.now) and one.now != hosts[one.name] for one in items)


def _bound(items: Sequence[Item]) -> tuple[int, int]:
    """No placement is better: each partition where it costs least, and none moved."""
    return sum(min(cost(claim) for claim in one.claims.values()) for one in items), 0


def _too_much(items: Sequence[Item], bins: Sequence[Bin]) -> bool:
    """Whether all hosts together are too small for the least that everything claims."""
    free = [free_in(one) for one in bins]
    least = sum(min(cost(claim) for claim in one.claims.values()) for one in items)
    memory = sum(min(claim.memory for claim in one.claims.values()) for one in items)
    return least > sum(max(0, one.percent) for one in free) or memory > sum(max(0, one.memory) for one in free)


def free_in(one: Bin) -> Load:
    """What a host has left to promise; negative where others hold more than there is."""
    taken = load_of(one.taken)
    return Load(percent=int(WHOLE * one.capacity.processors) - taken.percent, memory=one.capacity.memory - taken.memory)


@dataclass(slots=True)
class _Search:
    """Depth first in name order over hosts in name order, so that of equals the first found is the first by name."""

    items: Sequence[Item]
    bins: Mapping[str, Bin]
    best: dict[str, str] | None = None
    value: tuple[int, int] | None = None
    complete: bool = True
    nodes: int = NODES
    rest: list[tuple[int, int]] = field(default_factory=list)  # what items from here on cost and weigh at least

    def run(self) -> None:
        cheapest = [min(cost(claim) for claim in one.claims.values()) for one in self.items]
        lightest = [min(claim.memory for claim in one.claims.values()) for one in self.items]
        self.rest = [(sum(cheapest[at:]), sum(lightest[at:])) for at in range(len(self.items) + 1)]
        there: dict[str, list[Claim]] = {name: list(one.taken) for name, one in self.bins.items()}
        free = {name: free_in(one) for name, one in self.bins.items()}
        self._down(0, (0, 0), there, free, {})

    def _down(
        self,
        at: int,
        value: tuple[int, int],
        there: dict[str, list[Claim]],
        free: dict[str, Load],
        hosts: dict[str, str],
    ) -> bool:
        """Whether the search may end: nothing can be better than what was found, or it gave up."""
        if at == len(self.items):
            if self.value is None or value < self.value:
                self.best, self.value = dict(hosts), value
            return self.value == (self.rest[0][0], 0)
        if self._hopeless(at, value, free):
            return False
        item = self.items[at]
        for name, claim in item.claims.items():
            self.nodes -= 1
            if self.nodes < 0:
                self.complete = False
                return True
            left = Load(percent=free[name].percent - cost(claim), memory=free[name].memory - claim.memory)
            if left.percent < 0 or left.memory < 0:
                continue
            there[name].append(claim)
            if fits(self.bins[name].capacity, there[name]):
                before, free[name], hosts[item.name] = free[name], left, name
                moved = value[1] + (bool(item.now) and item.now != name)
                if self._down(at + 1, (value[0] + cost(claim), moved), there, free, hosts):
                    return True
                free[name] = before
                del hosts[item.name]
            there[name].pop()
        return False

    def _hopeless(self, at: int, value: tuple[int, int], free: Mapping[str, Load]) -> bool:
        least, memory = self.rest[at]
        if self.value is not None and (value[0] + least, value[1]) >= self.value:
            return True
        room = sum(one.percent for one in free.values())
        return least > room or memory > sum(one.memory for one in free.values())


def _first_fit(items: Sequence[Item], bins: Sequence[Bin], make_room: "type[_Room]") -> dict[str, str] | None:
    """Largest first, each where it is or costs least and has room; every virtual processor gets its place at once."""
    rooms = {one.name: make_room(one) for one in bins}
    hosts: dict[str, str] = {}
    for item in sorted(items, key=_largest_first):
        for name in _preferred(item):
            if rooms[name].take(item.claims[name]):
                hosts[item.name] = name
                break
        else:
            return None
    return hosts


class _Room:
    """What is left of a host while partitions are put onto it; what was placed is not moved any more."""

    def __init__(self, one: Bin) -> None:
        self.left = free_in(one)
        self.lanes = [WHOLE] * one.capacity.logical_processors
        for claim in sorted(one.taken, key=lambda taken: -taken.reserve):
            self._lay(claim)

    def take(self, claim: Claim) -> bool:
        """Whether it has room for the claim, which then is taken."""
        left = Load(percent=self.left.percent - cost(claim), memory=self.left.memory - claim.memory)
        if left.percent < 0 or left.memory < 0 or not self._lay(claim):
            return False
        self.left = left
        return True

    def _lay(self, claim: Claim) -> bool:
        """Each virtual processor onto the first logical one that has so much left, on different ones first."""
        if not claim.reserve:
            return True
        if claim.processors > len(self.lanes):
            return False
        lanes = list(self.lanes)
        waiting = claim.processors
        while waiting:
            chosen = [at for at, free in enumerate(lanes) if free >= claim.reserve][:waiting]
            if not chosen:
                return False
            for at in chosen:
                lanes[at] -= claim.reserve
            waiting -= len(chosen)
        self.lanes = lanes
        return True


class _SureRoom(_Room):
    """Takes only what `fits` finds a place for too, so that whoever asks again gets the same answer."""

    def __init__(self, one: Bin) -> None:
        super().__init__(one)
        self.capacity = one.capacity
        self.claims = list(one.taken)
        self.refused: set[Claim] = set()

    def take(self, claim: Claim) -> bool:
        if claim in self.refused:
            return False
        left, lanes = self.left, self.lanes
        if not super().take(claim):
            return False
        if fits(self.capacity, (*self.claims, claim)):
            self.claims.append(claim)
            return True
        self.left, self.lanes = left, lanes
        self.refused.add(claim)
        return False


def _largest_first(item: Item) -> tuple[int, int, str]:
    return (
        -max(cost(claim) for claim in item.claims.values()),
        -max(claim.memory for claim in item.claims.values()),
        item.name,
    )


def _preferred(item: Item) -> list[str]:
    return sorted(item.claims, key=lambda name: (cost(item.claims[name]), name != item.now, name))
