"""The system and the candidate graph as pictures: in Mermaid, as a table, and as a drawing of the page."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Literal

from rarms_iac.app.graph import CandidateGraph, LayoutGraph
from rarms_iac.app.report_model import Report
from rarms_iac.model.layout import Layout
from rarms_iac.model.system import System
from rarms_iac.planner.combining.candidates import Node
from rarms_iac.planner.problem import by_name
from rarms_iac.texts.quantities import show_bytes, show_percent, show_processors
from rarms_iac.views.table import Column, Table


def graph_text(graph: LayoutGraph) -> str:
    """Draw the hosts with what lies in them as a Mermaid flowchart, ending with a line end."""
    return _flowchart(graph.application, _layout_lines(graph.system, graph.layout))


def _layout_lines(system: System, layout: Layout) -> Iterator[str]:
    numbers = count()

    def node(*label: str) -> str:
        return f'n{next(numbers)}["{mermaid_quoted(*label)}"]'

    def component(name: str) -> str:
        drawn = system.components[name]
        return node(name, f"criticality {drawn.criticality}", *((f"task {drawn.task}",) if drawn.task else ()))

    for host in by_name(system.hosts):
        size = f"{show_processors(host.logical_processors)}, {show_bytes(host.memory)}"
        yield f"  subgraph {node(host.name, f'{host.provider.value}, {size}')}"
        for partition in layout.on(host.name):
            share = f"{show_percent(partition.settings.reserve)} of each of its VPs"
            reserve = f"{show_processors(partition.reserved)} reserved ({share})"
            yield f"    subgraph {node(partition.name, reserve, show_bytes(partition.settings.memory))}"
            yield from (f"      {component(name)}" for name in partition.components)
            yield "    end"
        yield from (f"    {component(name)}" for name, on in layout.on_hosts if on == host.name)
        yield "  end"


def _flowchart(title: str, lines: Iterable[str]) -> str:
    return "\n".join(("---", f'title: "{title}"', "---", "flowchart LR", *lines)) + "\n"


def mermaid_quoted(*lines: str) -> str:
    """Write lines as the inside of a Mermaid string, with its special characters as entities."""
    return "<br/>".join("".join(_MERMAID.get(character, character) for character in line) for line in lines)


_MERMAID = {'"': "#quot;", "#": "#35;", "&": "#amp;", "<": "#lt;", ">": "#gt;", ";": "#59;", "`": "#96;"}


def describe_node(node: Node) -> str:
    """Return the known reservation of a compound."""
    if not node.is_gain:
        return f"no gain: needs at least {node.low} % of its VPs"
    if node.measured:
        return f"{node.low} % of its VPs"
    predicted = "" if node.predicted is None else f"predicted: {node.predicted} % of its VPs, "
    return f"{node.low} to {node.high} % of its VPs, {predicted}to be measured"


CANDIDATES = (Column("components together", wraps=True), Column("reservation", wraps=True))


def candidates_table(nodes: Iterable[Node]) -> Table:
    """Return a row a component or compound, in the order given."""
    return Table(CANDIDATES, [(" + ".join(node.members), describe_node(node)) for node in nodes])


def candidates_text(graph: CandidateGraph) -> str:
    """Draw the candidate graph as a Mermaid flowchart, ending with a line end."""
    return _flowchart(graph.application, _candidate_lines(graph.candidates))


def _candidate_lines(nodes: Sequence[Node]) -> Iterator[str]:
    numbers = {node.name: f"n{number}" for number, node in enumerate(nodes)}
    for node in nodes:
        yield f'  {numbers[node.name]}["{mermaid_quoted(node.name, describe_node(node))}"]'
    for node in nodes:
        arrow = "-->" if node.measured and node.is_gain else "-.->"
        for part in node.parts:
            yield f"  {numbers[part]} {arrow} {numbers[node.name]}"


MOST_NODES = 40
"""Of more, a drawing is a tangle: the table has the compounds that matter."""

ROW = 56
"""Pixels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnNode:
    """A node, and where it lies."""

    x: str
    y: int
    lines: tuple[str, ...]
    kind: Literal["measured", "open", "no-gain"]


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnEdge:
    """From a part to a compound."""

    x1: str
    y1: int
    x2: str
    y2: int


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateDrawing:
    """The whole graph."""

    height: int
    nodes: tuple[DrawnNode, ...]
    edges: tuple[DrawnEdge, ...]


def drawing_of(report: Report) -> CandidateDrawing | None:
    """Lay the graph out; None if nothing is combined or there are too many nodes to follow with the eye."""
    nodes = report.candidates
    if len(nodes) > MOST_NODES or not any(node.parts for node in nodes):
        return None
    sizes = sorted({len(node.members) for node in nodes})
    columns = [[node for node in nodes if len(node.members) == size] for size in sizes]
    rows = max(map(len, columns))
    places = {
        node.name: (f"{100 * (number + 0.5) / len(columns):.2f}", _y(row, len(column), rows))
        for number, column in enumerate(columns)
        for row, node in enumerate(column)
    }
    return CandidateDrawing(
        height=rows * ROW,
        nodes=tuple(_node(node, *places[node.name]) for node in nodes),
        edges=tuple(_edges(nodes, places)),
    )


def _y(row: int, count: int, rows: int) -> int:
    """Spread over the height of the longest column."""
    return round(ROW * rows * (row + 0.5) / count)


def _node(node: Node, x: str, y: int) -> DrawnNode:
    kind: Literal["measured", "open"] = "measured" if node.measured else "open"
    return DrawnNode(x=x, y=y, lines=(node.name, describe_node(node)), kind=kind if node.is_gain else "no-gain")


def _edges(nodes: Sequence[Node], places: dict[str, tuple[str, int]]) -> Sequence[DrawnEdge]:
    return [
        DrawnEdge(x1=places[part][0], y1=places[part][1], x2=places[node.name][0], y2=places[node.name][1])
        for node in nodes
        for part in node.parts
        if part in places
    ]
