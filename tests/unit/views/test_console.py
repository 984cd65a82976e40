import io
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.model.commands import DRIFT, PLAN_OUT, RecommendedCommand, command, prose
from rarms_iac.views.console import (
    BAD,
    STRONG,
    UNLIMITED,
    columns,
    indented,
    paragraph,
    plain_text,
    render,
    stack,
    styled,
    visible,
)
from rarms_iac.views.table import Column, Row, Table, cut_row
from rarms_iac.views.terminal import DEFAULT_WIDTH, NARROWEST, WIDEST, Terminal, make_safe, width_of


def lines(content: object, width: int = 80) -> list[str]:
    return render(content, width).splitlines()  # type: ignore[arg-type]  # rich says `object` for renderables


def a_table(
    rows: Sequence[Row], header: Sequence[str] = (), wrap: Sequence[int] = (), right: Sequence[int] = ()
) -> Table:
    titles = header or [str(number) for number in range(len(rows[0]))]
    columns = [Column(title, wraps=at in wrap, right=at in right) for at, title in enumerate(titles)]
    return Table(columns, rows, header=bool(header))


def test_a_number_is_not_parted_from_its_unit() -> None:
    assert lines(paragraph("it takes 120 % of it"), 12) == ["it takes", "120 % of it"]


def test_further_lines_stand_below_first_word() -> None:
    assert lines(paragraph("one of:\n- the first way\n  - a part of it", indent=2), 14) == [
        "  one of:",
        "  - the first",
        "    way",
        "    - a part",
        "      of it",
    ]


@pytest.mark.parametrize("width", [40, 50, 60])
def test_narrow_table_breaks_between_words_and_cuts_nothing(width: int) -> None:
    cells = ("path-planning", "maximum_response_time <= 400 ms", "177.5 ms", "met so far")
    shown = lines(a_table([cells], header=("component", "threshold", "measured", "verdict"), wrap=(1, 3)), width)

    assert max(map(len, shown)) <= width
    told = " ".join(shown).split()
    assert [word for cell in cells for word in cell.split() if word not in told] == []


def test_long_row_stands_below_first_cell() -> None:
    rows = [
        ("face-detection-in-front", "88 ms", "met"),
        ("x", "9 ms", "far below what it must be"),
        ("y", "7 ms", "not met so far"),
    ]

    assert lines(indented(a_table(rows, header=("component", "value", "verdict")), 2), 32) == [
        "  face-detection-in-front",
        "    value: 88 ms  verdict: met",
        "  x",
        "    value: 9 ms",
        "    verdict: far below what it",
        "      must be",
        "  y",
        "    value: 7 ms",
        "    verdict: not met so far",
    ]
    assert lines(a_table([("a", "x" * 60)], wrap=(1,)), 40) == ["a", "  " + "x" * 60]


def test_further_lines_hang_below_the_text() -> None:
    assert lines(paragraph("set this and that", start="  [1/2] "), 18) == ["  [1/2] set this", "        and that"]
    assert lines(paragraph("set this and that", indent=2, more=2), 12) == ["  set this", "    and that"]


def test_word_longer_than_line_is_not_broken() -> None:
    assert lines(paragraph("see /a/path/that/is/longer now", indent=2), 14) == [
        "  see",
        "  /a/path/that/is/longer",
        "  now",
    ]


@given(st.text(st.characters(), max_size=300), st.integers(20, 100))
def test_wrapping_loses_no_word(text: str, width: int) -> None:
    shown = lines(paragraph(text, indent=2), width)

    assert visible(text).split() == " ".join(shown).split()
    assert all(columns(line) <= width or len(line.split()) <= 2 for line in shown)


def test_table_wraps_columns_without_breaking_names() -> None:
    rows = [("mean_response_time", "88 ms", "far below what it must be"), ("x", "9 ms", "met")]

    assert lines(a_table(rows, header=("index", "value", "verdict"), right=(1,), wrap=(2,)), 44) == [
        "index               value  verdict",
        "mean_response_time  88 ms  far below what it",
        "                           must be",
        "x                    9 ms  met",
    ]


def test_no_line_of_a_pipe_is_broken() -> None:
    assert len(lines(paragraph("word " * 500), UNLIMITED)) == 1


@pytest.mark.parametrize("colour", [False, True])
def test_colour_changes_no_word(colour: bool) -> None:
    text = render(stack(styled(("bad", BAD)), "", paragraph("good")), colour=colour)

    assert text == ("\x1b[31mbad\x1b[0m\n\ngood\n" if colour else "bad\n\ngood\n")


@pytest.mark.parametrize("width", [40, 60, 80])
@pytest.mark.parametrize("wrap", [(), (1, 3), (0, 1, 2, 3, 4)], ids=["nothing wraps", "two wrap", "all wrap"])
def test_wide_table_loses_nothing(wrap: tuple[int, ...], width: int) -> None:
    header = ("component", "performance index", "expected", "verdict", "reserve")
    rows = [
        ("localization-of-arm", "response time of the 95th percentile", "104.7 ms", "not enough", "35 % of 2 VPs"),
        ("vision", "throughput", "29.8 /s", "enough, by a hair", "140 %"),
    ]

    shown = lines(a_table(rows, header=header, wrap=wrap, right=(2, 4)), width)

    words = " ".join(shown).replace(":", "").split()
    assert [word for cells in (header[1:], *rows) for cell in cells for word in cell.split() if word not in words] == []
    assert max(map(len, shown)) <= width


def test_running_row_fits_one_line() -> None:
    running = ("attitude", "20 % of its VP", "1234 samples, p95_response_time 10.1 ms, some 2 min left at most")

    assert cut_row(running, 200) == running
    assert "  ".join(cut_row(running, 80)) == (
        "attitude  20 % of its VP  1234 samples, p95_response_time 10.1 ms, some 2 min..."
    )
    long = "  ".join(cut_row(("p" * 60, *running[1:]), 80))
    assert len(long) == 80
    assert long.startswith("ppp")
    assert "ppp...  20 % of its VP  1234 samples, p95_resp" in long


class FakeTerminal(io.StringIO):
    """A stream that a user looks at."""

    def isatty(self) -> bool:
        return True


def wrapper(encoding: str) -> io.TextIOWrapper:
    return io.TextIOWrapper(io.BytesIO(), encoding=encoding, newline="\r\n")


def written(stream: io.TextIOWrapper, text: str) -> bytes:
    stream.write(text)
    stream.flush()
    buffer = stream.buffer
    assert isinstance(buffer, io.BytesIO)
    return buffer.getvalue()


def test_what_stream_cannot_show_is_written_as_escape() -> None:
    stream = wrapper("ascii")
    make_safe(stream)

    assert written(stream, "Prüfung \ud800\n") == b"Pr\\xfcfung \\ud800\n"


def test_windows_pipe_gets_utf_8_and_line_feeds() -> None:
    stream = wrapper("cp1252")
    make_safe(stream)

    assert written(stream, "≥\n") == "≥\n".encode()


def test_width_is_80_or_the_terminals() -> None:
    assert width_of(io.StringIO(), {}) == DEFAULT_WIDTH
    assert NARROWEST <= width_of(FakeTerminal(), {}) <= WIDEST


def test_terminal_wraps_and_pipe_does_not() -> None:
    err = io.StringIO()
    Terminal(out=io.StringIO(), err=err, width=20).tell("one two three four five six")
    Terminal(out=io.StringIO(), err=err, width=20, talk_wrapped=False).tell("one two three four five six")

    assert err.getvalue().splitlines() == ["one two three four", "five six", "one two three four five six"]


def test_talk_follows_written_data() -> None:
    terminal = Terminal(out=io.StringIO(), err=io.StringIO())
    terminal.data("data\n")
    terminal.talk("talk")

    assert isinstance(terminal.out, io.StringIO)
    assert isinstance(terminal.err, io.StringIO)
    assert (terminal.out.getvalue(), terminal.err.getvalue()) == ("data\n", "talk\n")


def test_colours_need_a_terminal() -> None:
    out = io.StringIO()

    Terminal(out=out, err=io.StringIO(), colour=True).show(styled(("vision\x1b[31m", STRONG)))

    assert out.getvalue() == "\x1b[1mvision<U+001B>[31m\x1b[0m\n"


@pytest.mark.parametrize(
    ("recommended", "written"),
    [
        (DRIFT, "`rarms drift -f cell`"),
        (PLAN_OUT, "`rarms plan --out FILE -f cell`"),
        (command("explain", "RARMS014"), "`rarms explain RARMS014`"),
        (command("apply", "FILE"), "`rarms apply FILE`"),
        (command("plan", f="robot"), "`rarms plan -f robot`"),
    ],
)
def test_command_names_the_manifest_if_it_takes_one(recommended: RecommendedCommand, written: str) -> None:
    assert plain_text(prose("Look: ", recommended, "."), " -f cell") == f"Look: {written}."
