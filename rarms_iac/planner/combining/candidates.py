"""The candidate graph: every compound that could save something, with what is known of the reservation it needs.

One assumption is made (`ASSUMED`): a compound needs at least what any part of it needs, less a little on several
processors. That a compound needs at most the sum of its parts is expected and never used: one that
fails just below that sum is not a gain, and is dropped.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

from rarms_iac.planner.combining.oracle import Coi, Members, leader, processors_of, total
from rarms_iac.planner.combining.paper import Sharing
from rarms_iac.storage.datalog.decisions import TrailSetting

if TYPE_CHECKING:
    import networkx as nx


SLACK = 2
"""Points of CR by which a compound on several processors may need less than a part of it."""

ASSUMED = f"a compound needs at least as much as each of its parts, within {SLACK} % of its VPs"

EXACT_UP_TO = 12
"""CoIs of which every compound is considered; of more, the compounds of the least critical ones."""

Mask = int
"""A set of CoIs: bit k is the k-th least critical one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A compound, and the interval in which the least CR that meets its members' APTs lies."""

    mask: Mask
    coi: Coi  # what it would be; its reserve is the lower end
    highest: int  # the highest CR at which it still reserves less than its parts
    passed: int | None = None  # the lowest CR at which it was seen to meet all APTs
    failed: int | None = None  # the highest CR at which it was seen to miss one

    @property
    def low(self) -> int:
        """The CR that the compound needs at least, by all that is known."""
        return self.coi.reserve

    @property
    def highest_open(self) -> int:
        """The highest CR of which it would be news whether it is enough."""
        return self.highest if self.passed is None else self.passed - 1

    @property
    def is_known(self) -> bool:
        """Whether its least CR was measured."""
        return self.passed == self.low

    @property
    def is_gain(self) -> bool:
        """Whether it may still reserve less than its parts."""
        return self.low <= self.highest


@dataclass(frozen=True, slots=True, kw_only=True)
class Contradiction:
    """An answer that contradicts the assumption."""

    members: Members
    message: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidates:
    """All compounds that may be, with what answers say of them."""

    cois: tuple[Coi, ...]  # the least critical first: bit k is the k-th
    by_mask: Mapping[Mask, Candidate]
    contradictions: tuple[Contradiction, ...] = ()

    def members(self, mask: Mask) -> tuple[Coi, ...]:
        """List the CoIs of a set, the least critical first.

        Args:
            mask: a bit for each CoI of `cois`, by its place there.

        Returns:
            Those whose bit is set, in their order.
        """
        return tuple(coi for at, coi in enumerate(self.cois) if mask >> at & 1)

    @property
    def measured(self) -> "Candidates":
        """The compounds that met all APTs at some CR, each at the least such CR."""
        by_mask = {
            mask: replace(each, coi=replace(each.coi, reserve=each.passed))
            for mask, each in self.by_mask.items()
            if each.passed is not None
        }
        return replace(self, by_mask=by_mask)


def candidates_of(cois: Sequence[Coi], may_share: Sharing, *, most: int, largest: int | None = None) -> Candidates:
    """Build every compound of these CoIs that could be a gain, before anything is measured.

    A compound consists of CoIs that may share a partition two by two, and may also share it all together; other sets
    are not looked at. Of more than `EXACT_UP_TO` CoIs only the least critical ones are combined.

    Args:
        cois: the CoIs as they are now, in any order.
        may_share: whether components, by sorted names, may be in one partition.
        most: the highest CR that P1 can be given, in per cent of each of its processors.
        largest: how many CoIs a compound may consist of; None: any number.

    Returns:
        The candidates, each with its lowest possible CR. Their number grows with 2 to the power of the CoIs.
    """
    ordered = tuple(sorted(cois, key=lambda coi: (-coi.criticality, coi.name), reverse=True))
    found = {}
    for mask in _cliques(ordered, may_share, largest):
        members = tuple(coi for at, coi in enumerate(ordered) if mask >> at & 1)
        coi = compound_of(members)
        highest = min(most, (total(members) - 1) // coi.taken_processors)
        if coi.reserve <= highest:
            found[mask] = Candidate(mask=mask, coi=coi, highest=highest)
    return Candidates(cois=ordered, by_mask=dict(sorted(found.items())))


def at_least(cost: int, processors: int) -> int:
    """Return the CR that a compound needs at least, as the need of one of its parts shows.

    Args:
        cost: what that part needs, in per cent of one logical processor.
        processors: virtual processors of the compound's partition.

    Returns:
        Whole per cent of each of these processors, at least 1; rounded up, on several processors less `SLACK`.
    """
    return max(1, -(-cost // processors) - (SLACK if processors > 1 else 0))


def compound_of(members: Sequence[Coi]) -> Coi:
    """Make the compound of these CoIs, with the least CR that it can need.

    Args:
        members: its parts, at least one.

    Returns:
        A CoI with the name of its most critical part, the processors of its parts together, and as reserve the lower
            bound that `at_least` gives for its neediest part.
    """
    names = tuple(sorted(name for member in members for name in member.members))
    compound = replace(leader(members), members=names, processors=processors_of(members), missed=None)
    least = at_least(max(member.at_least for member in members), compound.processors)
    return replace(compound, reserve=least)


def _cliques(cois: Sequence[Coi], may_share: Sharing, largest: int | None) -> Iterator[Mask]:
    """Set of two or more that may share a partition, smaller ones first."""
    graph = _sharing_graph(cois[:EXACT_UP_TO], may_share)
    import networkx as nx

    for clique in nx.enumerate_all_cliques(graph):
        if largest is not None and len(clique) > largest:
            return
        members = tuple(sorted(name for at in clique for name in cois[at].members))
        if len(clique) == 2 or (len(clique) > 2 and may_share(members)):
            yield sum(1 << at for at in clique)


def _sharing_graph(cois: Sequence[Coi], may_share: Sharing) -> "nx.Graph":
    """Make a graph of the CoIs by number; an edge joins two that may share a partition."""
    import networkx as nx

    graph = nx.Graph()
    graph.add_nodes_from(range(len(cois)))
    for first, other in combinations(range(len(cois)), 2):
        if may_share(tuple(sorted((*cois[first].members, *cois[other].members)))):
            graph.add_edge(first, other)
    return graph


def informed(candidates: Candidates, answers: Iterable[TrailSetting]) -> Candidates:
    """Narrow the candidates' intervals by these answers.

    A failed setting raises the lower end of the compound and of every compound that contains it. Where answers
    contradict each other or the assumption, the safe side counts, and a `Contradiction` says so.

    Args:
        candidates: as `candidates_of` made them, before any answer.
        answers: all answers so far, in any order; those about sets that are no candidates are ignored.

    Returns:
        New candidates; the order of the answers does not matter.
    """
    own: dict[Members, tuple[list[int], list[int]]] = {}
    for answer in answers:
        passed, failed = own.setdefault(answer.components, ([], []))
        (passed if answer.met else failed).append(answer.reserve)
    by_members = {candidate.coi.members: candidate for candidate in candidates.by_mask.values()}
    answered = {
        by_members[members].mask: _own(by_members[members], passed, failed)
        for members, (passed, failed) in own.items()
        if members in by_members
    }
    known = {mask: answered.get(mask, candidate) for mask, candidate in candidates.by_mask.items()}
    floors = [(mask, candidate.coi.at_least) for mask, candidate in answered.items() if candidate.failed is not None]
    raised = {mask: _raised(candidate, floors) for mask, candidate in known.items()}
    return replace(candidates, by_mask=raised, contradictions=tuple(_contradictions(candidates, own, answered, floors)))


def _own(candidate: Candidate, passed: Sequence[int], failed: Sequence[int]) -> Candidate:
    """Set the compound's interval by its own answers; where they contradict each other, the safe side counts."""
    highest = max(failed, default=None)
    enough = min((each for each in passed if highest is None or each > highest), default=None)
    low = candidate.low if highest is None else max(candidate.low, highest + 1)
    # One that passes below what its parts need breaks the assumption: what was seen counts.
    low = low if enough is None else min(low, enough)
    return replace(candidate, coi=replace(candidate.coi, reserve=low), passed=enough, failed=highest)


def _raised(candidate: Candidate, floors: Iterable[tuple[Mask, int]]) -> Candidate:
    """Raise the compound's lower end to what each part of it needs, unless it was seen to pass with less."""
    own, cost = candidate.mask, 0
    for mask, floor in floors:
        if floor > cost and mask & own == mask:
            cost = floor
    low = max(candidate.low, at_least(cost, candidate.coi.processors)) if cost else candidate.low
    low = candidate.low if candidate.passed is not None and low > candidate.passed else low
    return candidate if low == candidate.low else replace(candidate, coi=replace(candidate.coi, reserve=low))


def _contradictions(
    candidates: Candidates,
    own: Mapping[Members, tuple[Sequence[int], Sequence[int]]],
    answered: Mapping[Mask, Candidate],
    floors: Sequence[tuple[Mask, int]],
) -> Iterator[Contradiction]:
    for mask, candidate in sorted(answered.items()):
        passed, failed = own[candidate.coi.members]
        if passed and failed and min(passed) <= max(failed):
            yield Contradiction(
                members=candidate.coi.members,
                message=(
                    f"{named(candidate.coi.members)} met its thresholds with {min(passed)} % of its VPs, but "
                    f"missed a threshold with {max(failed)} %"
                ),
            )
        if not passed:
            continue
        for part, floor in (*_parts(candidates, mask), *floors):
            if part & mask == part and part != mask and min(passed) < at_least(floor, candidate.coi.processors):
                needs = named(compound_of(candidates.members(part)).members)
                yield Contradiction(
                    members=candidate.coi.members,
                    message=f"{named(candidate.coi.members)} needs less than its part {needs}",
                )
                break


def _parts(candidates: Candidates, mask: Mask) -> Iterator[tuple[Mask, int]]:
    for at, coi in enumerate(candidates.cois):
        if mask >> at & 1:
            yield 1 << at, coi.at_least


def named(members: Members) -> str:
    """Write the name of a set of components, as messages and the graph have it.

    Returns:
        The names joined by a plus sign: `speech+vision`.
    """
    return "+".join(members)


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """A node of the candidate graph."""

    name: str  # speech+vision
    members: tuple[str, ...]
    parts: tuple[str, ...]  # names of the nodes that lead to it; none: it is a CoI as it is now
    low: int  # whole per cent of each of its virtual processors: it needs at least so much
    high: int  # at most so much, if it is to save anything
    predicted: int | None  # what it will probably need, until that is measured
    measured: bool
    is_gain: bool


def nodes_of(candidates: Candidates, predicted: Mapping[Mask, int]) -> tuple[Node, ...]:
    """List the nodes of the candidate graph as values to show.

    Args:
        candidates: with what the answers so far say.
        predicted: the CR (whole per cent) that each compound will probably need, where something predicts it.

    Returns:
        CoIs first, the least critical first; then compounds, by number of parts and then by name.
    """
    cois = [
        Node(
            name=named(coi.members),
            members=coi.members,
            parts=(),
            low=coi.reserve,
            high=coi.reserve,
            predicted=None,
            measured=True,
            is_gain=True,
        )
        for coi in candidates.cois
    ]
    compounds = sorted(
        candidates.by_mask.values(), key=lambda candidate: (candidate.mask.bit_count(), candidate.coi.members)
    )
    return (*cois, *(_compound(compound, candidates, predicted.get(compound.mask)) for compound in compounds))


def _compound(candidate: Candidate, candidates: Candidates, predicted: int | None) -> Node:
    parts = (named(part.members) for part in candidates.members(candidate.mask))
    return Node(
        name=named(candidate.coi.members),
        members=candidate.coi.members,
        parts=tuple(sorted(parts)),
        low=candidate.low,
        high=candidate.highest if candidate.passed is None else min(candidate.passed, candidate.highest),
        predicted=None if candidate.is_known else predicted,
        measured=candidate.is_known,
        is_gain=candidate.is_gain,
    )
