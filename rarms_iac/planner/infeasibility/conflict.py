"""A smallest set of partitions that cannot share the hosts that they may run on, found by leaving others out.

The search is limited in solver nodes: a limit in seconds would give other answers on other computers. A conflict may be
there only because reserves are rounded up to whole per cent of each virtual processor (`describe_rounding`).
"""

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from itertools import accumulate

from rarms_iac.model.claims import Claim
from rarms_iac.model.quantities import LogicalProcessors, guaranteed
from rarms_iac.planner.packing.highs import Nodes
from rarms_iac.planner.packing.pack import can_pack, without_hopeless_claims
from rarms_iac.planner.packing.values import Bin, Item, free_in, free_on, least_cost, least_memory
from rarms_iac.planner.problem import Problem
from rarms_iac.planner.reservations import depends_on_a_log
from rarms_iac.planner.sizes import wanted_reserve
from rarms_iac.planner.verdicts import NotMeasured
from rarms_iac.texts.messages import counted, in_a_row, natural_order
from rarms_iac.texts.quantities import show_processors

NODES_FOR_A_CONFLICT = 50
"""Solver nodes of the search for a smallest conflict."""

NODES_FOR_MOVES = 50
"""Solver nodes of the search for the fewest partitions that have to move."""

NODES_FOR_CHANGES = 100
"""Solver nodes of the search for changes of the manifest, of all kinds together."""

NODES_OF_A_SEARCH = NODES_FOR_A_CONFLICT + NODES_FOR_MOVES + NODES_FOR_CHANGES

ITERATIONS_OF_A_NODE = 100
"""Iterations of the simplex method that count as one node."""

PAIRS_OF_A_NODE = 2_000
"""Pairs of a partition and a host in first fit that count as one node."""

FEWEST_PAIRS = 500
"""Each run of first fit counts as at least this number of pairs."""


@dataclass(slots=True)
class SearchBudget:
    """The remaining nodes of a search, and the parts of it that reached the limit."""

    nodes: Nodes
    unfinished: dict[str, None] = field(default_factory=dict)  # in order
    _pairs: int = 0  # of first fit, less than one node

    @classmethod
    def of(cls, nodes: int) -> "SearchBudget":
        """Return a new budget.

        Args:
            nodes: The number of the solver's nodes that it allows.
        """
        return cls(Nodes(nodes, ITERATIONS_OF_A_NODE))

    def takes(self, part: str, pairs: int) -> bool:
        """Count a run of first fit, if nodes remain.

        Args:
            pairs: The number of pairs of a partition and a host that it may be on.

        Returns:
            Whether first fit may run; if not, the part counts as unfinished.
        """
        if self.nodes.remaining <= 0:
            self.unfinished[part] = None
            return False
        spent, self._pairs = divmod(self._pairs + max(FEWEST_PAIRS, pairs), PAIRS_OF_A_NODE)
        self.nodes.remaining -= spent
        return True


_SMALLER_CONFLICT = "a smaller set of partitions that conflict"


class Lack(Enum):
    """The lack of the hosts of a conflict."""

    PROCESSORS = "processors"  # in sum
    MEMORY = "memory"  # in sum
    PLACEMENT = "placement"  # the sums are enough, and there is no way to place the partitions


@dataclass(frozen=True, slots=True, kw_only=True)
class Conflict:
    """Partitions that do not fit together on the hosts that any of them may run on."""

    items: Sequence[Item]  # by name
    bins: Sequence[Bin]
    lacking: Lack
    proven: bool = True  # otherwise it is only that nothing was found


def conflicts(items: Sequence[Item], bins: Sequence[Bin], budget: SearchBudget, *, proven: bool) -> Sequence[Conflict]:
    """Find who conflicts, by processors and by memory where each of the two is too little.

    Args:
        items: Partitions of which no packing was found.

    Returns:
        One or two conflicts. Without any one of its partitions the rest of each would fit, if the budget was enough
        for the search; otherwise `budget.unfinished` says so.
    """
    return conflicts_by_sums(items, bins) or [_by_packing(items, bins, budget, proven=proven)]


def evident_conflicts(items: Sequence[Item], bins: Sequence[Bin]) -> Sequence[Conflict]:
    """Find who conflicts where no search is needed to see it, and so no solver.

    Args:
        items: Partitions with at least one claim each.

    Returns:
        Partitions that no host can hold, each alone; else who needs too much in sum; else, where no partition has a
        choice, who finds no place for virtual processors. Empty: nothing is evident, which proves no layout.
    """
    placeable, bins = without_hopeless_claims(items, bins)
    hopeless = {item.name for item in placeable if not item.claims}
    if hopeless:
        return [_alone(item, bins) for item in _by_name(items) if item.name in hopeless]
    found = conflicts_by_sums(placeable, bins)
    if found or any(len(item.claims) > 1 for item in placeable) or can_pack(placeable, bins) is not False:
        return found
    return [_by_packing(placeable, bins, conflict_budget(), proven=True)]


def conflict_budget() -> SearchBudget:
    """Return the budget of the search for a smallest conflict."""
    return SearchBudget.of(NODES_FOR_A_CONFLICT)


def _alone(item: Item, bins: Sequence[Bin]) -> Conflict:
    hosts = _hosts_of([item], bins)
    memory = all(item.claims[host.name].memory > free_in(host).memory for host in hosts)
    return Conflict(items=[item], bins=hosts, lacking=Lack.MEMORY if memory else Lack.PROCESSORS)


def conflicts_by_sums(items: Sequence[Item], bins: Sequence[Bin]) -> Sequence[Conflict]:
    """Find who needs more processors or memory in sum than the hosts have; empty: the sums do not show it.

    Args:
        items: Partitions with at least one claim each.
    """
    processors = _fewest_beyond(items, bins, least_cost, lambda host: free_in(host).percent)
    memory = _fewest_beyond(items, bins, least_memory, lambda host: free_in(host).memory)
    return [
        Conflict(items=_by_name(fewest), bins=_hosts_of(fewest, bins), lacking=lacking)
        for lacking, fewest in ((Lack.PROCESSORS, processors), (Lack.MEMORY, memory))
        if fewest
    ]


def _by_name(items: Sequence[Item]) -> Sequence[Item]:
    return sorted(items, key=lambda item: natural_order(item.name))


def _hosts_of(items: Sequence[Item], bins: Sequence[Bin]) -> Sequence[Bin]:
    """Return the hosts that any of the partitions may run on."""
    names = {name for item in items for name in item.claims}
    return [host for host in bins if host.name in names]


def _groups(items: Sequence[Item]) -> Iterator[Sequence[Item]]:
    """Yield partitions that must find room among few hosts, the fewest hosts first; all of them last."""
    few = sorted({tuple(sorted(item.claims)) for item in items}, key=lambda names: (len(names), names))
    for names in few:
        group = [item for item in items if item.claims.keys() <= set(names)]
        if len(group) < len(items):
            yield group
    yield items


def _fewest_beyond(
    items: Sequence[Item], bins: Sequence[Bin], need: Callable[[Item], int], room: Callable[[Bin], int]
) -> Sequence[Item]:
    """Return the fewest of a group that need more than its hosts have in sum; empty: no group does."""
    found: list[Sequence[Item]] = []
    for group in _groups(items):
        ordered = sorted(group, key=lambda item: (-need(item), natural_order(item.name)))
        fitting = bisect_right(
            [*accumulate(map(need, ordered))], sum(max(0, room(host)) for host in _hosts_of(group, bins))
        )
        if fitting < len(group):
            found.append(ordered[: fitting + 1])
    return min(found, key=lambda fewest: (len(fewest), [item.name for item in fewest]), default=())


def _by_packing(items: Sequence[Item], bins: Sequence[Bin], budget: SearchBudget, *, proven: bool) -> Conflict:
    """Leave out the small ones first, by halves, quarters and so on, as long as those that stay still conflict."""
    smallest = True

    def conflict(remaining: Sequence[Item]) -> bool:
        nonlocal smallest
        if not remaining:
            return False
        may_ask = budget.takes(_SMALLER_CONFLICT, sum(len(item.claims) for item in remaining))
        fits = can_pack(remaining, _hosts_of(remaining, bins), nodes=budget.nodes) if may_ask else None
        smallest = smallest and fits is not None
        return fits is False

    start = next((group for group in _groups(items) if len(group) < len(items) and conflict(group)), items)
    if start is items and not proven:
        return Conflict(items=_by_name(items), bins=_hosts_of(items, bins), proven=False, lacking=Lack.PLACEMENT)
    remaining = sorted(start, key=lambda item: (least_cost(item), least_memory(item), natural_order(item.name)))
    step = len(remaining)
    while step > 1:
        step = -(-step // 2)
        at = 0
        while at < len(remaining):
            without = remaining[:at] + remaining[at + step :]
            if conflict(without):
                remaining = without
            else:
                at += step
    if not smallest:
        budget.unfinished[_SMALLER_CONFLICT] = None
    return Conflict(items=_by_name(remaining), bins=_hosts_of(remaining, bins), lacking=Lack.PLACEMENT)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rounded:
    """A fixed reserve that a host rounds up, and the largest one below it that it does not."""

    wanted: LogicalProcessors
    processors: int  # virtual ones
    given: LogicalProcessors
    below: LogicalProcessors


def describe_rounding(conflict: Conflict, problem: Problem) -> str:
    """Say which reserves are rounded up, if the whole per cent below would fit, or the sum would without rounding.

    Returns:
        Sentences that begin with a space; empty where rounding does not decide.
    """
    rounded = {item.name: found for item in problem.items if (found := dict(_rounded(item.name, problem)))}
    names = [item.name for item in conflict.items if item.name in rounded]
    for lowered in (names, list(rounded)):
        items = [_lowered(item, rounded[item.name]) if item.name in lowered else item for item in problem.items]
        if lowered and can_pack(items, problem.bins, by_first_fit=True):
            found = {name: next(iter(rounded[name].values())) for name in sorted(lowered, key=natural_order)}
            return f"{_rounding(found.values())} {_fitting(found)}"
    first = [next(iter(rounded[name].values())) for name in names]
    surplus = sum(100 * (each.given - each.wanted) for each in first)
    needed, free = sum(map(least_cost, conflict.items)), free_on(conflict.bins).percent
    decides = conflict.lacking is Lack.PROCESSORS and needed - surplus <= free < needed
    return _rounding(first) if decides else ""


def _rounded(name: str, problem: Problem) -> Iterator[tuple[str, _Rounded]]:
    group = next(group for group in problem.groups if group.name == name)
    if depends_on_a_log(group):
        return  # less was not shown to be enough
    for host, partition in problem.sizes[name].items():
        wanted = wanted_reserve(group, problem.system.hosts[host], problem.reservations)
        settings = partition.settings
        if isinstance(wanted, NotMeasured) or settings.reserve < 2:  # below 1 % is nothing
            continue
        given = guaranteed(settings.reserve, settings.processors)
        if wanted < given:
            below = guaranteed(settings.reserve - 1, settings.processors)
            yield host, _Rounded(wanted=wanted, processors=settings.processors, given=given, below=below)


def _lowered(item: Item, rounded: Mapping[str, _Rounded]) -> Item:
    claims: dict[str, Claim] = {
        host: replace(claim, reserve=claim.reserve - 1) if host in rounded else claim
        for host, claim in item.claims.items()
    }
    return replace(item, claims=claims)


def _rounding(rounded: Iterable[_Rounded]) -> str:
    ups = dict.fromkeys(
        f"{show_processors(each.wanted)} on {counted(each.processors, 'VP')} is rounded up to "
        f"{show_processors(each.given)}"
        for each in rounded
    )
    return f" A host gives whole per cent of each VP: {in_a_row([*ups])}."


def _fitting(rounded: Mapping[str, _Rounded]) -> str:
    amounts = {name: show_processors(each.below) for name, each in rounded.items()}
    if len(amounts) > 1 and len({*amounts.values()}) == 1:
        return f"With {next(iter(amounts.values()))} each, {in_a_row([*amounts])} fit."
    return f"With {in_a_row([f'{amount} for {name}' for name, amount in amounts.items()])}, everything fits."
