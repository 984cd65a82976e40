"""The system as a picture: hosts with their partitions with their components, in Mermaid."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from rarms_iac.model.layout import Layout, PlacedPartition
from rarms_iac.model.quantities import show_bytes, show_percent, show_processors
from rarms_iac.model.system import System
from rarms_iac.planner.combining.candidates import Node
from rarms_iac.views.json_output import json_of
from rarms_iac.views.output.combining import CandidateOutput, CandidatesOutput, GraphOutput, NodeOutput
from rarms_iac.views.output.common import output_of


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphNode:
    """A host, partition or component; `inside` is the id of what it lies in."""

    id: str
    is_a: Literal["host", "partition", "component"]
    name: str
    inside: str
    label: tuple[str, ...]  # lines


def graph_nodes(system: System, layout: Layout) -> tuple[GraphNode, ...]:
    """Hosts by name, each followed by its partitions, each followed by its components."""
    return tuple(node for name in sorted(system.hosts) for node in _host(system, layout, name))


def _host(system: System, layout: Layout, name: str) -> Iterator[GraphNode]:
    host = system.hosts[name]
    size = f"{show_processors(host.logical_processors)}, {show_bytes(host.memory)}"
    yield GraphNode(
        id=f"host/{name}", is_a="host", name=name, inside="", label=(name, f"{host.provider.value}, {size}")
    )
    for partition in layout.partitions:
        if partition.host == name:
            yield from _partition(system, partition)
    for component, on in layout.on_hosts:
        if on == name:
            yield _component(system, component, f"host/{name}")


def _partition(system: System, partition: PlacedPartition) -> Iterator[GraphNode]:
    own = f"partition/{partition.name}"
    reserve = f"{show_processors(partition.reserved)} reserved ({show_percent(partition.settings.reserve)} each VP)"
    label = (partition.name, reserve, show_bytes(partition.settings.memory))
    yield GraphNode(id=own, is_a="partition", name=partition.name, inside=f"host/{partition.host}", label=label)
    for component in partition.components:
        yield _component(system, component, own)


def _component(system: System, name: str, inside: str) -> GraphNode:
    component = system.components[name]
    task = (f"task {component.task}",) if component.task else ()
    label = (name, f"criticality {component.criticality}", *task)
    return GraphNode(id=f"component/{name}", is_a="component", name=name, inside=inside, label=label)


def graph_text(title: str, nodes: Sequence[GraphNode]) -> str:
    """Draw the hosts with what lies in them as a Mermaid flowchart, ending with a line end."""
    numbers = {node.id: f"n{number}" for number, node in enumerate(nodes)}
    lines = (line for host in children(nodes, "") for line in _group(nodes, host, numbers, "  "))
    return _flowchart(title, lines)


def graph_json(application: str, nodes: Sequence[GraphNode]) -> str:
    """The same for programs."""
    outputs = tuple(output_of(NodeOutput, node, label="\n".join(node.label)) for node in nodes)
    return json_of(GraphOutput(application=application, nodes=outputs))


def children(nodes: Sequence[GraphNode], parent: str) -> tuple[GraphNode, ...]:
    """Return the nodes that lie directly in the node with this id; empty: the hosts."""
    return tuple(node for node in nodes if node.inside == parent)


def _flowchart(title: str, lines: Iterable[str]) -> str:
    return "\n".join(("---", f'title: "{title}"', "---", "flowchart LR", *lines)) + "\n"


def _group(nodes: Sequence[GraphNode], node: GraphNode, numbers: dict[str, str], indent: str) -> Iterator[str]:
    label = f'["{mermaid_quoted(*node.label)}"]'
    if node.is_a == "component":
        yield f"{indent}{numbers[node.id]}{label}"
        return
    yield f"{indent}subgraph {numbers[node.id]}{label}"
    for member in children(nodes, node.id):
        yield from _group(nodes, member, numbers, indent + "  ")
    yield f"{indent}end"


def mermaid_quoted(*lines: str) -> str:
    """Lines of text as the inside of a Mermaid string: what it would read as its own is written as an entity."""
    return "<br/>".join("".join(_MERMAID.get(character, character) for character in line) for line in lines)


_MERMAID = {'"': "#quot;", "#": "#35;", "&": "#amp;", "<": "#lt;", ">": "#gt;", ";": "#59;", "`": "#96;"}


def candidates_text(title: str, nodes: Sequence[Node]) -> str:
    """Draw the candidate graph as a Mermaid flowchart, ending with a line end."""
    return _flowchart(title, _candidate_lines(nodes))


def candidates_json(application: str, nodes: Sequence[Node]) -> str:
    """The same for programs."""
    outputs = tuple(output_of(CandidateOutput, node) for node in nodes)
    return json_of(CandidatesOutput(application=application, candidates=outputs))


def _candidate_lines(nodes: Sequence[Node]) -> Iterator[str]:
    numbers = {node.name: f"n{number}" for number, node in enumerate(nodes)}
    for node in nodes:
        yield f'  {numbers[node.name]}["{mermaid_quoted(*node.label)}"]'
    for node in nodes:
        arrow = "-->" if node.measured and node.is_gain else "-.->"
        for part in node.parts:
            yield f"  {numbers[part]} {arrow} {numbers[node.name]}"
