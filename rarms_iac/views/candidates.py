"""The candidate graph as a picture: CoIs, the compounds that could save something, and what is known of each."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import assert_never

from rarms_iac.planner.combining.candidates import Candidate, Candidates, graph_of, named
from rarms_iac.views.as_json import as_json
from rarms_iac.views.graph import GraphFormat, dot_quoted, mermaid_quoted
from rarms_iac.views.output.combining import CandidateOutput, CandidatesOutput


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """A node of the candidate graph."""

    name: str  # speech+vision
    members: tuple[str, ...]
    parts: tuple[str, ...]  # names of the nodes that lead to it; none: it is a CoI as it is now
    low: int  # whole per cent of each of its virtual processors: it needs at least so much
    high: int  # at most so much, if it is to save anything
    measured: bool
    is_gain: bool

    @property
    def label(self) -> tuple[str, ...]:
        """Its lines in a picture."""
        if not self.is_gain:
            return self.name, f"no gain: needs at least {self.low} %"
        if self.measured:
            return self.name, f"{self.low} %"
        return self.name, f"{self.low} % to {self.high} %, to be measured"


def shown_of(candidates: Candidates) -> tuple[Shown, ...]:
    """The nodes: CoIs, the least critical first, then compounds, the smaller first."""
    graph = graph_of(candidates)
    cois = [
        Shown(
            name=named(one.members),
            members=one.members,
            parts=(),
            low=one.reserve,
            high=one.reserve,
            measured=True,
            is_gain=True,
        )
        for one in candidates.cois
    ]
    compounds = sorted(candidates.by_mask.values(), key=lambda one: (one.mask.bit_count(), one.coi.members))
    return (*cois, *(_compound(one, tuple(sorted(graph.predecessors(named(one.coi.members))))) for one in compounds))


def _compound(one: Candidate, parts: tuple[str, ...]) -> Shown:
    return Shown(
        name=named(one.coi.members),
        members=one.coi.members,
        parts=parts,
        low=one.low,
        high=one.highest if one.passed is None else min(one.passed, one.highest),
        measured=one.is_known,
        is_gain=one.is_gain,
    )


def candidates_text(form: GraphFormat, title: str, nodes: Sequence[Shown]) -> str:
    """The graph in that language, ending with a line end."""
    match form:
        case GraphFormat.DOT:
            lines = _dot(title, nodes)
        case GraphFormat.MERMAID:
            lines = _mermaid(title, nodes)
        case _:
            assert_never(form)
    return "\n".join(lines) + "\n"


def candidates_json(application: str, nodes: Sequence[Shown]) -> str:
    """The same for programs."""
    shown = tuple(
        CandidateOutput(
            name=one.name,
            members=one.members,
            parts=one.parts,
            low=one.low,
            high=one.high,
            measured=one.measured,
            is_gain=one.is_gain,
        )
        for one in nodes
    )
    return as_json(CandidatesOutput(application=application, candidates=shown))


def _dot(title: str, nodes: Sequence[Shown]) -> Iterator[str]:
    yield f"digraph {dot_quoted(title)} {{"
    yield "  graph [rankdir=LR];"
    yield "  node [shape=box, style=rounded];"
    for one in nodes:
        style = "" if one.measured and one.is_gain else ', style="rounded,dashed"'
        yield f"  {dot_quoted(one.name)} [label={dot_quoted(*one.label)}{style}];"
    for one in nodes:
        for part in one.parts:
            yield f"  {dot_quoted(part)} -> {dot_quoted(one.name)};"
    yield "}"


def _mermaid(title: str, nodes: Sequence[Shown]) -> Iterator[str]:
    yield "---"
    yield f'title: "{title}"'
    yield "---"
    yield "flowchart LR"
    numbers = {one.name: f"n{at}" for at, one in enumerate(nodes)}
    for one in nodes:
        yield f'  {numbers[one.name]}["{mermaid_quoted(*one.label)}"]'
    for one in nodes:
        arrow = "-->" if one.measured and one.is_gain else "-.->"
        for part in one.parts:
            yield f"  {numbers[part]} {arrow} {numbers[one.name]}"
