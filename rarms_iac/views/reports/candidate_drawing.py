"""The candidate graph laid out for the page: parts to the left of what consists of them, in pixels.

Nothing is drawn with colours here: the page's style has them, for light and dark.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rarms_iac.planner.combining.candidates import TO_BE_MEASURED, Node

LINE = 18
"""Pixels from one line of text to the next."""

LETTER = 7.6
"""Pixels that a letter takes at most, on average: boxes are a little wider than their text."""

PADDING = 10
BETWEEN_COLUMNS = 60
BETWEEN_ROWS = 14
MOST_NODES = 48
"""More than these are not read; those that were measured go before those that may save something."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """A line of text in a box."""

    x: float
    y: float
    text: str
    is_quiet: bool

    @property
    def kind(self) -> str:
        """`member` of the compound, or what is `known-of` it."""
        return "known-of" if self.is_quiet else "member"


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """A node: `known` was measured, `open` was not, `idle` saves nothing."""

    x: float
    y: float
    width: float
    height: float
    kind: str
    lines: tuple[Line, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrow:
    """From a part to what consists of it."""

    path: str
    kind: str  # of its end


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawing:
    """All of it."""

    width: float
    height: float
    boxes: tuple[Box, ...]
    arrows: tuple[Arrow, ...]
    says: str  # for those who do not see it


def few_enough(nodes: Sequence[Node], most: int = MOST_NODES) -> tuple[Node, ...]:
    """So many nodes at most: what is there now, what was measured with all it consists of, then what may save most."""
    by_name = {node.name: node for node in nodes}
    ranked = sorted(
        (node for node in nodes if node.parts),
        key=lambda node: (not node.measured, not node.is_gain, node.low - node.high, len(node.members), node.name),
    )
    chosen = {node.name for node in nodes if not node.parts}
    for one in ranked:
        wanted = _with_parts(one, by_name) - chosen
        if len(chosen) + len(wanted) <= most:
            chosen |= wanted
    return tuple(node for node in nodes if node.name in chosen)


def _with_parts(node: Node, by_name: Mapping[str, Node]) -> set[str]:
    found = {node.name}
    for part in node.parts:
        found |= _with_parts(by_name[part], by_name)
    return found


def drawing_of(nodes: Sequence[Node]) -> Drawing:
    """Columns by how much is combined, each in the order in which its nodes are given."""
    parts = covered(nodes)
    columns = _columns(nodes, parts)
    tallest = max((_height_of(column) for column in columns), default=0.0)
    boxes: dict[str, Box] = {}
    left = 1.0
    for column in columns:
        width = max(map(_width_of, column))
        top = 1.0 + (tallest - _height_of(column)) / 2
        for one in column:
            boxes[one.name] = _box(one, left, top, width)
            top += boxes[one.name].height + BETWEEN_ROWS
        left += width + BETWEEN_COLUMNS
    arrows = [
        Arrow(path=_between(boxes[part], boxes[node.name]), kind=kind_of(node))
        for node in nodes
        for part in parts[node.name]
    ]
    return Drawing(
        width=left - BETWEEN_COLUMNS + 1,
        height=tallest + 2,
        boxes=tuple(boxes.values()),
        arrows=tuple(arrows),
        says="; ".join(f"{', '.join(node.members)}: {node.label[-1]}" for node in nodes),
    )


def kind_of(node: Node) -> str:
    """How it is drawn."""
    return "idle" if not node.is_gain else "known" if node.measured else "open"


def covered(nodes: Sequence[Node]) -> Mapping[str, tuple[str, ...]]:
    """The largest parts of each node that are drawn: those with nothing drawn between."""
    inside = {
        node.name: [each for each in nodes if set(each.members) < set(node.members)] if node.parts else []
        for node in nodes
    }
    return {
        name: tuple(each.name for each in below if not any(set(each.members) < set(other.members) for other in below))
        for name, below in inside.items()
    }


def _columns(nodes: Sequence[Node], parts: Mapping[str, Sequence[str]]) -> list[list[Node]]:
    depth: dict[str, int] = {}
    for node in sorted(nodes, key=lambda each: len(each.members)):
        depth[node.name] = 1 + max((depth[part] for part in parts[node.name]), default=-1)
    return [[node for node in nodes if depth[node.name] == at] for at in sorted(set(depth.values()))]


def _texts(node: Node) -> tuple[str, ...]:
    """A component a line, and what is known of them together; a dashed box says itself that it is to be measured."""
    known = [part for line in node.label[1:] for part in line.split(", ") if part != TO_BE_MEASURED]
    return (*node.members, *known)


def _width_of(node: Node) -> float:
    return round(max(map(len, _texts(node))) * LETTER + 2 * PADDING)


def _box_height(node: Node) -> float:
    return len(_texts(node)) * LINE + PADDING


def _height_of(column: Sequence[Node]) -> float:
    return sum(map(_box_height, column)) + BETWEEN_ROWS * (len(column) - 1)


def _box(node: Node, left: float, top: float, width: float) -> Box:
    texts = _texts(node)
    lines = tuple(
        Line(x=left + PADDING, y=top + LINE * (at + 1), text=text, is_quiet=at >= len(node.members))
        for at, text in enumerate(texts)
    )
    return Box(x=left, y=top, width=width, height=_box_height(node), kind=kind_of(node), lines=lines)


def _between(part: Box, whole: Box) -> str:
    left, right = part.x + part.width, whole.x
    begin, end = part.y + part.height / 2, whole.y + whole.height / 2
    middle = (left + right) / 2
    return f"M{left:.0f} {begin:.0f}C{middle:.0f} {begin:.0f} {middle:.0f} {end:.0f} {right:.0f} {end:.0f}"
