"""The system as a picture: hosts with their partitions with their components, in DOT or Mermaid."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal, assert_never

from rarms_iac.model.layout import Layout, PlacedPartition
from rarms_iac.model.quantities import show_bytes, show_percent, show_processors
from rarms_iac.model.system import System
from rarms_iac.planner.combining.candidates import Node
from rarms_iac.views.as_json import as_json
from rarms_iac.views.output.combining import CandidateOutput, CandidatesOutput, GraphOutput, NodeOutput
from rarms_iac.views.output.common import output_of


class GraphFormat(StrEnum):
    """Languages that graphs are written in."""

    DOT = "dot"
    MERMAID = "mermaid"


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
    reserve = f"{show_processors(partition.reserved)} reserved ({show_percent(partition.reserve)} each VP)"
    label = (partition.name, reserve, show_bytes(partition.memory))
    yield GraphNode(id=own, is_a="partition", name=partition.name, inside=f"host/{partition.host}", label=label)
    for component in partition.components:
        yield _component(system, component, own)


def _component(system: System, name: str, inside: str) -> GraphNode:
    component = system.components[name]
    task = (f"task {component.task}",) if component.task else ()
    label = (name, f"criticality {component.criticality}", *task)
    return GraphNode(id=f"component/{name}", is_a="component", name=name, inside=inside, label=label)


def graph_text(form: GraphFormat, title: str, nodes: Sequence[GraphNode]) -> str:
    """The graph in that language, ending with a line end."""
    match form:
        case GraphFormat.DOT:
            lines = _system_dot(title, nodes)
        case GraphFormat.MERMAID:
            lines = _system_mermaid(title, nodes)
        case _:
            assert_never(form)
    return "\n".join(lines) + "\n"


def graph_json(application: str, nodes: Sequence[GraphNode]) -> str:
    """The same for programs."""
    shown = tuple(output_of(NodeOutput, node, label="\n".join(node.label)) for node in nodes)
    return as_json(GraphOutput(application=application, nodes=shown))


def inside(nodes: Sequence[GraphNode], parent: str) -> tuple[GraphNode, ...]:
    """What lies directly in it."""
    return tuple(node for node in nodes if node.inside == parent)


def _system_dot(title: str, nodes: Sequence[GraphNode]) -> Iterator[str]:
    yield f"digraph {dot_quoted(title)} {{"
    yield "  graph [rankdir=LR, compound=true];"
    yield "  node [shape=box, style=rounded];"
    for host in inside(nodes, ""):
        yield from _dot_cluster(nodes, host, "  ")
    yield "}"


def _dot_cluster(nodes: Sequence[GraphNode], node: GraphNode, indent: str) -> Iterator[str]:
    if node.is_a == "component":
        yield f"{indent}{dot_quoted(node.id)} [label={dot_quoted(*node.label)}];"
        return
    yield f"{indent}subgraph {dot_quoted(f'cluster_{node.id}')} {{"
    yield f"{indent}  label={dot_quoted(*node.label)};"
    members = inside(nodes, node.id)
    if not members:
        yield f'{indent}  {dot_quoted(f"{node.id}/empty")} [label="", style=invis];'  # an empty cluster is not drawn
    for member in members:
        yield from _dot_cluster(nodes, member, indent + "  ")
    yield f"{indent}}}"


def dot_quoted(*lines: str) -> str:
    """Lines of text as one DOT string."""
    return '"' + "\\n".join(line.replace("\\", "\\\\").replace('"', '\\"') for line in lines) + '"'


def _system_mermaid(title: str, nodes: Sequence[GraphNode]) -> Iterator[str]:
    yield "---"
    yield f'title: "{title}"'
    yield "---"
    yield "flowchart LR"
    numbers = {node.id: f"n{number}" for number, node in enumerate(nodes)}
    for host in inside(nodes, ""):
        yield from _mermaid_group(nodes, host, numbers, "  ")


def _mermaid_group(nodes: Sequence[GraphNode], node: GraphNode, numbers: dict[str, str], indent: str) -> Iterator[str]:
    label = f'["{mermaid_quoted(*node.label)}"]'
    if node.is_a == "component":
        yield f"{indent}{numbers[node.id]}{label}"
        return
    yield f"{indent}subgraph {numbers[node.id]}{label}"
    for member in inside(nodes, node.id):
        yield from _mermaid_group(nodes, member, numbers, indent + "  ")
    yield f"{indent}end"


def mermaid_quoted(*lines: str) -> str:
    """Lines of text as the inside of a Mermaid string: what it would read as its own is written as an entity."""
    return "<br/>".join("".join(_MERMAID.get(character, character) for character in line) for line in lines)


_MERMAID = {'"': "#quot;", "#": "#35;", "&": "#amp;", "<": "#lt;", ">": "#gt;", ";": "#59;", "`": "#96;"}


def candidates_text(form: GraphFormat, title: str, nodes: Sequence[Node]) -> str:
    """The graph in that language, ending with a line end."""
    match form:
        case GraphFormat.DOT:
            lines = _candidates_dot(title, nodes)
        case GraphFormat.MERMAID:
            lines = _candidates_mermaid(title, nodes)
        case _:
            assert_never(form)
    return "\n".join(lines) + "\n"


def candidates_json(application: str, nodes: Sequence[Node]) -> str:
    """The same for programs."""
    shown = tuple(output_of(CandidateOutput, node) for node in nodes)
    return as_json(CandidatesOutput(application=application, candidates=shown))


def _candidates_dot(title: str, nodes: Sequence[Node]) -> Iterator[str]:
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


def _candidates_mermaid(title: str, nodes: Sequence[Node]) -> Iterator[str]:
    yield "---"
    yield f'title: "{title}"'
    yield "---"
    yield "flowchart LR"
    numbers = {node.name: f"n{number}" for number, node in enumerate(nodes)}
    for node in nodes:
        yield f'  {numbers[node.name]}["{mermaid_quoted(*node.label)}"]'
    for node in nodes:
        arrow = "-->" if node.measured and node.is_gain else "-.->"
        for part in node.parts:
            yield f"  {numbers[part]} {arrow} {numbers[node.name]}"
