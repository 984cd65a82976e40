"""The page: one file that lets nothing in, escapes everything, and holds the planner's own numbers."""

import hashlib
import json
import re
from base64 import b64encode
from dataclasses import replace
from fractions import Fraction
from html.parser import HTMLParser
from itertools import combinations
from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.app.report_model import IndexCurve
from rarms_iac.model.indexes import find_index
from rarms_iac.model.system import AtMost
from rarms_iac.planner.combining.candidates import Node
from rarms_iac.statistics.curves import curve_of
from rarms_iac.texts.findings import Finding
from rarms_iac.texts.quantities import show_number
from rarms_iac.views.graph import MOST_NODES, ROW, describe_node, drawing_of
from rarms_iac.views.reports.html import as_html
from rarms_iac.views.reports.scale import Scale, round_down, scale_of
from rarms_iac.views.reports.tables import MOST_CANDIDATES, ranked_candidates
from tests.builders import a_run
from tests.builders_measured import a_proof, a_series, a_setting
from tests.robots import a_robot, report_of_logs, the_logs

SYSTEM = a_robot()
REPORT = report_of_logs(SYSTEM, the_logs(SYSTEM))
PAGE = as_html(REPORT).decode()


class Elements(HTMLParser):
    """All elements with their attributes, and the text of each script and style."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[str, str]] = []
        self.inside = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        self.inside = tag

    def handle_data(self, data: str) -> None:
        if self.inside in {"script", "style"} and data.strip():
            self.texts.append((self.inside, data))
            self.inside = ""


def data_in(page: str) -> dict[str, object]:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert found
    data = json.loads(found[1])
    assert isinstance(data, dict)
    return data


def test_the_page_names_nothing_outside_of_itself() -> None:
    attributes = [(tag, name) for tag, values in Elements(PAGE).found for name in values]

    assert {name for _, name in attributes} & {"src", "href", "srcset", "action", "style", "onclick"} == set()
    assert "url(" not in PAGE
    assert "@import" not in PAGE
    assert "://" not in PAGE


def test_policy_allows_only_own_style_and_script() -> None:
    elements = Elements(PAGE)
    [policy] = [values["content"] for _, values in elements.found if "http-equiv" in values]
    assert policy is not None

    digests = {
        kind: f"'sha256-{b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
        for kind, text in elements.texts
        if not text.startswith("{")
    }

    assert policy == (
        f"default-src 'none'; style-src {digests['style']}; script-src {digests['script']}; "
        "base-uri 'none'; form-action 'none'"
    )


def test_rows_equal_the_curves_safe_values() -> None:
    cards = data_in(PAGE)["cards"]
    assert isinstance(cards, list)

    for card, measurement in zip(cards, REPORT.measurements, strict=True):
        for plot, shown in zip(card["plots"], measurement.indexes, strict=True):
            looked_up = [(at, shown.curve.safe_value_at(at)) for at in range(1, 101)]
            assert plot["rows"] == [[at, safe] for at, safe in looked_up if safe is not None]


def test_text_of_manifest_never_becomes_markup_or_code() -> None:
    nasty = "</script><script>alert(1)</script><img src=x onerror=alert(1)> & \u2028 {{ 7 * 7 }}"
    measurements = tuple(
        replace(measurement, platform=nasty, log=nasty, stale=(nasty,), facts=((nasty, nasty),))
        for measurement in REPORT.measurements
    )
    capacities = tuple(replace(capacity, platform=nasty, hosts=(nasty,)) for capacity in REPORT.capacities)

    page = as_html(
        replace(REPORT, application=nasty, description=nasty, measurements=measurements, capacities=capacities)
    ).decode()

    assert [tag for tag, _ in Elements(page).found].count("script") == 2
    assert "<img" not in page
    assert "{{ 7 * 7 }}" in page
    cards = data_in(page)["cards"]
    assert isinstance(cards, list)
    assert {card["platform"] for card in cards} == {nasty.replace("\u2028", "<U+2028>")}


def test_lone_surrogates_do_not_stop_the_page() -> None:
    assert b"robot" in as_html(replace(REPORT, description="\udcff robot"))


def test_page_is_small_and_same_each_time() -> None:
    assert len(PAGE.encode()) < 200_000
    assert as_html(report_of_logs(SYSTEM, the_logs(SYSTEM))).decode() == PAGE


def test_page_of_sixty_components_is_smaller_than_megabyte() -> None:
    page = as_html(replace(REPORT, measurements=REPORT.measurements * 20))

    assert len(REPORT.measurements) == 3
    assert len(page) < 1_000_000


def test_proofs_are_a_table_of_their_own() -> None:
    missed = a_proof(value=113.4, lower=112.0, upper=114.8, met=False, verdict="missed")

    page = as_html(replace(REPORT, proofs=(missed,))).decode()

    assert "All together, in the applied layout" in page
    assert re.search(r"busy-loop<.*>113\.4 ms<.*>112 to 114\.8 ms<.*>missed<", page, re.DOTALL)
    assert "All components together" not in PAGE


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


def all_of(names: tuple[str, ...]) -> tuple[Node, ...]:
    return tuple(node(*members) for size in range(1, len(names) + 1) for members in combinations(names, size))


def test_possible_compounds_list_measured_first() -> None:
    nodes = (
        node("a"),
        node("b"),
        node("c"),
        node("a", "b"),
        node("a", "c", measured=True),
        node("b", "c", is_gain=False),
    )
    report = replace(report_of_logs(a_robot(), the_logs(a_robot())), candidates=nodes)

    page = as_html(report).decode()

    assert ranked_candidates(report).rows == [
        ("a + c", "20 % of its VPs"),
        ("a + b", "20 to 60 % of its VPs, to be measured"),
    ]
    assert '<th scope="row">a + c</th><td data-is="Reservation">20 % of its VPs</td>' in page
    assert "more are not listed" not in page


def test_long_compound_list_is_cut_and_says_so() -> None:
    names = tuple("abcdef")
    report = replace(report_of_logs(a_robot(), the_logs(a_robot())), candidates=all_of(names))

    assert len(ranked_candidates(report).rows) == MOST_CANDIDATES
    assert f"{57 - MOST_CANDIDATES} more are not listed" in as_html(report).decode()


def test_commands_in_tables_are_code() -> None:
    page = as_html(report_of_logs(a_robot(), the_logs(a_robot())[:1])).decode()

    assert '<td data-is="Verdict">not measured</td>' in page
    assert "Measure the missing reservations: <code>rarms measure</code>." in page


def test_only_commands_in_findings_are_code() -> None:
    finding = Finding.note("RARMS101", "Not <measured>").at(None, "Run `rarms measure`.", "Or <b>`a < b`.")
    page = as_html(replace(REPORT, findings=(finding,))).decode()

    assert "<p>Run <code>rarms measure</code>. Or &lt;b&gt;<code>a &lt; b</code>.</p>" in page
    assert "Not &lt;measured&gt;" in page


NAMES = ("path-planning", "speech-recognition", "vision")


def test_each_node_is_drawn_once() -> None:
    report = replace(REPORT, candidates=all_of(NAMES))

    drawing = drawing_of(report)

    assert drawing is not None
    assert [node.lines for node in drawing.nodes] == [(node.name, describe_node(node)) for node in report.candidates]
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


VALUES = st.floats(min_value=0.001, max_value=1e6)


def what_is_shown(
    values: dict[int, float], threshold: Fraction | None = None, index: str = "mean_response_time"
) -> IndexCurve:
    settings = [a_setting(reserve, a_series(responses=[value] * 3)) for reserve, value in values.items()]
    found = find_index(index)
    assert found is not None
    apt = None if threshold is None else AtMost(value=threshold)
    curve = curve_of(settings, "vision", index, a_run())
    return IndexCurve(component="vision", index=found, threshold=apt, curve=curve, points=())


def the_scale(values: dict[int, float], index: str = "mean_response_time") -> Scale:
    return scale_of(what_is_shown(values, index=index))


@given(st.dictionaries(st.integers(1, 100), VALUES, min_size=1, max_size=6), st.none() | VALUES)
def test_axis_holds_values_threshold_and_grid(values: dict[int, float], threshold: float | None) -> None:
    apt = None if threshold is None else Fraction(str(round(threshold, 3))) or Fraction(1)

    shown = what_is_shown(values, apt)

    scale = scale_of(shown)

    curve = [*(point.value for point in shown.curve.points), *([] if apt is None else [float(apt)])]
    assert scale.low < scale.high
    assert scale.low <= min(curve) + 1e-9
    assert scale.high >= max(curve) - 1e-9
    assert scale.last - scale.first >= 100
    assert scale.low <= scale.first * scale.step <= scale.last * scale.step <= scale.high
    assert [0 <= scale.height(float(tick)) <= 1 for tick in scale.ticks()] == [True] * len(scale.ticks())
    assert 1 <= len(scale.ticks()) <= 12


def test_steep_curve_has_a_logarithmic_axis() -> None:
    assert the_scale({10: 700.0, 70: 88.0}).logarithmic
    assert not the_scale({10: 100.0, 70: 88.0}).logarithmic


def test_high_success_rate_shows_its_upper_end() -> None:
    assert (the_scale({10: 5.0}, index="success_rate").low, the_scale({10: 5.0}, index="success_rate").high) == (
        80,
        100,
    )


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (0.01234, "0.0123"), (88.123, "88.1"), (100.0, "100"), (1234.56, "1234.6"), (inf, "no bound")],
)
def test_three_digits_and_no_exponent(value: float, text: str) -> None:
    assert show_number(value) == text


def test_number_never_reads_as_another_one_beside_it() -> None:
    assert [show_number(value, 300.0) for value in (299.96, 300.04, 300.0, 300.0004, 298.0)] == [
        "299.96",
        "300.04",
        "300",
        "300.0004",
        "298",
    ]


@given(st.floats(min_value=1e-9, max_value=1e9))
def test_round_number_is_just_below(value: float) -> None:
    mantissa, exponent = round_down(value)

    assert mantissa in {1, 2, 5}
    assert value / 2.51 <= mantissa * 10.0**exponent <= value * (1 + 1e-6)
