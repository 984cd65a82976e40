"""Fewest moves, one set of hosts after another.

What a packing costs is the price of its hosts, so least cost leaves few sets of hosts to use; which of them is the
better choice is what a relaxation over all hosts sees worst, and what one over a single set need not see. Weights that
bound one set bound others too: most sets are never looked at.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

from rarms_iac.planner.packing.branch import Limits, Search
from rarms_iac.planner.packing.columns import SCALE, Weights, excess_of, relax
from rarms_iac.planner.packing.cover import covered
from rarms_iac.planner.packing.nearly_free import CloseFits
from rarms_iac.planner.packing.program import Bundles, Mask, Program, Sizes, charge_of, unpriced, value_of

MOST = 4_000
"""Sets of hosts that are looked at, at most."""

_STEPS = 50_000
"""Steps in which the sets are listed."""

_PENALTY = 50

Hosts = tuple[int, ...]
"""By kind: how many hosts of it are used."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ByHosts:
    """Nothing is better on any set of hosts that costs the budget: one of these says so, or all it leaves was tried."""

    weights: tuple[Weights, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fewest:
    """The best packing that was found, and what is known of better ones."""

    bundles: Bundles
    bound: int  # nothing costs less
    proof: ByHosts | None  # that nothing is better; None: not proved, or by search


def fewest_by_hosts(program: Program, known: Bundles, limits: Limits) -> Fewest | None:
    """The best packing, proved where the limits allow; None where sets of hosts are no way to look for it.

    Args:
        program: whose budget is the least that hosts cost; items cost nothing.
        known: a packing.
        limits: how much is tried.
    """
    alike = len({(kind.room, kind.charge) for kind in program.kinds}) == 1
    if alike or program.budget is None or any(any(kind.charges) for kind in program.kinds):
        return None
    below = value_of(program, known)
    first = _Bounding.by(program, _dearest(program))
    if first is None:
        return None
    sets = _affordable(program, first, below)
    if sets is None:
        return None
    volumes = [one for one in _volumes(program, below) if any(one.bound(hosts) >= below for hosts in sets)]
    left = [hosts for hosts in sets if all(one.bound(hosts) < below for one in volumes)]
    return _Search(program, known, limits, [first, *volumes], left).run()


def _dearest(program: Program) -> Weights:
    """By item what it costs at most: what stays where it is gains that."""
    return Weights(items=tuple(SCALE * max(kind.costs[at] for kind in program.kinds) for at in range(program.items)))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Bounding:
    """Weights, with what a host of each kind gains by them at most."""

    weights: Weights
    gains: tuple[int, ...]

    @classmethod
    def by(cls, program: Program, weights: Weights) -> "_Bounding | None":
        """None where some host's gain is not found."""
        alone = unpriced(program)
        gains = [excess_of(alone, at, weights) for at in range(len(program.kinds))]
        known = tuple(one for one in gains if one is not None)
        return cls(weights=weights, gains=known) if len(known) == len(gains) else None

    def bound(self, hosts: Hosts) -> int:
        """What no packing on these hosts can be below."""
        gained = sum([count * gain for count, gain in zip(hosts, self.gains, strict=True)])
        return -((gained - sum(self.weights.items)) // self.weights.scale)


def _volumes(program: Program, below: int) -> Iterator[_Bounding]:
    """By dimension: what items take at least, so heavy that hosts without room for all are bounded by so much."""
    for d, taken in enumerate(zip(*_least_sizes(program), strict=True)):
        items = tuple(SCALE * below * size for size in taken)
        gains = tuple(SCALE * below * kind.room[d] for kind in program.kinds)
        yield _Bounding(weights=Weights(items=items), gains=gains)


def _least_sizes(program: Program) -> list[Sizes]:
    """By item what it takes at least, dimension by dimension."""
    nothing = (0,) * len(program.kinds[0].room)
    by_item = [[size for kind in program.kinds if (size := kind.sizes[at])] for at in range(program.items)]
    return [tuple(map(min, zip(*sizes, strict=True))) if sizes else nothing for sizes in by_item]


def _affordable(program: Program, first: _Bounding, below: int) -> list[Hosts] | None:
    """The sets of hosts that cost the budget and are not bounded by so much; None where they are too many."""
    kinds = program.kinds
    prices = _sums_from([len(kind.hosts) * kind.charge for kind in kinds])
    gains = _sums_from([len(kind.hosts) * gain for kind, gain in zip(kinds, first.gains, strict=True)])
    # What hosts must gain together, at least, so that a packing on them may cost less.
    wanted = sum(first.weights.items) - (below - 1) * first.weights.scale
    found: list[Hosts] = []
    stack: list[tuple[Hosts, int, int]] = [((), program.budget or 0, wanted)]
    for _ in range(_STEPS):
        if not stack or len(found) > MOST:
            break
        hosts, due, missing = stack.pop()
        at = len(hosts)
        if not 0 <= due <= prices[at] or missing > gains[at]:
            continue
        if at == len(kinds):
            found.append(hosts)
            continue
        ways = range(len(kinds[at].hosts) + 1)
        stack += [((*hosts, n), due - n * kinds[at].charge, missing - n * first.gains[at]) for n in ways]
    return None if stack or len(found) > MOST else found


def _sums_from(numbers: Sequence[int]) -> list[int]:
    """By place: what the numbers from there on add up to."""
    return [*accumulate(reversed(numbers), initial=0)][::-1]


class _Search:
    """Best first over sets of hosts: relaxed at first, then tried at ever higher values."""

    def __init__(
        self, program: Program, known: Bundles, limits: Limits, simple: Sequence[_Bounding], sets: Sequence[Hosts]
    ) -> None:
        self.program, self.limits, self.sets = program, limits, sets
        self.best, self.upper = known, value_of(program, known)
        self.boundings = [*simple]
        self.simple = len(simple)
        self.relaxed: set[Hosts] = set()
        self.tried: dict[Hosts, tuple[int, int]] = {}  # below what value all was tried, and with which weights
        self.searched: dict[Hosts, int] = {}  # what branching bounded, without a certificate
        self.pool: set[tuple[int, Mask]] = set(known)
        self.patterns, self.steps = 0, limits.cover
        self.taken = tuple(map(sum, zip(*_least_sizes(program), strict=True)))
        self.alone = unpriced(program)

    def run(self) -> Fewest:
        """The best packing, proved where the limits allow."""
        while True:
            hosts = min(self.sets, key=self.bound, default=())
            lowest = self.bound(hosts) if hosts else self.upper
            if lowest >= self.upper:
                return Fewest(bundles=self.best, bound=self.upper, proof=self._proof())
            if self.patterns > self.limits.patterns:
                return Fewest(bundles=self.best, bound=lowest, proof=None)
            if hosts not in self.relaxed:
                self._relax(hosts)
            elif not self._try(hosts, lowest):
                return Fewest(bundles=self.best, bound=lowest, proof=None)

    def bound(self, hosts: Hosts) -> int:
        """What no packing on these hosts can be below."""
        return max(self.searched.get(hosts, 0), self._shown(hosts))

    def _shown(self, hosts: Hosts) -> int:
        """What of that has a certificate."""
        return max(self.tried.get(hosts, (0, 0))[0], self._weighed(hosts))

    def _weighed(self, hosts: Hosts) -> int:
        return max([one.bound(hosts) for one in self.boundings])

    def _relax(self, hosts: Hosts) -> None:
        self.relaxed.add(hosts)
        part, numbers = self._on(hosts)
        known = [(numbers.index(kind), mask) for kind, mask in sorted(self.pool) if kind in numbers]
        effort = replace(self.limits.effort, fully=True)
        found = relax(part, known, self.upper, _PENALTY * max(1, self.upper), effort)
        if found is None:
            return
        self.patterns += found.patterns
        self.pool.update((numbers[kind], mask) for kind, mask, _ in found.parts)
        bounding = _Bounding.by(self.program, found.weights)
        if bounding is not None:
            self.boundings.append(bounding)

    def _try(self, hosts: Hosts, lowest: int) -> bool:
        """Try all packings on these hosts that cost so much; whether that told something."""
        part, numbers = self._on(hosts)
        at = max(range(len(self.boundings)), key=lambda number: self._strength(number, hosts))
        close = CloseFits(most=self._spare(hosts), fills=(None,) * len(numbers))
        found = covered(part, self.boundings[at].weights, lowest, lowest + 1, self.steps, close)
        self.steps -= found.steps
        if found.bundles is not None:
            self._take(tuple((numbers[kind], mask) for kind, mask in found.bundles))
            return True
        if found.lowest > lowest:
            self.tried[hosts] = (found.lowest, at)
            return True
        return self._search(hosts, part, numbers)

    def _search(self, hosts: Hosts, part: Program, numbers: Sequence[int]) -> bool:
        """Branch and price on these hosts alone; whether it came to an end."""
        search = Search(part, None, replace(self.limits, cover=self.limits.cover_below), ceiling=self.upper)
        found = search.run()
        self.patterns += search.patterns
        if found.bundles is not None:
            self._take(tuple((numbers[kind], mask) for kind, mask in found.bundles))
        if found.bound < self.upper:
            return False
        self.searched[hosts] = found.bound
        return True

    def _strength(self, number: int, hosts: Hosts) -> tuple[float, int]:
        one = self.boundings[number]
        gained = sum(count * gain for count, gain in zip(hosts, one.gains, strict=True))
        return (sum(one.weights.items) - gained) / one.weights.scale, -number

    def _take(self, bundles: Bundles) -> None:
        assert charge_of(self.program, bundles) == self.program.budget, "less than the least is not paid"
        self.best, self.upper = tuple(sorted(bundles)), value_of(self.program, bundles)
        self.pool.update(bundles)

    def _on(self, hosts: Hosts) -> tuple[Program, list[int]]:
        """The program of these hosts alone, and by its kinds the numbers of ours."""
        numbers = [at for at, count in enumerate(hosts) if count]
        kinds = [replace(self.alone.kinds[at], hosts=self.alone.kinds[at].hosts[: hosts[at]]) for at in numbers]
        fits = self.program.fits
        part = replace(
            self.alone,
            kinds=tuple(kinds),
            fits=(lambda at, items: fits(numbers[at], items)) if fits else None,
        )
        return part, numbers

    def _spare(self, hosts: Hosts) -> Sizes:
        """By dimension: what is left on these hosts together, at most."""
        used = list(zip(hosts, self.program.kinds, strict=True))
        rooms = [sum(count * kind.room[d] for count, kind in used) for d in range(len(self.taken))]
        return tuple(map(int.__sub__, rooms, self.taken))

    def _proof(self) -> ByHosts | None:
        """Few of the weights that show together what was found: by themselves, or with all tried that they leave."""
        if any(self._shown(hosts) < self.upper for hosts in self.sets):
            return None
        chosen = {*range(self.simple)}  # they rule out the sets that were not looked at
        chosen |= {self.tried[hosts][1] for hosts in self.sets if self._weighed(hosts) < self.upper}
        left = [hosts for hosts in self.sets if self._weighed(hosts) >= self.upper]
        while left := [one for one in left if max(self.boundings[at].bound(one) for at in chosen) < self.upper]:
            shown = [sum(one.bound(hosts) >= self.upper for hosts in left) for one in self.boundings]
            chosen.add(shown.index(max(shown)))
        return ByHosts(weights=tuple(self.boundings[at].weights for at in sorted(chosen)))
