"""Checks what the planner claims of a packing, and believes nothing: not the search, not its floating point.

How claims and their proofs are made, and why they show what they do, is told in docs/packing.md.
"""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from functools import cache, reduce
from itertools import combinations
from operator import add, index, le, mul, or_, sub
from typing import Any

EXACT, GRAINS, STEPS, HOSTS = 1_280, 512, 400_000, 16  # larger rooms are cut into grains; more steps, hosts: given up


class Wrong(Exception):
    """The claim does not hold, or its proof does not show it."""


def check(problem: Any, claim: Any) -> None:
    """Raises `Wrong` unless the packing is one, costs and moves what is claimed, and no other is better."""
    _lie.cache_clear()
    try:
        kinds, items = [problem["kinds"][kind] for kind in problem["hosts"]], range(len(problem["now"]))
        free = ([0] * len(kinds), [[0] * len(items)] * len(kinds))
        moved = [[int(was not in (None, host)) for was in problem["now"]] for host in range(len(kinds))]
        costs, moves = ([kind["opening"] for kind in kinds], [kind["costs"] for kind in kinds]), (free[0], moved)
        if "impossible" in claim:
            if claim["impossible"] is not None or _payable(kinds, free[0], 0):
                _at_least(problem, claim["impossible"], 1, free, free, 0)
            return
        where = claim["hosts"]
        for host in set(where):
            some = [item for item in items if where[item] == host]
            if host < 0 or len(where) != len(items) or not _takes(kinds[host], problem["conflicts"], some):
                raise Wrong(f"host {host} does not take what is put there")
        for name, (opening, by_item), *rest in (("cost", costs, free, 0), ("moves", moves, costs, claim["cost"])):
            value = sum(opening[host] for host in set(where)) + sum(by_item[where[item]][item] for item in items)
            if repr(value) != repr(claim[name]):
                raise Wrong(f"the packing has {name} {value}, and {claim[name]} is claimed")
            while name == "cost" and value and not any(map(any, by_item)) and not _payable(kinds, opening, value - 1):
                value -= 1
            if claim[name]:
                shown = _by_hosts if isinstance(claim[f"{name}_proof"], list) else _at_least
                shown(problem, claim[f"{name}_proof"], value, (opening, by_item), *rest)
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError, RecursionError) as wrong:
        raise Wrong(f"the claim is not made as a claim is: {wrong!r}") from wrong


def _payable(kinds: Sequence[Any], opening: Sequence[int], cost: int) -> bool:  # by hosts of just that price
    sizes = [[size for size in item if size] for item in zip(*(kind["sizes"] for kind in kinds), strict=True)]
    most = {0: [-sum(min(size[d] for size in item) for item in sizes) for d in range(len(kinds[0]["room"]))]}
    for kind, more in zip(kinds, opening, strict=True):
        for price, there in sorted(most.items(), reverse=True):
            most[price + more] = list(map(max, map(add, there, kind["room"]), most.get(price + more, there)))
    return bool(min(most.get(cost, [-1])) >= 0)


def _takes(kind: Any, conflicts: Any, some: Sequence[int]) -> bool:  # whether there is room, each processor's too
    sums = map(sum, zip(*(kind["sizes"][item] for item in some), strict=True))
    if any(one in some and other in some for one, other in conflicts) or not all(map(le, sums, kind["room"])):
        return False
    logical, virtual, others = kind["processors"] or (0, [(0, 0)] * len(kind["sizes"]), ())
    sizes = [size for count, size in (*others, *(virtual[item] for item in some)) for _ in range(count)]
    return _lie(tuple(sorted(sizes, reverse=True)), (100,) * logical)


@cache
def _lie(sizes: tuple[int, ...], free: tuple[int, ...]) -> bool:
    if _lie.cache_info().misses > STEPS:
        raise Wrong("the proof takes too long to check")
    ways = {left: free[:at] + free[at + 1 :] for at, left in enumerate(free) if sizes and left >= sizes[0]}
    return not sizes or any(_lie(sizes[1:], tuple(sorted((*rest, left - sizes[0])))) for left, rest in ways.items())


def _at_least(problem: Any, proof: Any, value: int, costs: Any, charges: Any, budget: int) -> None:
    """That no packing whose charges add up to the budget costs less than `value`."""
    items, excess, (row, scale) = ([index(one) for one in proof[part]] for part in ("items", "excess", "rates"))
    slack = (value - 1) * scale - sum(items) - row * budget + sum(excess)
    columns, known = list[Any](), dict[str, int]()
    for host, (kind, more) in enumerate(zip(problem["hosts"], excess, strict=True)):
        gains = [w + row * b - scale * c for w, b, c in zip(items, charges[1][host], costs[1][host], strict=True)]
        most = scale * costs[0][host] - row * charges[0][host] + more
        if (what := str((kind, gains, most, more))) not in known:
            columns.append((more, [own := len(items) + len(known)], 0))  # a host that stays empty
            for gain, some in _sets(problem["kinds"][kind], problem["conflicts"], gains, most - max(slack, -1)):
                columns.append((most - gain, [*some, own], charges[0][host] + sum(charges[1][host][at] for at in some)))
        known[what] = known.get(what, 0) + 1
    if scale < 1 or min(columns)[0] < 0 or (slack >= 0 and proof["tried"] is not True):
        raise Wrong("the weights do not bound the packing")
    _try(sorted(columns), [1] * len(items) + [*known.values()], slack, budget)


def _by_hosts(problem: Any, proofs: Any, value: int, costs: Any, charges: Any, budget: int) -> None:
    free, hosts = ([0] * len(charges[0]), charges[1]), range(len(charges[0]))
    for proof in proofs:  # no excess is more than it says
        _at_least(problem, proof, -(10**30), costs, free, 0)
    if len(hosts) > HOSTS or any(map(any, charges[1])):
        raise Wrong("there are too many sets of hosts, or items have prices too")
    for some in (one for count in hosts for one in combinations(hosts, count + 1)):
        left = [(value - 1) * p["rates"][1] - sum(p["items"]) + sum(p["excess"][at] for at in some) for p in proofs]
        if sum(charges[0][at] for at in some) == budget and min(left) >= 0:
            best = proofs[left.index(min(left))]
            on = [[row[at] for at in some] for row in (problem["hosts"], best["excess"], *costs, *free)]
            _at_least({**problem, "hosts": on[0]}, {**best, "excess": on[1]}, value, on[2:4], on[4:], 0)


def _sets(kind: Any, conflicts: Any, gains: Sequence[int], least: int) -> Iterator[tuple[int, list[int]]]:
    """The sets of items, one at least, that a host takes and that gain so much; all dimensions summed up are one."""
    room, parts = kind["room"], [max(1, max(kind["room"]) // max(1, most)) for most in kind["room"]]
    takes = {at: [*s, sum(map(mul, s, parts))] for at, s in enumerate(kind["sizes"]) if s and all(map(le, s, room))}
    order, rooms = sorted(takes, key=lambda at: -takes[at][-1]), [*room, sum(map(mul, room, parts))]
    scales = [(most if most <= EXACT else GRAINS, max(1, most)) for most in rooms]
    rows = [[[0] * (1 + grains) for grains, _ in scales]]  # last first: what items from there on gain in so much room
    for at in reversed(order):
        cut = [size * grains // most for size, (grains, most) in zip(takes[at], scales, strict=True)]
        rows.append([[*r[:s], *map(max, r[s:], map(gains[at].__add__, r))] for r, s in zip(rows[-1], cut, strict=True)])
    steps, stack = 0, list[Any]([(0, rooms, 0, [])])
    while stack:
        number, free, gain, some = stack.pop()
        left = [one * grains // most for one, (grains, most) in zip(free, scales, strict=True)]
        if (steps := steps + 1) > STEPS:
            raise Wrong("the proof takes too long to check")
        if gain + min(map(list.__getitem__, rows[~number], left)) < least or not _takes(kind, conflicts, some):
            continue
        if some and gain >= least:
            yield gain, some
        while number < len(order) and gain + min(map(list.__getitem__, rows[~number], left)) >= least:
            at, number = order[number], number + 1
            after = list(map(sub, free, takes[at]))
            stack += [(number, after, gain + gains[at], [*some, at])] if min(after) >= 0 else []


def _try(columns: Sequence[Any], needs: Sequence[int], slack: int, budget: int) -> None:
    """Raises `Wrong` if some columns (cost, rows, charge) give every row what it needs, within slack and budget."""
    rows = [sum(1 << n for n, column in enumerate(columns) if row in column[1]) for row in range(len(needs))]
    costs, widest, steps = [column[0] for column in columns], max(len(one[1]) for one in columns), 0
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
            after = [need - (row in covers) for row, need in enumerate(needed)]
            rest = alive & ~reduce(or_, [rows[row] for row in covers if not after[row]], 0)
            stack += [(alive ^ low, needed, left, due), (rest, after, left - cost, due - charge)]
