"""Checks what the planner claims of a packing, and believes nothing: not the search, not its floating point.

A claim is plain data, as in a plan file. Its proof is a tree: a split says that two items share a host or do not, or
that an item is on certain hosts or on none of them; a leaf has a weight an item. No set of items that a host can take
may carry more weight than that host costs, but for the excess that the exact knapsack here finds; so the weights add
up to a bound. Whole numbers throughout. This module imports nothing of the planner.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

GRAIN = 128
Data = Mapping[str, Any]


class Wrong(Exception):
    """The claim does not hold, or its proof does not show it."""


def check(problem: Data, claim: Data) -> None:
    """That the packing is one, costs and moves what is claimed, and that no other is better.

    Args:
        problem: `sizes` (by host, then item: by dimension, or null where it must not be), `rooms` (by host),
            `opening` (by host), `costs` (by host, then item), `now` (by item, may be empty) and `conflicts`.
        claim: `hosts` (by item), `cost`, `cost_proof`, `moves`, `moves_proof`; or `impossible`, a proof.

    Raises:
        Wrong: says what does not hold.
    """
    hosts, items = range(len(problem["rooms"])), range(len(problem["sizes"][0]))
    nothing = [[0] * len(items) for _ in hosts]
    free = [0] * len(problem["rooms"])
    if "impossible" in claim:
        return _at_least(problem, claim["impossible"], 1, free, nothing, free, nothing, 0)
    where = claim["hosts"]
    _fits(problem, where)
    cost = sum(problem["opening"][host] for host in set(where))
    cost += sum(problem["costs"][host][item] for item, host in enumerate(where))
    moved = [[int(now is not None and now != host) for now in problem["now"] or [None] * len(items)] for host in hosts]
    if cost != claim["cost"] or sum(moved[host][item] for item, host in enumerate(where)) != claim["moves"]:
        raise Wrong("the packing costs or moves something else than is claimed")
    if cost:
        _at_least(problem, claim["cost_proof"], cost, problem["opening"], problem["costs"], free, nothing, 0)
    if claim["moves"]:
        spent = (problem["opening"], problem["costs"], cost)
        _at_least(problem, claim["moves_proof"], claim["moves"], free, moved, *spent)


def _fits(problem: Data, where: Sequence[int]) -> None:
    if len(where) != len(problem["sizes"][0]):
        raise Wrong("the packing does not have every item once")
    for host, room in enumerate(problem["rooms"]):
        sizes = [problem["sizes"][host][item] for item, at in enumerate(where) if at == host]
        if None in sizes or any(sum(size[d] for size in sizes) > there for d, there in enumerate(room)):
            raise Wrong(f"host {host} does not take what is put there")
    if any(where[one] == where[other] for one, other in problem["conflicts"]):
        raise Wrong("items that must not share a host do")
    if any(not 0 <= host < len(problem["rooms"]) for host in where):
        raise Wrong("an item is on a host that there is not")


def _at_least(  # noqa: PLR0913 - the objective and the budget row, each by host and by item
    problem: Data,
    proof: Data,
    value: int,
    opening: Sequence[int],
    costs: Sequence[Sequence[int]],
    charge: Sequence[int],
    charges: Sequence[Sequence[int]],
    budget: int,
) -> None:
    """That no packing whose charges add up to the budget costs less than `value`."""
    for groups, conflicts, banned, weights in _leaves(problem, proof):
        items, row, scale = weights["items"], weights["budget"], weights["scale"]
        if scale < 1 or len(items) != len(costs[0]):
            raise Wrong("the weights are not one an item")
        total = sum(items) + row * budget
        known: dict[Any, int] = {}
        for host, room in enumerate(problem["rooms"]):
            gains, sizes = [], []
            for number, group in enumerate(groups):
                parts = [None if (item, host) in banned else problem["sizes"][host][item] for item in group]
                gain = sum(items[at] + row * charges[host][at] - scale * costs[host][at] for at in group)
                gains.append(gain if None not in parts else None)
                sizes.append([sum(column) for column in zip(*parts, strict=True)] if None not in parts else None)
            what = (str(room), str(gains), str(sizes))
            if what not in known:
                known[what] = _heaviest(room, gains, sizes, conflicts)
            total += min(0, scale * opening[host] - row * charge[host] - known[what])
        if -(-total // scale) < value:
            raise Wrong("the weights do not bound the packing")


def _leaves(problem: Data, proof: Data) -> Iterator[tuple[list[list[int]], list[int], set[tuple[int, int]], Data]]:
    """The groups of items that are together, by group the set of those it is apart from, what is banned, the weights."""
    count = len(problem["sizes"][0])
    stack: list[tuple[Data, list[int], list[tuple[int, int]], frozenset[tuple[int, int]]]]
    stack = [(proof, list(range(count)), [(one, other) for one, other in problem["conflicts"]], frozenset())]
    while stack:
        node, home, apart, banned = stack.pop()
        if "split" in node:
            what, item, other = node["split"]
            if what == "together":
                merged = [home[item] if root == home[other] else root for root in home]
                stack += [(node["holds"], merged, apart, banned), (node["fails"], home, [*apart, (item, other)], banned)]
            elif what == "on":
                others = {(item, host) for host in range(len(problem["rooms"])) if host not in other}
                stack += [(node["holds"], home, apart, banned | others)]
                stack += [(node["fails"], home, apart, banned | {(item, host) for host in other})]
            else:
                raise Wrong("a split of a kind that there is not")
            continue
        torn = any(home[one] == home[other] for one, other in apart)
        if torn:
            continue  # nothing is below: what must be apart is together
        if "weights" not in node:
            raise Wrong("a leaf neither contradicts itself nor has weights")
        groups = [[item for item in range(count) if home[item] == root] for root in sorted(set(home))]
        at = {item: number for number, group in enumerate(groups) for item in group}
        conflicts = [0] * len(groups)
        for one, other in apart:
            conflicts[at[one]] |= 1 << at[other]
            conflicts[at[other]] |= 1 << at[one]
        yield groups, conflicts, set(banned), node["weights"]


def _heaviest(room: Sequence[int], gains: Sequence[Any], sizes: Sequence[Any], conflicts: Sequence[int]) -> int:
    """The most that items which fit into the room together, one at least, can gain; exact."""
    alone = [at for at, size in enumerate(sizes) if size and all(s <= r for s, r in zip(size, room, strict=True))]
    if not any(gains[at] > 0 for at in alone):
        return max((gains[at] for at in alone), default=-(10**30))
    whole = [max(1, there) for there in room]
    share = {at: sum(GRAIN * s // w for s, w in zip(sizes[at], whole, strict=True)) for at in alone}
    order = sorted((at for at in alone if gains[at] > 0), key=lambda at: -gains[at] / (1 + share[at]))
    bounds = [_bounds([sizes[at][d] for at in order], [gains[at] for at in order], r) for d, r in enumerate(room)]
    joint = _bounds([share[at] for at in order], [gains[at] for at in order], GRAIN * len(room))
    best, stack = 0, [(0, tuple(room), 0, 0)]
    while stack:
        number, free, gain, banned = stack.pop()
        best = max(best, gain)
        if number == len(order):
            continue
        most = joint[number][sum(GRAIN * f // w for f, w in zip(free, whole, strict=True))]
        for table, left, there in zip(bounds, free, room, strict=True):
            most = min(most, table[number][left if there < len(table[0]) else left * GRAIN // there])
        if gain + most <= best:
            continue
        at = order[number]
        stack.append((number + 1, free, gain, banned))
        after = tuple(f - s for f, s in zip(free, sizes[at], strict=True))
        if min(after) >= 0 and not banned >> at & 1:
            stack.append((number + 1, after, gain + gains[at], banned | conflicts[at]))
    return best


def _bounds(sizes: Sequence[int], gains: Sequence[int], room: int) -> list[list[int]]:
    """By number and room left in one dimension: the most that items from that number on gain; large rooms in grains."""
    if room > 10 * GRAIN:
        sizes, room = [size * GRAIN // room for size in sizes], GRAIN
    table = [[0] * (room + 1)]
    for size, gain in zip(reversed(sizes), reversed(gains), strict=True):
        row = table[-1]
        table.append([max(one, row[r - size] + gain) if r >= size else one for r, one in enumerate(row)])
    return table[::-1]
