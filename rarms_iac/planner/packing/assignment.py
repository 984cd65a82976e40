"""The choice of hosts as a program in whole numbers: a variable for each partition on each host that it may run on.

A host bounds what its partitions reserve, their memory, and what their virtual processors take of its logical ones. The
last is exact only with cuts: rows made of dual feasible functions hold for every set that can be laid onto logical
processors, and a set that satisfies them all and still cannot be laid is forbidden when it comes up (`forbid`).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import gcd, inf

from rarms_iac.model.capacity import holds
from rarms_iac.model.claims import WHOLE, Claim
from rarms_iac.planner.packing.highs import Row
from rarms_iac.planner.packing.values import Bin, Item, cost, free_in, least_cost

LARGEST = 1_000_000
"""Coefficients above this are rounded, so that they mean something in floating point; a host then seems larger."""

THRESHOLDS = 4
"""Reserves, the largest up to half a logical processor, below which virtual processors are left out of a row."""


class Assignment:
    """The program of one packing; rows are added to it as levels are settled and sets turn out not to fit."""

    def __init__(self, items: Sequence[Item], bins: Sequence[Bin]) -> None:
        """Write the program.

        Args:
            items: The partitions, each with the claims that its hosts can keep while nothing else is there.
            bins: The hosts.
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
        self.unsure = False  # whether a set was forbidden of which it is not known that it does not fit

    def excesses(self) -> tuple[list[int], int]:
        """Return by variable what its partition reserves there beyond its least, in units; and the unit in per cent."""
        more = [cost(self._claim(pair)) - least_cost(self.items[pair[0]]) for pair in self.pairs]
        unit = gcd(*more) or 1
        return [amount // unit for amount in more], unit

    def moves(self) -> list[int]:
        """Return by variable 1 where its partition would move, otherwise 0."""
        return [int(self.items[number].now not in ("", self.bins[at].name)) for number, at in self.pairs]

    def limit(self, costs: Sequence[int], most: int) -> None:
        """Allow no packing that costs more than this."""
        self.rows.append(Row({variable: each for variable, each in enumerate(costs) if each}, -inf, most))

    def chosen(self, hosts: Mapping[str, str]) -> list[int]:
        """Return the variables that are 1 in a packing."""
        numbers = {host.name: at for at, host in enumerate(self.bins)}
        return [self.variables[number, numbers[hosts[item.name]]] for number, item in enumerate(self.items)]

    def hosts(self, ones: Sequence[int]) -> dict[str, str]:
        """Return the packing of which these variables are 1."""
        return {
            self.items[number].name: self.bins[at].name for number, at in (self.pairs[variable] for variable in ones)
        }

    def forbid(self, ones: Sequence[int]) -> bool:
        """Forbid, on each host that cannot keep what these variables put there, a smallest part of it.

        Returns:
            Whether anything had to be forbidden.
        """
        before = len(self.rows)
        for at, host in enumerate(self.bins):
            there = [number for number, where in (self.pairs[variable] for variable in ones) if where == at]
            held = self._holds(host, there) if there else True
            if held is None:
                self.unsure = True
                self._at_most(len(there) - 1, there, at)
            elif not held:
                self._forbid(there, at)
        return len(self.rows) > before

    def _forbid(self, numbers: Sequence[int], at: int) -> None:
        """Forbid the part of these that already does not fit, and whatever is larger, on every host alike."""
        host = self.bins[at]
        part = sorted(numbers, key=lambda number: cost(self._claim((number, at))))
        for number in tuple(part):
            without = [other for other in part if other != number]
            if self._holds(host, without) is False:
                part = without
        claims = [self._claim((number, at)) for number in part]
        for other, like in enumerate(self.bins):
            if (like.capacity, like.taken) != (host.capacity, host.taken):
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

    def _holds(self, host: Bin, numbers: Sequence[int]) -> bool | None:
        return holds(host.capacity, [*host.taken, *(self.items[number].claims[host.name] for number in numbers)])

    def _claim(self, pair: tuple[int, int]) -> Claim:
        return self.items[pair[0]].claims[self.bins[pair[1]].name]

    def _rows(self) -> Iterator[Row]:
        for number, item in enumerate(self.items):
            yield Row(
                {self.variables[number, at]: 1 for at, host in enumerate(self.bins) if host.name in item.claims}, 1, 1
            )
        for at, host in enumerate(self.bins):
            there = [number for number, item in enumerate(self.items) if host.name in item.claims]
            free = free_in(host)
            claims = {self.variables[number, at]: self._claim((number, at)) for number in there}
            yield from _summed({variable: cost(claim) for variable, claim in claims.items()}, free.percent)
            yield from _summed({variable: claim.memory for variable, claim in claims.items()}, free.memory)
            yield from _laid(claims, host)


def _is_larger(claim: Claim, other: Claim) -> bool:
    """Whether whatever has no room for the other has none for the claim."""
    return claim.processors >= other.processors and claim.reserve >= other.reserve and claim.memory >= other.memory


def _summed(sizes: Mapping[int, int], room: int) -> Iterator[Row]:
    """Yield the row that these sizes fit the room, and rows that then hold too and cut fractions off."""
    yield from _bounded(sizes, room)
    if room > 0 and sum(sizes.values()) > room:
        for weigh, most in _functions(room, ()):
            yield from _bounded({variable: weigh(size) for variable, size in sizes.items()}, most)


def _bounded(sizes: Mapping[int, int], room: int) -> Iterator[Row]:
    """Yield the row that these sizes fit the room, where they might not."""
    if sum(sizes.values()) <= room:
        return
    unit = gcd(*sizes.values()) or 1
    if room // unit > LARGEST:
        unit = room // LARGEST
    yield Row({variable: size // unit for variable, size in sizes.items() if size // unit}, -inf, -(-room // unit))


def _laid(claims: Mapping[int, Claim], host: Bin) -> Iterator[Row]:
    """Yield rows that hold whenever every virtual processor has a logical one, where they are not of equal number."""
    everybody = [*claims.values(), *host.taken]
    if all(claim.processors == host.capacity.logical_processors for claim in everybody if claim.reserve):
        return
    for weigh, whole in _functions(WHOLE, sorted({claim.reserve for claim in everybody if claim.reserve})):
        taken = sum(claim.processors * weigh(claim.reserve) for claim in host.taken)
        weights = {variable: claim.processors * weigh(claim.reserve) for variable, claim in claims.items()}
        yield from _bounded(weights, host.capacity.logical_processors * whole - taken)


def _functions(room: int, sizes: Sequence[int]) -> Iterator[tuple[Callable[[int], int], int]]:
    """Yield dual feasible functions: sizes that share a room never weigh more than the number beside the function.

    Source: S. P. Fekete, J. Schepers, "New classes of fast lower bounds for bin packing problems", 2001.
    """

    def rounded(parts: int) -> Callable[[int], int]:
        def weigh(size: int) -> int:
            whole, rest = divmod((parts + 1) * size, room)
            return whole * room if rest else parts * size

        return weigh

    def without_small(threshold: int) -> Callable[[int], int]:
        return lambda size: room if size > room - threshold else size if size >= threshold else 0

    for parts in (1, 2, 3):
        yield rounded(parts), parts * room
    for threshold in [size for size in sizes if 2 * size <= room][-THRESHOLDS:]:
        yield without_small(threshold), room
