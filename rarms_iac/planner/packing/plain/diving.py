"""Packings out of a relaxation: its largest parts become whole bins, what is left is relaxed again, and so on."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from random import Random

from rarms_iac.planner.packing.plain.completion import completed
from rarms_iac.planner.packing.plain.cutting import Looks, Relaxation, relaxed
from rarms_iac.planner.packing.plain.demand import Demand, Pattern, left_of
from rarms_iac.planner.packing.plain.filling import filled

_NEAR = 0.02
"""What the bins of a relaxation may be above a whole number: it is not looked for patterns to the very end."""

_HALF = 0.5

_NONE = 1e-3

_AT_ONCE = 6
"""Of the bins that are left one in so many becomes whole at a time."""

_THOUGHTS = 4
"""How often other parts become whole where the first left too little."""

_LOOKS = Looks(rounds=12, nodes=4_000, sure=False)

_AT_LEAST = 2_000
"""What a relaxation counts as at least."""

_FEW = 45
"""Items that are left at most where every way to complete a packing is tried, in so many steps."""

_STEPS = 3_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Dive:
    """The fewest bins that a dive found."""

    patterns: tuple[Pattern, ...]
    work: int  # of its relaxations


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """How a dive goes."""

    work: int  # of its relaxations, after which it ends
    random: Random | None  # which parts become whole is shaken; None: the largest
    own: bool  # our own linear program, whatever is installed


def dive(demand: Demand, start: Relaxation, target: int, limits: Limits) -> Dive:
    """One way down; it ends early where the bins are no more than `target`.

    Args:
        demand: what is packed.
        start: its relaxation.
        target: so few bins are wanted.
        limits: how it goes.
    """
    counts, taken, now, thoughts, used = list(demand.counts), list[Pattern](), start, 0, 0
    best = tuple(filled(demand, start.weights))
    while any(counts) and len(best) > target and used < limits.work:
        chosen = _largest(now, replace(demand, counts=tuple(counts)), thoughts, limits.random)
        if not chosen:
            break
        rest = replace(demand, counts=tuple(left_of(counts, chosen)))
        more = _to_the_end(rest, now, target - len(taken) - len(chosen))
        if len(taken) + len(chosen) + len(more) < len(best):
            best = (*taken, *chosen, *more)
        if not any(rest.counts):
            break
        again = relaxed(rest, _possible(rest, now.pool), 0, replace(_LOOKS, own=limits.own))
        used += again.work + _AT_LEAST
        if len(taken) + len(chosen) + again.value > target + _NEAR and thoughts < _THOUGHTS:
            thoughts += 1
            continue
        if len(taken) + len(chosen) + again.value > len(best) - 1 + _NEAR:
            break
        counts, now, thoughts = list(rest.counts), again, 0
        taken += chosen
    return Dive(patterns=best, work=used)


def _to_the_end(rest: Demand, now: Relaxation, bins: int) -> list[Pattern]:
    """What is left as bins: into so few where that is found."""
    found = filled(rest, now.weights)
    if len(found) > bins and sum(rest.counts) <= _FEW:
        return completed(rest, bins, _STEPS) or found
    return found


def _largest(now: Relaxation, demand: Demand, thoughts: int, random: Random | None) -> list[Pattern]:
    """The bins that become whole: those that are so already, and of the largest parts some; one on second thoughts."""
    shaken = [(part * (1 + random.random()) if random and part < 1 - _NONE else part, one) for one, part in now.parts]
    ranked = sorted(shaken, key=lambda one: (-one[0], one[1]))
    bins = sum(part for _, part in now.parts)
    most = 1 if thoughts else max(1, round(bins / _AT_ONCE))
    left, chosen = list(demand.counts), list[Pattern]()
    for part, pattern in ranked[max(0, thoughts - 1) :]:
        several = int(part + _NONE)
        if several == 0 and chosen and (len(chosen) >= most or part < _HALF):
            break
        for _ in range(max(1, several)):
            own = _there(demand, pattern, left)
            if own:
                chosen.append(own)
                left = left_of(left, [own])
    return chosen


def _there(demand: Demand, pattern: Pattern, left: Sequence[int]) -> Pattern:
    """The pattern out of what is left: for what is not there any more, the next that is no larger."""
    own: dict[int, int] = {}
    for number, count in pattern:
        size, wanted = demand.sizes[number], count
        for at in range(number, len(left)):
            if wanted == 0:
                break
            if left[at] > own.get(at, 0) and all(map(int.__le__, demand.sizes[at], size)):
                some = min(wanted, left[at] - own.get(at, 0))
                own[at] = own.get(at, 0) + some
                wanted -= some
    return tuple(sorted(own.items()))


def _possible(demand: Demand, pool: Iterable[Pattern]) -> list[Pattern]:
    return [pattern for pattern in pool if all(demand.counts[at] >= count for at, count in pattern)]
