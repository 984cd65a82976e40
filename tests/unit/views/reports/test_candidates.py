"""The drawing of the candidate graph: every node once, a line from each part, nothing where there is nothing to see."""

from dataclasses import replace

from rarms_iac.views.reports.candidates import MOST_NODES, ROW, drawing_of
from rarms_iac.views.reports.html import as_html
from tests.unit.views.reports.test_html import REPORT, all_of

NAMES = ("path-planning", "speech-recognition", "vision")


def test_each_node_is_drawn_once() -> None:
    report = replace(REPORT, candidates=all_of(NAMES))

    drawing = drawing_of(report)

    assert drawing is not None
    assert [node.lines for node in drawing.nodes] == [node.label for node in report.candidates]
    assert len(drawing.edges) == sum(len(node.parts) for node in report.candidates)
    places = {(node.x, node.y) for node in drawing.nodes}
    assert len(places) == len(drawing.nodes), "no node lies on another"
    assert {(edge.x1, edge.y1) for edge in drawing.edges} | {(edge.x2, edge.y2) for edge in drawing.edges} <= places
    assert all(float(edge.x1) < float(edge.x2) for edge in drawing.edges), "parts stand at the left"
    assert all(0 < node.y < drawing.height for node in drawing.nodes)
    assert drawing.height % ROW == 0
    assert 'class="candidates"' in as_html(report).decode()


def test_no_compound_and_a_tangle_are_not_drawn() -> None:
    nodes = all_of(NAMES)
    alone = tuple(node for node in nodes if not node.parts)

    assert drawing_of(replace(REPORT, candidates=alone)) is None
    assert drawing_of(replace(REPORT, candidates=())) is None
    assert drawing_of(replace(REPORT, candidates=nodes * MOST_NODES)) is None
    assert 'class="candidates"' not in as_html(replace(REPORT, candidates=alone)).decode()
