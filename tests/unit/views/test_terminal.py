import io

from rarms_iac.views.console import STRONG, styled
from rarms_iac.views.terminal import DEFAULT_WIDTH, NARROWEST, WIDEST, Terminal, make_safe, width_of


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
