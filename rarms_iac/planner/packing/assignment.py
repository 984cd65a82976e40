"""The choice of hosts as a program in whole numbers: a variable for each partition on each host that it may run on.

A host bounds what its partitions reserve, their memory, and what its cores can take (`THRESHOLDS`). Whether each
virtual processor finds a logical one is more than these rows say: where a set satisfies all of them and still finds no
places, it is forbidden when it comes up (`forbid`). Where first fit finds no packing, a few hosts at a time are packed
again by such a program until no partition is left over (`find_by_repacking`).
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from math import gcd, inf
from random import Random

from rarms_iac.model.capacity import Capacity, decide_fit, reserved_by_core
from rarms_iac.model.claims import WHOLE, Claim, DeadlineClaim
from rarms_iac.model.quantities import Bytes, LogicalProcessors
from rarms_iac.planner.packing.first_fit import partial_first_fit
from rarms_iac.planner.packing.highs import Nodes, Row, minimise
from rarms_iac.planner.packing.values import Bin, Item, free_in, is_move, least_cost

LARGEST_COEFFICIENT = 1_000_000
"""Above this they are rounded, so that they mean something in floating point; a host then seems larger."""

THRESHOLDS = range(5, WHOLE // 2 + 1, 5)
"""Reserves of a virtual processor, in per cent, below which a bound on what a host's cores take counts nothing."""


class Assignment:
    """The program of one packing; rows are added to it as stages are settled and sets turn out not to fit.

    Partitions and hosts are counted from 0, in the order given; a pair is a partition on a host.
    """

    def __init__(self, items: Sequence[Item], bins: Sequence[Bin]) -> None:
        """Write the program.

        Args:
            items: The partitions, each with the claims that its hosts can keep while nothing else is there.
        """
        self.items, self.bins = items, bins
        self.pairs = [
            (number, at)
            for number, item in enumerate(items)
            for at, host in enumerate(bins)
            if host.name in item.claims
        ]
        self.variables = {pair: variable for variable, pair in enumerate(self.pairs)}
        self.rows = list(self._rows())
        self.forbids_unproven = False  # whether a set was forbidden of which it is not known that it does not fit

    def excesses(self) -> tuple[list[int], int]:
        """Return by variable what its partition reserves there beyond its least, in units; and the unit in per cent."""
        excesses = [self._claim(pair).percent - least_cost(self.items[pair[0]]) for pair in self.pairs]
        unit = gcd(*excesses) or 1
        return [excess // unit for excess in excesses], unit

    def moves(self) -> list[int]:
        """Return by variable 1 where its partition would move, otherwise 0."""
        return [int(is_move(self.items[number], self.bins[at].name)) for number, at in self.pairs]

    def bound_costs(self, costs: Sequence[int], most: int) -> None:
        """Allow no packing that costs more than this.

        Args:
            costs: by variable, at least 0.
            most: the largest sum of the costs of variables that are 1.
        """
        self.rows.append(Row({variable: each for variable, each in enumerate(costs) if each}, -inf, most))

    def variables_of(self, host_of: Mapping[str, str]) -> list[int]:
        """Return the variables that are 1 in a packing.

        Args:
            host_of: the host of each partition, by names; each may be on it.

        Returns:
            One variable for each partition, in the partitions' order.
        """
        numbers = {host.name: at for at, host in enumerate(self.bins)}
        return [self.variables[number, numbers[host_of[item.name]]] for number, item in enumerate(self.items)]

    def host_of(self, variables: Sequence[int]) -> dict[str, str]:
        """Return the packing of which these variables are 1.

        Returns:
            The host of each partition, by names.
        """
        pairs = (self.pairs[variable] for variable in variables)
        return {self.items[number].name: self.bins[at].name for number, at in pairs}

    def forbid(self, variables: Sequence[int]) -> bool:
        """Forbid, on each host that cannot keep what these variables put there, a smallest part of it.

        Args:
            variables: those that are 1 in a solution of the rows.

        Returns:
            Whether anything had to be forbidden.
        """
        before = len(self.rows)
        for at, host in enumerate(self.bins):
            there = [number for number, place in (self.pairs[variable] for variable in variables) if place == at]
            can_hold = self._can_hold(host, there) if there else True
            if can_hold is None:
                self.forbids_unproven = True
                self._at_most(len(there) - 1, there, at)
            elif not can_hold:
                self._forbid_smallest_part(there, at)
        return len(self.rows) > before

    def _forbid_smallest_part(self, numbers: Sequence[int], at: int) -> None:
        """Forbid the part of these that already does not fit, and all that is larger, on every host alike."""
        host = self.bins[at]
        part = sorted(numbers, key=lambda number: self._claim((number, at)).percent)
        for number in tuple(part):
            without = [other for other in part if other != number]
            if self._can_hold(host, without) is False:
                part = without
        claims = [self._claim((number, at)) for number in part]
        for other, like in enumerate(self.bins):
            if (like.capacity, like.foreign_claims) != (host.capacity, host.foreign_claims):
                continue
            larger = [
                number
                for number, item in enumerate(self.items)
                if like.name in item.claims and all(_is_larger(item.claims[like.name], claim) for claim in claims)
            ]
            same = [number for number in part if self.items[number].claims.get(like.name) == self._claim((number, at))]
            if len(same) == len(part):
                self._at_most(len(part) - 1, sorted({*part, *larger}), other)

    def _at_most(self, most: int, numbers: Sequence[int], at: int) -> None:
        self.rows.append(Row({self.variables[number, at]: 1 for number in numbers}, -inf, most))

    def _can_hold(self, host: Bin, numbers: Sequence[int]) -> bool | None:
        claims = (self.items[number].claims[host.name] for number in numbers)
        return decide_fit(host.capacity, [*host.foreign_claims, *claims])

    def _claim(self, pair: tuple[int, int]) -> Claim:
        return self.items[pair[0]].claims[self.bins[pair[1]].name]

    def _rows(self) -> Iterator[Row]:
        for number, item in enumerate(self.items):
            hosts = [at for at, host in enumerate(self.bins) if host.name in item.claims]
            yield Row({self.variables[number, at]: 1 for at in hosts}, 1, 1)
        for at, host in enumerate(self.bins):
            free = free_in(host)
            there = [number for number, item in enumerate(self.items) if host.name in item.claims]
            claims = {self.variables[number, at]: self._claim((number, at)) for number in there}
            yield from _at_most_in_sum({variable: claim.percent for variable, claim in claims.items()}, free.percent)
            yield from _at_most_in_sum({variable: claim.memory for variable, claim in claims.items()}, free.memory)
            for threshold in THRESHOLDS:
                weights = {variable: _weight([claim], host.capacity, threshold) for variable, claim in claims.items()}
                foreign = _weight(host.foreign_claims, host.capacity, threshold)
                yield from _at_most_in_sum(weights, WHOLE * host.capacity.cores - foreign)


def _is_larger(claim: Claim, other: Claim) -> bool:
    """Return whether everything without room for the other has none for the claim."""
    if isinstance(other, DeadlineClaim) and (not isinstance(claim, DeadlineClaim) or claim.deadline < other.deadline):
        return False
    return claim.processors >= other.processors and claim.reserve >= other.reserve and claim.memory >= other.memory


def _weight(claims: Iterable[Claim], capacity: Capacity, threshold: int) -> int:
    """Return the weight of claims, of 100 a core: above 100 no core takes them.

    This is the bound of Martello and Toth (1990).

    A virtual processor that leaves less than the threshold of its core weighs all of it; one below it, nothing.
    """
    return sum(
        claim.processors * (WHOLE if claim.reserve > WHOLE - threshold else claim.reserve)
        for claim in reserved_by_core(claims, capacity)
        if claim.reserve >= threshold
    )


def _at_most_in_sum(sizes: Mapping[int, int], room: int) -> Iterator[Row]:
    """Yield the row that these sizes, by variable, fit the room, where they might not."""
    if sum(sizes.values()) <= room:
        return
    unit = gcd(*sizes.values()) or 1
    if room // unit > LARGEST_COEFFICIENT:
        unit = room // LARGEST_COEFFICIENT
    yield Row({variable: size // unit for variable, size in sizes.items() if size // unit}, -inf, -(-room // unit))


HOSTS = (2, 3, 4, 5)
"""Hosts that are packed again together."""

NODES = 20
"""Nodes of the search in one round: with more, or more hosts, fewer rounds are needed and each takes far longer."""

NOWHERE = ""
"""The host of those that are left over: everything has room there, and nothing should be."""


def find_by_repacking(items: Sequence[Item], bins: Sequence[Bin], nodes: Nodes) -> Mapping[str, str] | None:
    """Find any packing, good or not.

    Args:
        nodes: Of the solver, in all rounds.

    Returns:
        The host of each partition; None: no packing was found.
    """
    random = Random(0)  # noqa: S311  # no secret: the same rounds for the same partitions
    host_of = partial_first_fit(items, bins)
    by_name = {item.name: item for item in items}
    names = [host.name for host in bins]
    while True:
        left_over = [item for item in items if item.name not in host_of]
        if not left_over:
            return host_of
        if nodes.remaining <= 0:
            return None
        first = random.choice(sorted({name for item in left_over for name in item.claims}))
        chosen = {first, *random.sample(names, min(len(names), random.choice(HOSTS) - 1))}
        packed_anew = [by_name[name] for name, host in host_of.items() if host in chosen]
        packed_anew += [item for item in left_over if item.claims.keys() & chosen]
        packed = _pack_as_much_as_possible(packed_anew, [host for host in bins if host.name in chosen], host_of, nodes)
        host_of = {name: host for name, host in host_of.items() if host not in chosen} | packed


def _pack_as_much_as_possible(
    items: Sequence[Item], bins: Sequence[Bin], before: Mapping[str, str], nodes: Nodes
) -> dict[str, str]:
    """Return the hosts of those partitions that find room on these hosts; who is left over is as little as possible."""
    names = {host.name for host in bins}
    nothing = Claim(processors=0, reserve=0, memory=0)
    items = [
        replace(item, claims={NOWHERE: nothing} | {name: each for name, each in item.claims.items() if name in names})
        for item in sorted(items, key=lambda item: item.name)
    ]
    capacity = Capacity(logical_processors=0, processors=LogicalProcessors(Fraction(0)), memory=Bytes(0))
    program = Assignment(items, [Bin(name=NOWHERE, capacity=capacity), *bins])
    percent = 100 * max(1, *(host.capacity.logical_processors for host in bins))
    memory = max(1, *(host.capacity.memory for host in bins))
    costs = [0] * len(program.pairs)
    for variable, (number, at) in enumerate(program.pairs):
        if at == 0:
            claims = [claim for name, claim in items[number].claims.items() if name != NOWHERE]
            costs[variable] = (
                1
                + 1000 * max(claim.percent for claim in claims) // percent
                + 1000 * max(claim.memory for claim in claims) // memory
            )
    start = {item.name: before.get(item.name, NOWHERE) for item in items}
    answer = minimise(costs, program.rows, nodes=NODES, start=program.variables_of(start), budget=nodes)
    if answer.ones is not None and not program.forbid(answer.ones):
        start = program.host_of(answer.ones)
    return {name: host for name, host in start.items() if host != NOWHERE}
