"""The candidate graph in the languages of other tools, and for programs."""

from collections.abc import Iterator, Sequence
from typing import assert_never

from rarms_iac.planner.combining.candidates import Node
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
            name=node.name,
            members=node.members,
            parts=node.parts,
            low=node.low,
            high=node.high,
            predicted=node.predicted,
            measured=node.measured,
            is_gain=node.is_gain,
        )
        for node in nodes
    )
    return as_json(CandidatesOutput(application=application, candidates=shown))


def _dot(title: str, nodes: Sequence[Node]) -> Iterator[str]:
    yield f"digraph {dot_quoted(title)} {{"
    yield "  graph [rankdir=LR];"
    yield "  node [shape=box, style=rounded];"
    for node in nodes:
        style = "" if node.measured and node.is_gain else ', style="rounded,dashed"'
        yield f"  {dot_quoted(node.name)} [label={dot_quoted(*node.label)}{style}];"
    for node in nodes:
        for part in node.parts:
            yield f"  {dot_quoted(part)} -> {dot_quoted(node.name)};"
    yield "}"


def _mermaid(title: str, nodes: Sequence[Node]) -> Iterator[str]:
    yield "---"
    yield f'title: "{title}"'
    yield "---"
    yield "flowchart LR"
    numbers = {one.name: f"n{at}" for at, one in enumerate(nodes)}
    for node in nodes:
        yield f'  {numbers[node.name]}["{mermaid_quoted(*node.label)}"]'
    for node in nodes:
        arrow = "-->" if node.measured and node.is_gain else "-.->"
        for part in node.parts:
            yield f"  {numbers[part]} {arrow} {numbers[node.name]}"
