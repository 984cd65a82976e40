"""Checks what the planner claims of a packing, and believes nothing: not the search, not its floating point.

A claim is plain data. Its proof is a tree: a split says that two items share a host or do not, or that an item is on
certain hosts or on none of them; a leaf has a weight an item. No set that a host takes carries more than that host
costs, but for the excess that the exact knapsack here finds; so the weights add up to a bound. Whole numbers only.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

GRAIN = 128
STEPS = 1_000_000  # of one knapsack: a proof that needs more is not one that can be checked
Data = Mapping[str, Any]
Costs = tuple[Sequence[int], Sequence[Sequence[int]]]  # of using a host, and of an item on it


class Wrong(Exception):
    """The claim does not hold, or its proof does not show it."""


def check(problem: Data, claim: Data) -> None:
    """Raises `Wrong` unless the packing is one, costs and moves what is claimed, and no other is better.

    Args:
        problem: `sizes` (by host, item, dimension; null where it must not be), `rooms` (by host, dimension),
            `opening` (by host), `costs` (by host, item), `now` (by item, or empty) and `conflicts` (pairs).
        claim: `hosts` (by item), `cost`, `cost_proof`, `moves`, `moves_proof`; or `impossible`, a proof.
    """
    try:
        _check(problem, claim)
    except (LookupError, TypeError, ValueError, ArithmeticError, RecursionError) as wrong:
        raise Wrong(f"the claim is not made as a claim is: {wrong!r}") from wrong


def _check(problem: Data, claim: Data) -> None:
    hosts, items = range(len(problem["rooms"])), range(len(problem["sizes"][0]))
    free = ([0] * len(hosts), [[0] * len(items)] * len(hosts))
    if "impossible" in claim:
        _at_least(problem, claim["impossible"], 1, free, free, 0)
        return
    where = _whole(claim["hosts"])
    _fits(problem, where)
    moved = [[int(was not in (None, host)) for was in problem["now"] or [None] * len(items)] for host in hosts]
    costs, moves = (problem["opening"], problem["costs"]), (free[0], moved)
    for name, (opening, by_item) in (("cost", costs), ("moves", moves)):
        value = sum(opening[host] for host in set(where)) + sum(by_item[host][at] for at, host in enumerate(where))
        if [value] != _whole([claim[name]]):
            raise Wrong(f"the packing has {name} {value}, and {claim[name]} is claimed")
    if claim["cost"]:
        _at_least(problem, claim["cost_proof"], claim["cost"], costs, free, 0)
    if claim["moves"]:
        _at_least(problem, claim["moves_proof"], claim["moves"], moves, costs, claim["cost"])


def _whole(numbers: Sequence[Any]) -> Sequence[int]:
    if not isinstance(numbers, list) or any(type(one) is not int for one in numbers):
        raise Wrong("what should be whole numbers is not")
    return numbers


def _fits(problem: Data, where: Sequence[int]) -> None:
    if len(where) != len(problem["sizes"][0]) or not all(0 <= host < len(problem["rooms"]) for host in where):
        raise Wrong("the packing does not have every item once, on a host that there is")
    for host, room in enumerate(problem["rooms"]):
        sizes = [problem["sizes"][host][item] for item, at in enumerate(where) if at == host]
        if None in sizes or any(sum(size[d] for size in sizes) > there for d, there in enumerate(room) if sizes):
            raise Wrong(f"host {host} does not take what is put there")
    if any(where[one] == where[other] for one, other in problem["conflicts"]):
        raise Wrong("items that must not share a host do")


def _at_least(problem: Data, proof: Data, value: int, costs: Costs, charges: Costs, budget: int) -> None:
    """That no packing whose charges add up to the budget costs less than `value`."""
    for groups, conflicts, banned, weights in _leaves(problem, proof):
        items, (row, scale) = _whole(weights["items"]), _whole([weights["budget"], weights["scale"]])
        total = sum(items) + row * budget
        known: dict[str, int] = {}
        for host, room in enumerate(problem["rooms"]):
            gains, sizes = [], []
            for group in groups:
                parts = [None if (item, host) in banned else problem["sizes"][host][item] for item in group]
                gains.append(sum(items[at] + row * charges[1][host][at] - scale * costs[1][host][at] for at in group))
                sizes.append(None if None in parts else [sum(column) for column in zip(*parts, strict=True)])
            what = str((room, gains, sizes))
            if what not in known:
                known[what] = _heaviest(room, gains, sizes, conflicts)
            total += min(0, scale * costs[0][host] - row * charges[0][host] - known[what])
        if len(items) != len(problem["sizes"][0]) or scale < 1 or -(-total // scale) < value:
            raise Wrong("the weights do not bound the packing")


def _leaves(problem: Data, proof: Data) -> Iterator[Any]:
    """The groups of items that are together, by group those it is apart from (bits), what is banned, the weights."""
    count, hosts = len(problem["sizes"][0]), range(len(problem["rooms"]))
    stack: list[Any] = [(proof, list(range(count)), list(problem["conflicts"]), frozenset[tuple[int, int]]())]
    while stack:
        node, home, apart, banned = stack.pop()
        if "split" in node:
            what, item, other = node["split"]
            if what == "together":
                merged = [home[item] if root == home[other] else root for root in home]
                holds, fails = (merged, apart, banned), (home, [*apart, (item, other)], banned)
            elif what == "on":
                off = {(item, host) for host in hosts if host not in _whole(other)}
                holds, fails = (home, apart, banned | off), (home, apart, banned | {(item, host) for host in other})
            else:
                raise Wrong("a split of a kind that there is not")
            stack += [(node["holds"], *holds), (node["fails"], *fails)]
        elif all(home[one] != home[other] for one, other in apart):  # otherwise nothing is below
            groups = [[item for item in range(count) if home[item] == root] for root in sorted(set(home))]
            at = {item: number for number, group in enumerate(groups) for item in group}
            pairs = {(at[one], at[other]) for one, other in [*apart, *((other, one) for one, other in apart)]}
            conflicts = [sum(1 << b for a, b in pairs if a == number) for number in range(len(groups))]
            yield groups, conflicts, banned, node["weights"]


def _heaviest(room: Sequence[int], gains: Sequence[int], sizes: Sequence[Any], conflicts: Sequence[int]) -> int:
    """The most that items which fit into the room together, one at least, can gain; exact."""
    alone = [at for at, size in enumerate(sizes) if size and all(s <= r for s, r in zip(size, room, strict=True))]
    # All dimensions added up, in grains, are one dimension more: it cuts where none alone is full.
    sums = {at: sum(GRAIN * s // max(1, r) for s, r in zip(sizes[at], room, strict=True)) for at in alone}
    order = sorted((at for at in alone if gains[at] > 0), key=lambda at: -gains[at] / (1 + sums[at]))
    if not order:
        return max((gains[at] for at in alone), default=-(10**30))
    rooms, takes = (*room, GRAIN * len(room)), [(*sizes[at], sums[at]) for at in order]
    bounds = [_bounds([take[d] for take in takes], [gains[at] for at in order], r) for d, r in enumerate(rooms)]
    best, steps, stack = 0, 0, [(0, rooms, 0, 0)]
    while stack:
        number, free, gain, banned = stack.pop()
        best, steps = max(best, gain), steps + 1
        if steps > STEPS:
            raise Wrong("the proof takes too long to check")
        left = (f if r < len(table[0]) else f * GRAIN // r for table, f, r in zip(bounds, free, rooms, strict=True))
        if gain + min(table[number][f] for table, f in zip(bounds, left, strict=True)) > best:
            at, after = order[number], tuple(f - s for f, s in zip(free, takes[number], strict=True))
            stack.append((number + 1, free, gain, banned))
            if min(after) >= 0 and not banned >> at & 1:
                stack.append((number + 1, after, gain + gains[at], banned | conflicts[at]))
    return best


def _bounds(sizes: Sequence[int], gains: Sequence[int], room: int) -> list[list[int]]:
    """By number and room left in one dimension: the most that items from that number on gain; large rooms in grains."""
    if room > 10 * GRAIN:
        sizes, room = [size * GRAIN // room for size in sizes], GRAIN
    table = [[0] * (room + 1)]
    for size, gain in zip(reversed(sizes), reversed(gains), strict=True):
        table.append([max(one, table[-1][r - size] + gain) if r >= size else one for r, one in enumerate(table[-1])])
    return table[::-1]
