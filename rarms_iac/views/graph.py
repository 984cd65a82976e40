"""The system as a picture: hosts with their partitions with their components, in Mermaid."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import count

from rarms_iac.app.graph import CandidateGraph, ComponentNode, HostNode, LayoutGraph, PartitionNode
from rarms_iac.model.quantities import show_bytes, show_percent, show_processors
from rarms_iac.planner.combining.candidates import Node


def graph_text(graph: LayoutGraph) -> str:
    """Draw the hosts with what lies in them as a Mermaid flowchart, ending with a line end."""
    numbers = count()
    lines = (line for host in graph.hosts for line in _lines(host, numbers, "  "))
    return _flowchart(graph.application, lines)


def _lines(node: HostNode | PartitionNode | ComponentNode, numbers: Iterator[int], indent: str) -> Iterator[str]:
    drawn = f'n{next(numbers)}["{mermaid_quoted(*_label(node))}"]'
    if isinstance(node, ComponentNode):
        yield f"{indent}{drawn}"
        return
    yield f"{indent}subgraph {drawn}"
    members: tuple[PartitionNode | ComponentNode, ...] = node.components
    for member in (*node.partitions, *members) if isinstance(node, HostNode) else members:
        yield from _lines(member, numbers, indent + "  ")
    yield f"{indent}end"


def _label(node: HostNode | PartitionNode | ComponentNode) -> tuple[str, ...]:
    match node:
        case HostNode():
            size = f"{show_processors(node.host_lp)}, {show_bytes(node.memory)}"
            return node.name, f"{node.provider.value}, {size}"
        case PartitionNode():
            reserve = f"{show_processors(node.reserved_lp)} reserved ({show_percent(node.reserve)} of each of its VPs)"
            return node.name, reserve, show_bytes(node.memory)
        case ComponentNode():
            return node.name, f"criticality {node.criticality}", *((f"task {node.task}",) if node.task else ())


def _flowchart(title: str, lines: Iterable[str]) -> str:
    return "\n".join(("---", f'title: "{title}"', "---", "flowchart LR", *lines)) + "\n"


def mermaid_quoted(*lines: str) -> str:
    """Lines of text as the inside of a Mermaid string: what it would read as its own is written as an entity."""
    return "<br/>".join("".join(_MERMAID.get(character, character) for character in line) for line in lines)


_MERMAID = {'"': "#quot;", "#": "#35;", "&": "#amp;", "<": "#lt;", ">": "#gt;", ";": "#59;", "`": "#96;"}


def candidates_text(graph: CandidateGraph) -> str:
    """Draw the candidate graph as a Mermaid flowchart, ending with a line end."""
    return _flowchart(graph.application, _candidate_lines(graph.candidates))


def _candidate_lines(nodes: Sequence[Node]) -> Iterator[str]:
    numbers = {node.name: f"n{number}" for number, node in enumerate(nodes)}
    for node in nodes:
        yield f'  {numbers[node.name]}["{mermaid_quoted(*node.label)}"]'
    for node in nodes:
        arrow = "-->" if node.measured and node.is_gain else "-.->"
        for part in node.parts:
            yield f"  {numbers[part]} {arrow} {numbers[node.name]}"
