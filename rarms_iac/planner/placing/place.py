"""Partitions onto hosts: least reservation in all, then fewest moves, then names (DESIGN section 3, The problem).

Up to 30 partitions are packed exactly, and so are up to 30 that are free to move beside more that are not. Larger
problems take the best of several ways (`many.py`), and say how far from the bound that may be.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

from rarms_iac.model.plan import Claim
from rarms_iac.planner.packing.program import Problem
from rarms_iac.planner.placing.first_fit import Bin, Item, all_hold, cost, first_fit, free_in
from rarms_iac.planner.placing.in_numbers import gave_up, in_whole_numbers

if TYPE_CHECKING:  # the search is imported where there is something to search
    from rarms_iac.planner.packing.solve import Impossible, Packed

EXACT_UP_TO = 30
"""Partitions that the exact search takes on."""

CERTIFIED_UP_TO = 200
"""Partitions of which a certificate is made where each is where it costs least: of more it takes too long."""

NODES = 4_000
"""Placements tried for the first by name of the best ones, before another of them is taken: a count, never a time."""


class Verdict(StrEnum):
    """What is known of better placements."""

    OPTIMAL = "optimal"  # there are none: a certificate says so, and the checker accepted it
    SEARCHED = "proved by search, not certified"
    WITHIN = "within the bound"  # see the bounds


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """A placement, or that there is none; `proven`: there is no better one, or none at all."""

    hosts: Mapping[str, str] | None  # partition -> host
    proven: bool
    chosen: bool = False  # whether there was anything to choose
    value: tuple[int, int] = (0, 0)  # reservation in per cent of one logical processor, moves
    bound: tuple[int, int] = (0, 0)  # no placement has less
    avoided: int = 0  # moves that packing the same onto hosts where nothing of it runs would have made beside those
    packed: tuple[str, ...] = ()  # partitions of which the problem is, in its order: those that had a choice
    among: tuple[str, ...] = ()  # the hosts that were to be chosen from
    problem: Problem | None = None  # where something was to be chosen exactly
    result: "Packed | Impossible | None" = None


def place(items: Sequence[Item], bins: Sequence[Bin]) -> Found:
    """The best placement that was found; the same input always gives the same one."""
    ordered, hosts = sorted(items, key=lambda one: one.name), sorted(bins, key=lambda one: one.name)
    if any(not one.claims for one in ordered) or _too_much(ordered, hosts):
        return Found(hosts=None, proven=True)
    if all(len(one.claims) == 1 for one in ordered):
        only = {item.name: next(iter(item.claims)) for item in ordered}
        held = all_hold(ordered, hosts, only)
        return Found(hosts=only if held else None, proven=held is not None)
    if len(ordered) <= EXACT_UP_TO:
        return _exactly(ordered, hosts)
    return _beyond(ordered, hosts)


def _beyond(items: Sequence[Item], bins: Sequence[Bin]) -> Found:
    """More than the exact search takes on: exactly all the same where few are free, or as well as is found."""
    free = [one for one in items if len(one.claims) > 1]
    if len(free) <= EXACT_UP_TO:
        return _beside(free, [one for one in items if len(one.claims) == 1], bins)
    quick = first_fit(items, bins)
    bound = _bound(items)
    if quick is None or _value(items, quick) != bound:
        from rarms_iac.planner.placing.many import place_many
        from rarms_iac.planner.placing.staying import staying

        stay = staying(items, bins)
        better = place_many(items, bins, stay.names, (bound[0], stay.moves), _repacked)
        quick = min(filter(None, (better, quick)), key=lambda one: _value(items, one), default=None)
        if quick is None:
            return Found(hosts=None, proven=False)
        cheapest = _value(items, quick)[0] == bound[0]
        bound = (bound[0], stay.moves if cheapest else stay.moves_at_all)
    value = _value(items, quick)
    found = Found(
        hosts=quick,
        proven=value == bound,
        chosen=True,
        value=value,
        bound=bound,
        avoided=_avoided(items, _surely_anew(items, bins), value),
    )
    simply = value == (bound[0], 0) == _bound(items) and len(items) <= CERTIFIED_UP_TO
    return _at_their_least(found, items, bins) if simply else found


def _at_their_least(found: Found, items: Sequence[Item], bins: Sequence[Bin]) -> Found:
    """The same with its proof: each partition is where it costs least, and none moves."""
    from rarms_iac.planner.packing.branch import Proof
    from rarms_iac.planner.packing.columns import Weights
    from rarms_iac.planner.packing.solve import Level, Packed

    assert found.hosts is not None
    numbers = {one.name: at for at, one in enumerate(bins)}
    least = tuple(min(map(cost, one.claims.values())) for one in items)
    cheapest = Level(value=sum(least), bound=sum(least), proof=Proof(weights=Weights(items=least, scale=1)))
    where = tuple(numbers[found.hosts[one.name]] for one in items)
    return replace(
        found,
        packed=tuple(one.name for one in items),
        among=tuple(numbers),
        problem=in_whole_numbers(items, bins),
        result=Packed(hosts=where, cost=cheapest, moves=Level(value=0, bound=0, proof=None)),
    )


def _surely_anew(items: Sequence[Item], bins: Sequence[Bin]) -> Mapping[str, str] | None:
    """Where the same would be if nothing of it ran, as far as that needs no search; None: it does, or nothing runs."""
    if not any(one.now for one in items):
        return None
    nobody = [replace(one, now="") for one in items]
    quick = first_fit(nobody, bins)
    return quick if quick is not None and _value(nobody, quick) == _bound(nobody) else None


def _beside(free: Sequence[Item], fixed: Sequence[Item], bins: Sequence[Bin]) -> Found:
    """Those that can be in several places, beside those that can be in one: these are what their hosts hold anyway."""
    only = {one.name: next(iter(one.claims)) for one in fixed}
    there: dict[str, list[Claim]] = {one.name: list(one.taken) for one in bins}
    for one in fixed:
        there[only[one.name]].append(one.claims[only[one.name]])
    held = all_hold(fixed, bins, only)
    if not held:
        return Found(hosts=None, proven=held is not None)
    found = _exactly(free, [replace(one, taken=tuple(there[one.name])) for one in bins])
    if found.hosts is None:
        return Found(hosts=None, proven=found.proven)
    more = _value(fixed, only)
    hosts = {**found.hosts, **only}
    return replace(
        found,
        hosts={name: hosts[name] for name in sorted(hosts)},
        value=(found.value[0] + more[0], found.value[1] + more[1]),
        bound=(found.bound[0] + more[0], found.bound[1] + more[1]),
    )


def _repacked(items: Sequence[Item], bins: Sequence[Bin]) -> Mapping[str, str] | None:
    """A few partitions on a few hosts, as well as a short search packs them."""
    from rarms_iac.planner.packing.branch import Limits
    from rarms_iac.planner.packing.solve import Packed, Settings, solve

    names = {one.name for one in bins}
    inside = [
        replace(one, claims={host: claim for host, claim in one.claims.items() if host in names}) for one in items
    ]
    limits = Limits(nodes=4, dives=2, first_dive=8, dive=4, patterns=200, cover=20_000, cover_below=1_000)
    result = solve(in_whole_numbers(inside, bins), Settings(limits=limits, tries=20))
    if not isinstance(result, Packed):
        return None
    return {item.name: bins[at].name for item, at in zip(items, result.hosts, strict=True)}


def _exactly(items: Sequence[Item], bins: Sequence[Bin]) -> Found:
    from rarms_iac.planner.packing.solve import Impossible, Packed, solve

    problem = in_whole_numbers(items, bins)
    result = solve(problem)
    if not isinstance(result, Packed):
        impossible = result if isinstance(result, Impossible) else None
        proven = impossible is not None and not gave_up(problem)
        return Found(hosts=None, proven=proven, problem=problem, result=impossible)
    value = (result.cost.value, result.moves.value)
    # What was taken not to fit may fit where that was not known: then nothing is known of better ones.
    bound = _bound(items) if gave_up(problem) else (result.cost.bound, result.moves.bound)
    proven = value == bound
    where = (_first_by_name(problem, value) if proven else None) or result.hosts
    return Found(
        hosts={item.name: bins[at].name for item, at in zip(items, where, strict=True)},
        proven=proven,
        chosen=True,
        value=value,
        bound=bound,
        avoided=_avoided(items, _anew(items, bins, problem, result), value),
        packed=tuple(one.name for one in items),
        among=tuple(one.name for one in bins),
        problem=problem,
        result=Packed(hosts=where, cost=result.cost, moves=result.moves),
    )


def _anew(items: Sequence[Item], bins: Sequence[Bin], problem: Problem, result: "Packed") -> Mapping[str, str] | None:
    """Where the same would be if nothing of it ran: the first level, and of those as cheap the first by name."""
    if not result.anew:
        return None
    nobody = replace(problem, now=(None,) * problem.items)
    cheapest = result.cost.value == result.cost.bound
    where = (_first_by_name(nobody, (result.cost.value, 0)) if cheapest else None) or result.anew
    return {item.name: bins[at].name for item, at in zip(items, where, strict=True)}


def _avoided(items: Sequence[Item], anew: Mapping[str, str] | None, value: tuple[int, int]) -> int:
    return 0 if anew is None else max(0, _value(items, anew)[1] - value[1])


def _first_by_name(problem: Problem, value: tuple[int, int]) -> tuple[int, ...] | None:
    """Of the placements of that value the first by name; None where that would take too long."""
    items, hosts = range(problem.items), range(len(problem.rooms))
    allowed = [[host for host in hosts if problem.sizes[host][item] is not None] for item in items]
    least = [0] * (problem.items + 1)
    for item in reversed(items):
        least[item] = least[item + 1] + min(problem.costs[host][item] for host in allowed[item])
    nodes = NODES
    there: list[list[int]] = [[] for _ in hosts]
    free = [list(room) for room in problem.rooms]
    where: list[int] = []

    def down(item: int, spent: int, moved: int) -> bool:
        nonlocal nodes
        if spent + least[item] > value[0] or moved > value[1] or nodes <= 0:
            return False
        if item == problem.items:
            return True
        for host in allowed[item]:
            nodes -= 1
            size = problem.sizes[host][item]
            assert size is not None, "the host is allowed"
            if any(takes > left for takes, left in zip(size, free[host], strict=True)):
                continue
            there[host].append(item)
            if problem.fits is None or problem.fits(host, there[host]):
                before, free[host] = free[host], [left - takes for takes, left in zip(size, free[host], strict=True)]
                where.append(host)
                moves = problem.now[item] not in (None, host)
                if down(item + 1, spent + problem.costs[host][item], moved + moves):
                    return True
                where.pop()
                free[host] = before
            there[host].pop()
        return False

    return tuple(where) if down(0, 0, 0) else None


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
