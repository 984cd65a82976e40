"""The candidate graph as a drawing: CoIs at the left, compounds by the number of their parts, lines from part to whole.

Lengths are per cent of the drawing's width, and rows of its height. Nothing here decides anything.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from rarms_iac.app.report_model import Report
from rarms_iac.planner.combining.candidates import Node

MOST_NODES = 40
"""Of more, a drawing is a tangle: the table beside it has the compounds that matter."""

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
    """Lay the graph out; None where there is no compound, or too many nodes to follow with the eye."""
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
    return DrawnNode(x=x, y=y, lines=node.label, kind=kind if node.is_gain else "no-gain")


def _edges(nodes: Sequence[Node], places: dict[str, tuple[str, int]]) -> Sequence[DrawnEdge]:
    return [
        DrawnEdge(x1=places[part][0], y1=places[part][1], x2=places[node.name][0], y2=places[node.name][1])
        for node in nodes
        for part in node.parts
        if part in places
    ]
