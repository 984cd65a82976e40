"""The candidate graph as nodes: CoIs, the compounds that could save something, and what is known of each."""

from collections.abc import Mapping
from dataclasses import dataclass

from rarms_iac.planner.combining.candidates import Candidate, Candidates, Mask, graph_of, named

TO_BE_MEASURED = "to be measured"


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

    @property
    def label(self) -> tuple[str, ...]:
        """Its lines in a picture."""
        if not self.is_gain:
            return self.name, f"no gain: needs at least {self.low} %"
        if self.measured:
            return self.name, f"{self.low} %"
        predicted = "" if self.predicted is None else f"predicted: {self.predicted} %, "
        return self.name, f"{self.low} % to {self.high} %, {predicted}{TO_BE_MEASURED}"


def nodes_of(candidates: Candidates, predicted: Mapping[Mask, int]) -> tuple[Node, ...]:
    """The nodes: CoIs, the least critical first, then compounds, the smaller first; `predicted`: CRs of compounds."""
    graph = graph_of(candidates)
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
    parts = {compound.mask: tuple(sorted(graph.predecessors(named(compound.coi.members)))) for compound in compounds}
    return (*cois, *(_compound(compound, parts[compound.mask], predicted.get(compound.mask)) for compound in compounds))


def _compound(candidate: Candidate, parts: tuple[str, ...], predicted: int | None) -> Node:
    return Node(
        name=named(candidate.coi.members),
        members=candidate.coi.members,
        parts=parts,
        low=candidate.low,
        high=candidate.highest if candidate.passed is None else min(candidate.passed, candidate.highest),
        predicted=None if candidate.is_known else predicted,
        measured=candidate.is_known,
        is_gain=candidate.is_gain,
    )
