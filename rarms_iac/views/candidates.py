"""The candidate graph in the languages of other tools, and for programs."""

from collections.abc import Iterator, Sequence
from typing import assert_never

from rarms_iac.planner.combining.nodes import Node
from rarms_iac.views.as_json import as_json
from rarms_iac.views.graph import GraphFormat, dot_quoted, mermaid_quoted
from rarms_iac.views.output.combining import CandidateOutput, CandidatesOutput


def candidates_text(form: GraphFormat, title: str, nodes: Sequence[Node]) -> str:
    """The graph in that language, ending with a line end."""
    match form:
        case GraphFormat.DOT:
            lines = _dot(title, nodes)
        case GraphFormat.MERMAID:
            lines = _mermaid(title, nodes)
        case _:
            assert_never(form)
    return "\n".join(lines) + "\n"


def candidates_json(application: str, nodes: Sequence[Node]) -> str:
    """The same for programs."""
    shown = tuple(
        CandidateOutput(
            name=one.name,
            members=one.members,
            parts=one.parts,
            low=one.low,
            high=one.high,
            predicted=one.predicted,
            measured=one.measured,
            is_gain=one.is_gain,
        )
        for one in nodes
    )
    return as_json(CandidatesOutput(application=application, candidates=shown))


def _dot(title: str, nodes: Sequence[Node]) -> Iterator[str]:
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


def _mermaid(title: str, nodes: Sequence[Node]) -> Iterator[str]:
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
