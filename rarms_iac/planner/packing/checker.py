"""Checks what the planner claims of a packing, and believes nothing: not the search, not its floating point.

A proof is a weight an item. No set that a host takes carries more than that host costs, but for an excess that is found
exactly: so the weights add up to a bound. Where it says `tried`, all packings of sets that are nearly free are tried.
"""

from bisect import bisect_right
from collections.abc import Sequence
from typing import Any

GRAIN = 128
STEPS = 400_000  # of one search: a proof that needs more is not one that can be checked
Ints = Sequence[int]
Costs = tuple[Ints, Sequence[Ints]]  # of using a host, and of an item on it


class Wrong(Exception):
    """The claim does not hold, or its proof does not show it."""


def check(problem: Any, claim: Any) -> None:
    """Raises `Wrong` unless the packing is one, costs and moves what is claimed, and no other is better.

    The problem has `sizes` (by host, item, dimension; null where it must not be), `rooms` (by host, dimension),
    `opening` (by host), `costs` (by host, item), `now` (by item, or empty), `conflicts` (pairs). The claim has `hosts`
    (by item), `cost`, `cost_proof`, `moves`, `moves_proof`; or `impossible`, a proof.
    """
    try:
        hosts, items = range(len(problem["rooms"])), range(len(problem["sizes"][0]))
        free = ([0] * len(hosts), [[0] * len(items)] * len(hosts))
        moved = [[int(was not in (None, host)) for was in problem["now"] or [None] * len(items)] for host in hosts]
        costs, moves = (problem["opening"], problem["costs"]), (free[0], moved)
        if "impossible" in claim:
            return _at_least(problem, claim["impossible"], 1, free, free, 0)
        where = _whole(claim["hosts"])
        everywhere = len(where) == len(items) and set(where) <= set(hosts)
        if not everywhere or any(where[one] == where[other] for one, other in problem["conflicts"]):
            raise Wrong("not every item is once on a host that there is, apart from those that it must be apart from")
        for host, room in enumerate(problem["rooms"]):
            there = [problem["sizes"][host][item] for item in items if where[item] == host]
            if None in there or any(sum(size[d] for size in there) > most for d, most in enumerate(room) if there):
                raise Wrong(f"host {host} does not take what is put there")
        for name, (opening, by_item) in (("cost", costs), ("moves", moves)):
            value = sum(opening[host] for host in set(where)) + sum(by_item[where[item]][item] for item in items)
            if [value] != _whole([claim[name]]):
                raise Wrong(f"the packing has {name} {value}, and {claim[name]} is claimed")
        least = claim["cost"]
        while least and not any(map(any, costs[1])) and not _payable(problem, least - 1):
            least -= 1
        if claim["cost"]:
            _at_least(problem, claim["cost_proof"], least, costs, free, 0)
        if claim["moves"]:
            _at_least(problem, claim["moves_proof"], claim["moves"], moves, costs, claim["cost"])
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as wrong:
        raise Wrong(f"the claim is not made as a claim is: {wrong!r}") from wrong


def _whole(numbers: Sequence[Any]) -> Ints:
    if not isinstance(numbers, list) or any(type(one) is not int for one in numbers):
        raise Wrong("what should be whole numbers is not")
    return numbers


def _payable(problem: Any, cost: int) -> bool:
    """Whether hosts of exactly that price have room for everything, each dimension by itself."""
    items = [[size for size in one if size is not None] for one in zip(*problem["sizes"], strict=True)]
    most = {0: [-sum(min(size[d] for size in one) for one in items) for d in range(len(problem["rooms"][0]))]}
    for opening, room in zip(problem["opening"], problem["rooms"], strict=True):
        for price in sorted(most, reverse=True):
            more = [there + one for there, one in zip(most[price], room, strict=True)]
            most[price + opening] = list(map(max, more, most.get(price + opening, more)))
    return bool(min(most.get(cost, [-1])) >= 0)


def _at_least(problem: Any, proof: Any, value: int, costs: Costs, charges: Costs, budget: int) -> None:
    """That no packing whose charges add up to the budget costs less than `value`."""
    items, (row, scale) = _whole(proof["items"]), _whole([proof["budget"], proof["scale"]])
    pairs = problem["conflicts"]
    apart = [sum({1 << (b if a == item else a) for a, b in pairs if item in (a, b)}) for item in range(len(items))]
    slack, kinds = (value - 1) * scale - sum(items) - row * budget, dict[str, Any]()
    for host, (room, sizes) in enumerate(zip(problem["rooms"], problem["sizes"], strict=True)):
        gains = [w + row * b - scale * c for w, b, c in zip(items, charges[1][host], costs[1][host], strict=True)]
        fixed = scale * costs[0][host] - row * charges[0][host]
        what = str((room, sizes, gains, fixed))
        if what not in kinds:
            best = max((gain for gain, _ in _sets(room, gains, sizes, apart, None)), default=fixed)
            kinds[what] = [max(0, best - fixed), fixed, room, gains, sizes, host, 0]
        kinds[what][-1] += 1
        slack += kinds[what][0]
    if scale < 1 or (slack >= 0 and proof.get("tried") is not True):
        raise Wrong("the weights do not bound the packing")
    columns, needs = list[Any](), [1] * len(items) + [kind[-1] for kind in kinds.values()]
    for own, (excess, fixed, room, gains, sizes, host, _) in enumerate(kinds.values(), len(items)):
        columns.append((excess, [own], 0))  # a host that stays empty
        for gain, some in _sets(room, gains, sizes, apart, fixed + excess - slack):
            charge = charges[0][host] + sum(charges[1][host][item] for item in some)
            columns.append((fixed - gain + excess, [*some, own], charge))
    _try(sorted(columns), needs, slack, budget)


def _sets(room: Ints, gains: Ints, sizes: Sequence[Any], apart: Ints, least: int | None) -> list[tuple[int, list[int]]]:
    """The sets of items, one at least, that fit into the room and gain so much; None: ever better ones."""
    # All dimensions added up, in grains, are one dimension more: it cuts where none alone is full.
    alone = {at: size for at, size in enumerate(sizes) if size and all(map(int.__le__, size, room))}
    takes = {at: [*s, sum(GRAIN * t // max(1, r) for t, r in zip(s, room, strict=True))] for at, s in alone.items()}
    order, rooms = sorted(alone, key=lambda at: -gains[at] / (1 + takes[at][-1])), [*room, GRAIN * len(room)]
    tables = []  # by dimension, number and room left, in grains where that is large: what items from there on gain
    for d, there in enumerate(rooms):
        rows = [[0] * (1 + (there if there <= 10 * GRAIN else GRAIN))]
        for at in reversed(order):
            size, last, gain = takes[at][d] * (len(rows[0]) - 1) // max(1, there), rows[-1], gains[at]
            rows.append([max(one, last[left - size] + gain) if left >= size else one for left, one in enumerate(last)])
        tables.append(rows[::-1])
    found, steps, stack = list[tuple[int, list[int]]](), 0, list[Any]([(0, rooms, 0, [], 0)])
    wanted = -(10**30) if least is None else least
    while stack:
        number, free, gain, some, banned = stack.pop()
        if (steps := steps + 1) > STEPS:
            raise Wrong("the proof takes too long to check")
        most = [t[number][f * (len(t[0]) - 1) // max(1, r)] for t, f, r in zip(tables, free, rooms, strict=True)]
        if number < len(order) and gain + min(most) >= wanted:
            at, after = order[number], [f - s for f, s in zip(free, takes[order[number]], strict=True)]
            stack.append((number + 1, free, gain, some, banned))
            if min(after) >= 0 and not banned >> at & 1:
                stack.append((number + 1, after, gain + gains[at], [*some, at], banned | apart[at]))
                if gain + gains[at] >= wanted:
                    found.append((gain + gains[at], [*some, at]))
                    wanted = wanted if least is not None else gain + gains[at] + 1
    return found


def _try(columns: Sequence[Any], needs: list[int], slack: int, budget: int) -> None:
    """Raises `Wrong` if some columns (cost, rows, charge) give every row what it needs, within slack and budget."""
    rows = [sum(1 << n for n, column in enumerate(columns) if row in column[1]) for row in range(len(needs))]
    costs, widest, steps = [column[0] for column in columns], max((len(one[1]) for one in columns), default=0), 0
    stack = [((1 << len(columns)) - 1, needs, slack, budget)]
    while stack:
        alive, needed, left, due = stack.pop()
        alive &= (1 << bisect_right(costs, left)) - 1
        there = [alive & bits for bits, need in zip(rows, needed, strict=True) if need]
        if (not there and not due) or (steps := steps + 1) > STEPS:
            raise Wrong("there may be a better packing")
        if all(there) and there and sum([costs[(one & -one).bit_length() - 1] for one in there]) <= left * widest:
            low = (chosen := min(there, key=int.bit_count)) & -chosen
            cost, covers, charge = columns[low.bit_length() - 1]
            stack.append((alive ^ low, needed, left, due))
            after = [need - (row in covers) for row, need in enumerate(needed)]
            for row in covers:
                alive &= -1 if after[row] else ~rows[row]
            stack.append((alive, after, left - cost, due - charge))
