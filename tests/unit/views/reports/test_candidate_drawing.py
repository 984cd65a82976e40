"""The candidate graph on the page: nothing overlaps, parts lie left of what consists of them, and it stays readable."""

from itertools import combinations

from rarms_iac.planner.combining.candidates import Node
from rarms_iac.views.reports.candidate_drawing import MOST_NODES, Box, covered, drawing_of, few_enough

NAMES = ("path", "speech", "video", "vision")


def node(*members: str, low: int = 20, high: int = 60, measured: bool = False, is_gain: bool = True) -> Node:
    return Node(
        name="+".join(members),
        members=members,
        parts=members if len(members) > 1 else (),
        low=low,
        high=high,
        predicted=None,
        measured=measured or len(members) == 1,
        is_gain=is_gain,
    )


def all_of(names: tuple[str, ...]) -> list[Node]:
    return [node(*members) for size in range(1, len(names) + 1) for members in combinations(names, size)]


def overlap(box: Box, other: Box) -> bool:
    return (
        box.x < other.x + other.width
        and other.x < box.x + box.width
        and box.y < other.y + other.height
        and other.y < box.y + box.height
    )


def test_no_two_boxes_overlap_and_all_lie_within_the_drawing() -> None:
    drawing = drawing_of(all_of(NAMES))

    assert len(drawing.boxes) == 15
    assert not any(overlap(box, other) for box, other in combinations(drawing.boxes, 2))
    assert max(box.x + box.width for box in drawing.boxes) <= drawing.width
    assert max(box.y + box.height for box in drawing.boxes) <= drawing.height
    assert all(line.y < box.y + box.height for box in drawing.boxes for line in box.lines)


def test_each_node_is_joined_to_its_largest_parts_that_lie_left_of_it() -> None:
    nodes = all_of(NAMES)
    drawing = drawing_of(nodes)
    left = {
        node.name: box.x
        for node, box in zip(sorted(nodes, key=lambda each: len(each.members)), drawing.boxes, strict=True)
    }

    assert covered(nodes)["path+speech+video"] == ("path+speech", "path+video", "speech+video")
    assert all(left[part] < left[name] for name, parts in covered(nodes).items() for part in parts)
    assert len(drawing.arrows) == 6 * 2 + 4 * 3 + 4


def test_where_a_pair_is_missing_its_members_are_joined_to_what_consists_of_it() -> None:
    nodes = [*map(node, ("path", "speech", "video")), node("path", "speech"), node("path", "speech", "video")]

    assert covered(nodes)["path+speech+video"] == ("video", "path+speech")


def test_what_is_measured_open_or_no_gain_is_drawn_apart_and_said_in_words() -> None:
    nodes = [node("path"), node("speech"), node("path", "speech", is_gain=False)]

    drawing = drawing_of(nodes)

    assert [box.kind for box in drawing.boxes] == ["known", "known", "idle"]
    assert drawing_of([*nodes[:2], node("path", "speech")]).boxes[-1].kind == "open"
    assert "path, speech: no gain: needs at least 20 %" in drawing.says


def test_of_too_many_the_measured_ones_stay_with_all_they_consist_of() -> None:
    names = tuple(f"c{number:02}" for number in range(10))
    nodes = all_of(names)
    known = node("c08", "c09", measured=True)

    shown = few_enough([known if node.name == known.name else node for node in nodes])

    assert len(shown) <= MOST_NODES
    assert known in shown
    assert {node.name for node in shown} >= set(names)
    drawn = {node.name for node in shown}
    assert all(set(node.parts) <= drawn for node in shown)
