"""The pieces that every text for a person is made of, and `render`, which lets rich lay them out.

A view's `..._text` function takes values and returns a renderable: pieces of this module, stacked. `terminal` knows
the width and the colours of the stream and renders it there; a test renders it with `render` at 80 columns. What a
program reads (JSON, SARIF, JUnit, GitHub annotations, scripts) is plain `str` and does not come here: rich takes about
70 ms to import, so it is imported inside these functions, and only there.

Text from anywhere is shown so that it cannot act on a terminal or on the runner of a workflow: `visible`. `Terminal`
lets no other text out; forms for programs (SARIF, Markdown, HTML) use it for what they show to people.
"""

import io
import re
import unicodedata
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, TextIO, TypeAlias, Union, cast

from rarms_iac.model.commands import Prose, RecommendedCommand, Wording
from rarms_iac.texts.messages import HIDDEN

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
    from rich.text import Text


GLUE = "\ue000"
"""Stands for a space that no line is broken at; rich would break at a no-break space."""

_HARMLESS = re.compile(r"[\x20-\x7e]*")
_COMMAND = re.compile(r"(?:^|(?<=\s)):(?=:)|#(?=#\[)", re.MULTILINE)
"""What begins a command in the log of a GitHub workflow, `::error` or `##[error]`; a line may be broken before it."""
_ACTING = {"Cc", "Cf", "Cs", "Zl", "Zp"}


def visible(text: str, keep: str = "\n") -> str:
    """Spell out everything that could act on a terminal or on the runner of a workflow, or has no encoding: `<U+202E>`.

    Control characters, bidirectional and other invisible formatting, line separators, lone surrogates, and the
    beginning of a workflow's command.

    Args:
        text: from anywhere, also from an attacker.
        keep: characters that stay as they are.
    """
    if _COMMAND.search(text):
        text = _COMMAND.sub(lambda sign: f"<U+{ord(sign[0]):04X}>", text)
    if _HARMLESS.fullmatch(text):
        return text
    return "".join(
        character
        if character in keep or (unicodedata.category(character) not in _ACTING and character != GLUE)
        else f"<U+{ord(character):04X}>"
        for character in text
    )


def spell_out_hidden(text: str) -> str:
    """Spell out the characters that a reader would not see, and leave all others as they are.

    Returns:
        It; `<U+202E>` for each such character.
    """
    return HIDDEN.sub(lambda sign: f"<U+{ord(sign[0]):04X}>", text)


def plain_text(text: Wording, manifest: str) -> str:
    """Write a text out, with its commands between backticks.

    Args:
        manifest: put behind each command that takes a manifest, such as ` -f cell`; empty: nothing.
    """
    if isinstance(text, str):
        return text
    return "".join(piece if isinstance(piece, str) else f"`{command_text(piece, manifest)}`" for piece in text.pieces)


def command_text(recommended: RecommendedCommand, manifest: str) -> str:
    """Write a command out, with ` -f cell` or the like behind it where it takes a manifest."""
    return recommended.text + (manifest if recommended.takes_manifest else "")


Content: TypeAlias = Union["Text", str]
"""Text of one style, or of several; a `str` is made harmless where it is shown."""

_MANIFEST = ContextVar("manifest", default="")
"""What recommended commands end with while something is rendered: ` -f cell`."""

WIDTH = 80
UNLIMITED = 1_000_000
"""Columns of a pipe or a file: no line is broken there, so that `grep` and `diff` find it whole."""

NARROWEST_COLUMN = 8

ERROR, WARNING, NOTE, DIM, STRONG = "bold red", "bold yellow", "bold cyan", "dim", "bold"
GOOD, CHANGED, BAD = "green", "yellow", "red"

_UNIT = re.compile(r"(?<=[0-9]) (?=(?:%|LP|us|ms|s|min|h|B|[KMGT]iB|/s|/min|/h)(?![\w/]))|(?<=[<>]=) (?=[0-9])")
_ITEM = re.compile(r" *(?:-|[0-9]+\.) ")


def show_seconds(time: float) -> str:
    """Write as `0.1 s` or `75 s`: no more digits than a person reads."""
    return f"{time:.1f} s" if time < 10 else f"{time:.0f} s"


def columns(text: str) -> int:
    """Count the visible text's columns on a terminal: two for a wide character, none for a combining one."""
    if text.isascii():
        return len(text)
    from rich.cells import cell_len

    return cell_len(text)


def styled(*parts: Content | tuple[str, str]) -> "Text":
    """Join parts to one text; a pair is a part and its style, such as `("done", GOOD)`."""
    from rich.text import Text

    text = Text()
    for part in parts:
        if isinstance(part, Text):
            text.append_text(part)
        else:
            words, style = (part, "") if isinstance(part, str) else part
            text.append(_UNIT.sub(GLUE, visible(words)), style)
    return text


def stack(*parts: "RenderableType | None") -> "RenderableType":
    """Return the parts, one below the other; `""` is an empty line, None is nothing."""
    from rich.console import Group

    return Group(*(part for part in parts if part is not None))


def paragraph(
    content: Content | Prose, *, indent: int = 0, more: int = 0, start: Content = "", lead: Content = ""
) -> "RenderableType":
    """Return running text, wrapped between words; a word longer than a line keeps a line of its own.

    Its own line ends stay. The further lines of an item (`- so`) stand below the item's first word.

    Args:
        content: the text; commands in it name the manifest that this one was given.
        indent: columns before every line.
        more: further columns before every line but the first.
        start: what stands before the first line; the other lines stand below what follows it.
        lead: what the text begins with, in a style of its own.
    """
    if isinstance(content, Prose):
        return _Recommendation(content=content, indent=indent, more=more, start=start, lead=lead)
    head = styled(" " * indent, start)
    lines = [_item(line) for line in styled(lead, content).split("\n", allow_blank=True)]
    below = styled(" " * head.cell_len)
    return stack(
        *(_HangingIndent(head=below if number else head, more=more, content=line) for number, line in enumerate(lines))
    )


def _item(line: "Text") -> "RenderableType":
    marker = _ITEM.match(line.plain)
    return _HangingIndent(head=line[: marker.end()], more=0, content=line[marker.end() :]) if marker else line


@dataclass(frozen=True, slots=True, kw_only=True)
class _Recommendation:
    """A paragraph with commands, which are written out when it is rendered: only then the manifest's name is known."""

    content: Prose
    indent: int
    more: int
    start: Content
    lead: Content

    def __rich__(self) -> "RenderableType":
        text = plain_text(self.content, _MANIFEST.get())
        return paragraph(text, indent=self.indent, more=self.more, start=self.start, lead=self.lead)


def indented(content: "RenderableType", indent: int) -> "RenderableType":
    """Move anything some columns to the right."""
    return _HangingIndent(head=styled(" " * indent), more=0, content=content)


@dataclass(frozen=True, slots=True, kw_only=True)
class _HangingIndent:
    """Content whose first line stands behind a head, and whose further lines stand below the first.

    NOTE: rich's `Padding` would cut a word that is longer than the line.
    """

    head: "Text"
    more: int
    content: "RenderableType"

    def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> "RenderResult":
        from rich.segment import Segment
        from rich.text import Text

        width = max(options.max_width - self.head.cell_len - self.more, NARROWEST_COLUMN)
        blank = Segment(" " * (self.head.cell_len + self.more))
        content = self.content
        if isinstance(content, Text):
            content = content.copy()
            content.overflow = "ignore"
            first, *others = content.wrap(console, width + self.more)
            lines = [first, *others]
            if others and self.more:  # the first line has more room than those below it
                left = content.plain[len(first) :].lstrip(" ")
                lines = [first, *content[len(content) - len(left) :].wrap(console, width)]
            content = Text("\n", no_wrap=True, overflow="ignore").join(lines)
        width += self.more
        for number, line in enumerate(Segment.split_lines(console.render(content, options.update_width(width)))):
            yield from [blank] if number else self.head.render(console)
            yield from line
            yield Segment.line()


def render(content: "RenderableType", width: int = WIDTH, *, colour: bool = False, manifest: str = "") -> str:
    """Lay the content out as text that ends with a line end, without blanks at line ends.

    Args:
        width: columns; `UNLIMITED` breaks no line.
        colour: with escape sequences; without, the same text in the same lines.
        manifest: what recommended commands end with, such as ` -f cell`.
    """
    out = io.StringIO()
    token = _MANIFEST.set(manifest)
    try:
        _console(out, width, terminal=False, colour=colour).print(Harmless(content), crop=False, end="")
    finally:
        _MANIFEST.reset(token)
    text = out.getvalue().replace(GLUE, " ")
    return "".join(f"{line.rstrip(' ')}\n" for line in text.removesuffix("\n").split("\n"))


@dataclass(frozen=True, slots=True)
class Harmless:
    """A renderable of rich in which nothing can act on a terminal but rich's own signs."""

    content: "RenderableType"

    def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> "RenderResult":
        from rich.segment import Segment

        for segment in console.render(self.content, options):
            yield segment if segment.control else Segment(visible(segment.text, keep=f"\n{GLUE}"), segment.style)


def live_console(stream: TextIO, width: int, *, colour: bool) -> "Console":
    """Return a console for what rich updates in place on a terminal (`rich.live`)."""
    return _console(cast("TextIO", _PlainSpaces(stream)), width, terminal=True, colour=colour)


class _PlainSpaces:
    """A stream that writes spaces where no line is to be broken as spaces."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write the text."""
        return self._stream.write(text.replace(GLUE, " "))


def _console(stream: TextIO, width: int, *, terminal: bool, colour: bool) -> "Console":
    from rich.console import Console

    return Console(
        file=stream,
        width=width,
        force_terminal=terminal or colour,
        color_system="standard" if colour else None,
        legacy_windows=False,
        markup=False,
        highlight=False,
        emoji=False,
        _environ={},  # COLUMNS and NO_COLOR are asked by who knows the stream
    )
