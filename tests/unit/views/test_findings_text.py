"""Text that rarms did not write acts neither on a terminal nor on the runner of a workflow."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.model.commands import prose
from rarms_iac.model.diagnostics import Diagnostic, Place, Related, Severity, Sources
from rarms_iac.storage.shipped import finding_page
from rarms_iac.texts.findings import Finding
from rarms_iac.views.console import columns, render, visible
from rarms_iac.views.findings_text import findings_summary, findings_text, page_text, unknown_code

EXCEEDED = Finding(code="RARMS014", severity=Severity.ERROR, summary="Reservations exceed the platform")
RESTART = Finding(code="RARMS041", severity=Severity.WARNING, summary="A change restarts a partition")


def at(line: int, column: int, *, length: int = 1, path: str = "", file: str = "robot.yaml") -> Place:
    return Place(file=file, line=line, column=column, path=path, length=length)


def as_text(diagnostics: Sequence[Diagnostic], sources: Sources) -> str:
    return render(findings_text(diagnostics, sources))


def shown(source: str, place: Place) -> list[str]:
    """The source line and the caret line as they are rendered."""
    return as_text([EXCEEDED.at(place, "Why.", "What to do.")], {"robot.yaml": source}).splitlines()[2:4]


def test_form_is_code_place_line_detail_advice() -> None:
    finding = EXCEEDED.at(
        at(2, 25, path="hosts.onboard.logical_processors"),
        "FDP 1.4 LP, SRP 0.6 LP and PPP 0.4 LP need 2.4 LP; onboard has 2 LP for partitions.",
        "Relax an APT, or let `rarms tune` combine the least critical CoIs.",
    )

    text = as_text([finding], {"robot.yaml": "hosts:\n    logical_processors: 2\n"})

    assert (
        text
        == """\
error[RARMS014] Reservations exceed the platform
  robot.yaml:2:25, hosts.onboard.logical_processors
  2 |     logical_processors: 2
    |                         ^
  FDP 1.4 LP, SRP 0.6 LP and PPP 0.4 LP need 2.4 LP; onboard has 2 LP for
  partitions.
  Relax an APT, or let `rarms tune` combine the least critical CoIs.

1 error.
"""
    )


def test_the_caret_underlines_the_whole_value() -> None:
    assert shown("memory: 5 GB", at(1, 9, length=4)) == ["  1 | memory: 5 GB", "    |         ^^^^"]


def test_wide_characters_keep_the_caret() -> None:
    line, caret = shown("名前: e\u0301x !", at(1, 9))

    assert caret.index("^") == columns(line[: line.index("!")])
    assert columns("名前") == 4
    assert columns("e\u0301") == 1


def test_wide_character_gets_two_carets() -> None:
    assert shown("a: ７", at(1, 4)) == ["  1 | a: ７", "    |    ^^"]


def test_tabs_become_spaces_in_both_lines() -> None:
    assert shown("a:\tb", at(1, 4)) == ["  1 | a:      b", "    |         ^"]


def test_what_acts_on_a_terminal_is_spelt_out() -> None:
    line, caret = shown("a: \x1b[31m\u202e!", at(1, 10))

    assert line == "  1 | a: <U+001B>[31m<U+202E>!"
    assert caret.index("^") == line.index("!")
    assert visible("\ud800") == "<U+D800>"


@pytest.mark.parametrize("column", [1, 60, 500, 998, 1000])
def test_long_line_is_cut_around_the_place(column: int) -> None:
    source = "".join("x" if n + 1 != column else "!" for n in range(1000))

    line, caret = shown(source, at(1, column))

    assert len(line) <= 80
    assert line[caret.index("^")] == "!"


def test_huge_line_is_quick() -> None:
    line, caret = shown("x" * 8_000_000 + "!", at(1, 8_000_001))

    assert line[caret.index("^")] == "!"


def test_place_without_text_has_no_snippet() -> None:
    assert shown("a: 1", at(7, 1)) == ["  Why.", "  What to do."]
    assert "  1 |" not in as_text([EXCEEDED.at(at(1, 1, file="-"), "Why.", "Do.")], {})


def test_caret_may_stand_behind_end_of_its_line() -> None:
    assert shown("a:", at(1, 9)) == ["  1 | a:", "    |   ^"]


def test_second_place_is_shown_with_what_it_says() -> None:
    finding = EXCEEDED.at(at(2, 1), "Twice.", "Remove one.", related=(Related(place=at(1, 1), message="first here"),))

    text = as_text([finding], {"robot.yaml": "a: 1\na: 2\n"})

    assert "  robot.yaml:1:1, first here\n  1 | a: 1\n    | ^\n" in text


def test_only_warning_says_address_that_acceptance_names() -> None:
    warning = RESTART.at(at(1, 1, path="partitions.vision"), "Why.", "Do.", address="partition/vision")
    error = EXCEEDED.at(at(1, 1, path="hosts.onboard"), "Why.", "Do.", address="host/onboard")

    text = as_text([warning, error], {})

    assert "  robot.yaml:1:1, partitions.vision, at partition/vision\n" in text
    assert "host/onboard" not in text


@pytest.mark.parametrize(
    ("diagnostics", "accepted", "expected"),
    [
        ([], 0, "No findings."),
        ([], 2, "No findings (2 accepted)."),
        ([EXCEEDED], 0, "1 error."),
        ([EXCEEDED, RESTART, RESTART], 1, "1 error, 2 warnings (1 accepted)."),
    ],
)
def test_the_last_line_counts(diagnostics: list[Finding], accepted: int, expected: str) -> None:
    silenced = [RESTART.at(None, "", "")] * accepted

    assert findings_summary([diagnostic.at(None, "", "") for diagnostic in diagnostics], silenced) == expected


diagnostics = st.builds(
    Diagnostic,
    code=st.from_regex(r"RARMS[0-9]{3}", fullmatch=True),
    severity=st.sampled_from(Severity),
    summary=st.text(st.characters(), max_size=30),
    detail=st.text(st.characters(), max_size=90),
    advice=st.builds(prose, st.text(st.characters(), max_size=90)),
    place=st.none()
    | st.builds(
        Place,
        file=st.just("robot.yaml"),
        line=st.integers(1, 4),
        column=st.integers(1, 200),
        path=st.text(st.characters(), max_size=20),
        length=st.integers(0, 300),
    ),
)


@given(st.lists(diagnostics, max_size=3), st.text(st.characters(), max_size=300))
def test_colour_only_adds(some: list[Diagnostic], source: str) -> None:
    text = as_text(some, {"robot.yaml": source})
    coloured = render(findings_text(some, {"robot.yaml": source}), colour=True)

    assert text.encode("utf-8")
    assert "\x1b" not in text
    assert (coloured != text) == bool(some)


def test_equal_findings_become_a_list() -> None:
    some = [EXCEEDED.at(at(line, 1, path="hosts"), "{_detail}", "Do it.", _detail=f"Why {line}.") for line in (1, 2)]

    assert as_text(some, {}).splitlines() == [
        "error[RARMS014] Reservations exceed the platform (2)",
        "  - robot.yaml:1:1, hosts: Why 1.",
        "  - robot.yaml:2:1, hosts: Why 2.",
        "  Do it.",
        "",
        "2 errors.",
    ]


def test_an_advice_that_differs_stands_with_its_item() -> None:
    some = [EXCEEDED.at(None, "Why.", f"Do {number}.", address=f"host/h{number}") for number in (1, 2)]

    assert as_text(some, {}).splitlines()[1:3] == ["  - at host/h1: Why. Do 1.", "  - at host/h2: Why. Do 2."]


@given(diagnostics, st.text(st.characters(), max_size=300))
def test_no_source_line_takes_more_than_eighty_columns(diagnostic: Diagnostic, source: str) -> None:
    text = as_text([diagnostic], {"robot.yaml": source})

    assert all(columns(line) <= 80 for line in text.splitlines() if " | " in line[:8] and "^" in line)


def test_briefly_a_kind_of_notes_is_one_line() -> None:
    note = Finding(code="RARMS086", severity=Severity.NOTE, summary="An entry is not used")
    some = [
        note.at(at(1, 1, path="interference.browsers"), "Why.", "Do it."),
        note.at(at(2, 1), "Why.", "Do it."),
    ]

    brief = render(findings_text(some, {}, brief=True), 120).splitlines()

    line = "note[RARMS086] An entry is not used: robot.yaml:1:1, interference.browsers; robot.yaml:2:1"
    assert brief == [line]


def test_path_in_sentence_stands_once() -> None:
    named = [EXCEEDED.at(at(line, 1, path="hosts"), "hosts is empty.", "Do it.", path="hosts") for line in (1, 2)]
    other = [EXCEEDED.at(at(line, 1, path="hosts"), "Some hosts.", "Do it.") for line in (1, 2)]

    assert as_text(named, {}).splitlines()[1] == "  - robot.yaml:1:1: hosts is empty."
    assert as_text(other, {}).splitlines()[1] == "  - robot.yaml:1:1, hosts: Some hosts.", "no sentence is read"


def test_a_finding_is_explained_by_its_page() -> None:
    page = finding_page("RARMS042")

    assert page is not None
    text = render(page_text(page))
    assert text.startswith("RARMS042: Unknown name\n======================\n\nSeverity: error.\n")
    assert "    apart: [video-straeming]" in text
    assert "```" not in text


def test_unknown_id_says_where_all_are() -> None:
    assert finding_page("RARMS000") is None
    assert finding_page("../RARMS042") is None
    assert "Did you mean" not in unknown_code("RARMS999"), "a number that is near says nothing"
    assert "docs/diagnostics.md lists them all" in unknown_code("RARMS999")


def test_page_becomes_eighty_columns() -> None:
    page = "# T\n\n" + "word " * 40 + "\nmore [a link](x.md)\n\n- one\n- two\n  lines\n\n```\n# code\n```\nend\n"

    text = render(page_text(page))

    assert all(columns(line) <= 80 for line in text.splitlines())
    assert "more a link\n" in text
    assert "\n- one\n- two lines\n" in text
    assert "\n    # code\n" in text
    assert text.endswith("\nend\n")


def test_example_lines_hang_below_first_word() -> None:
    first, second = "face-detection 70 %, speech-recognition 30 % and path-planning 20 % need", "120 % of the two."

    text = render(page_text(f"# T\n\n```\nerror\n  {first} {second}\n```\n"))

    assert f"      {first}\n      {second}\n" in text


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain: a::b, C::D and 1:2", "plain: a::b, C::D and 1:2"),
        ("\x1b[31mred", "<U+001B>[31mred"),
        ("a\u202eb", "a<U+202E>b"),
        ("first\n::error::x", "first\n<U+003A>:error::x"),
        ("folded ::set-env name=A::b", "folded <U+003A>:set-env name=A::b"),
        ("##[error]x", "<U+0023>#[error]x"),
    ],
)
def test_what_acts_is_spelt_out(text: str, shown: str) -> None:
    assert visible(text) == shown
