"""What is packed, in whole numbers: items onto hosts, at least cost (DESIGN section 3, The problem).

Hosts that nothing tells apart are one kind with a count, so that no search tries the same packing twice.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

Sizes = tuple[int, ...]
"""What something takes, or has, in each dimension."""

Mask = int
"""A set of items: bit i stands for item i."""

Fits = Callable[[int, Mask], bool]
"""Whether these items fit a kind beyond their sizes; a part of what fits must fit too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Processors:
    """Virtual processors, each of which needs a logical one that has so much left: how many, and per cent of each."""

    logical: int
    virtual: tuple[tuple[int, int], ...]  # by item
    others: tuple[tuple[int, int], ...] = ()  # of what is there already


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """Hosts that cannot be told apart."""

    hosts: tuple[int, ...]  # their numbers
    room: Sizes
    sizes: tuple[Sizes | None, ...]  # by item; None: it must not be here
    opening: int  # cost of using such a host at all
    costs: tuple[int, ...]  # by item, of putting it here
    charge: int = 0  # what using such a host adds to the budget row
    charges: tuple[int, ...] = ()  # by item


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """Every item onto one host, at least cost; where a budget is given, the charges add up to exactly that."""

    items: int
    kinds: tuple[Kind, ...]
    conflicts: tuple[Mask, ...]  # by item: those that it must not share a host with
    budget: int | None = None
    fits: Fits | None = None
    patterns: tuple[Mask, ...] | None = None  # the only sets that a host can have in a packing; None: not known


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """Items and single hosts, as they are given."""

    sizes: tuple[tuple[Sizes | None, ...], ...]  # by host, then item
    rooms: tuple[Sizes, ...]  # by host
    opening: tuple[int, ...]  # by host
    costs: tuple[tuple[int, ...], ...]  # by host, then item
    conflicts: frozenset[tuple[int, int]] = frozenset()  # items that must not share a host, the smaller number first
    now: tuple[int | None, ...] = ()  # by item: the host it is on; empty: nothing runs yet
    fits: Callable[[int, Sequence[int]], bool] | None = None  # host, items: whether they fit beyond their sizes
    alike: tuple[int, ...] = ()  # by host: hosts of different numbers differ for `fits`; empty: none do
    processors: tuple[Processors | None, ...] = ()  # by host: what `fits` rests on, None where sizes tell all

    @property
    def items(self) -> int:
        """How many items there are."""
        return len(self.sizes[0]) if self.sizes else len(self.now)


Assignment = tuple[int, ...]
"""By item: the number of its host."""


def cheapest(problem: Problem) -> Program:
    """The first level: least cost of all."""
    kinds = [
        Kind(
            hosts=hosts,
            room=problem.rooms[hosts[0]],
            sizes=problem.sizes[hosts[0]],
            opening=problem.opening[hosts[0]],
            costs=problem.costs[hosts[0]],
        )
        for hosts in _alike(problem, with_moves=False)
    ]
    return _program(problem, tuple(kinds), None)


def fewest_moves(problem: Problem, budget: int) -> Program:
    """The second level: fewest moves among the packings that cost exactly so much."""
    kinds = [
        Kind(
            hosts=hosts,
            room=problem.rooms[hosts[0]],
            sizes=problem.sizes[hosts[0]],
            opening=0,
            costs=tuple(int(was is not None and was != hosts[0]) for was in problem.now),
            charge=problem.opening[hosts[0]],
            charges=problem.costs[hosts[0]],
        )
        for hosts in _alike(problem, with_moves=True)
    ]
    return _program(problem, tuple(kinds), budget)


def feasible(program: Program) -> Program:
    """The same without costs: is there a packing at all?"""
    nothing = (0,) * program.items
    return replace(program, kinds=tuple(replace(one, opening=0, costs=nothing) for one in program.kinds))


def unpriced(program: Program) -> Program:
    """The same without the budget row."""
    return replace(program, kinds=tuple(replace(one, charge=0, charges=()) for one in program.kinds), budget=None)


def _program(problem: Problem, kinds: tuple[Kind, ...], budget: int | None) -> Program:
    conflicts = [0] * problem.items
    for one, other in problem.conflicts:
        conflicts[one] |= 1 << other
        conflicts[other] |= 1 << one
    check = problem.fits

    def fits(kind: int, mask: Mask) -> bool:
        assert check is not None
        return check(kinds[kind].hosts[0], members(mask))

    return Program(
        items=problem.items,
        kinds=kinds,
        conflicts=tuple(conflicts),
        budget=budget,
        fits=fits if check else None,
    )


def _alike(problem: Problem, *, with_moves: bool) -> list[tuple[int, ...]]:
    """The hosts in groups that nothing tells apart, in order of their first."""
    at_home = {host for host in problem.now if host is not None} if with_moves else set()
    groups: dict[object, list[int]] = {}
    for host, room in enumerate(problem.rooms):
        what = (
            room,
            problem.opening[host],
            problem.sizes[host],
            problem.costs[host],
            problem.alike[host] if problem.alike else 0,
            host if host in at_home else -1,
        )
        groups.setdefault(what, []).append(host)
    return [tuple(hosts) for hosts in groups.values()]


def members(mask: Mask) -> list[int]:
    """The items of a set, in order."""
    found = []
    while mask:
        low = mask & -mask
        found.append(low.bit_length() - 1)
        mask ^= low
    return found


def pattern_cost(kind: Kind, mask: Mask) -> int:
    """What a host of this kind with these items costs."""
    return kind.opening + sum(kind.costs[item] for item in members(mask))


def pattern_charge(kind: Kind, mask: Mask) -> int:
    """What a host of this kind with these items adds to the budget row."""
    return kind.charge + sum(kind.charges[item] for item in members(mask)) if kind.charges else 0


Bundles = tuple[tuple[int, Mask], ...]
"""A packing: kinds with what is on one host of them; no empty hosts."""


def value_of(program: Program, bundles: Bundles) -> int:
    """What a packing costs."""
    return sum(pattern_cost(program.kinds[kind], mask) for kind, mask in bundles)


def charge_of(program: Program, bundles: Bundles) -> int:
    """What a packing adds to the budget row."""
    return sum(pattern_charge(program.kinds[kind], mask) for kind, mask in bundles)


def assignment_of(program: Program, bundles: Bundles) -> Assignment:
    """The hosts by item: of hosts that are alike, those of smaller number take the bundles of smaller items."""
    hosts: dict[int, int] = {}
    free: Mapping[int, list[int]] = {at: list(kind.hosts) for at, kind in enumerate(program.kinds)}
    for kind, mask in sorted(bundles, key=lambda one: one[1] & -one[1]):
        host = free[kind].pop(0)
        hosts.update(dict.fromkeys(members(mask), host))
    return tuple(hosts[item] for item in range(program.items))
