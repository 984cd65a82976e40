"""Commands of rarms that a message recommends, as data, and text with commands in it; views write both out."""

import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

from rarms_iac.model.output import OutputText, output

_WITHOUT_MANIFEST = frozenset({"init", "completion", "schema", "explain", "show", "fmt"})


@dataclass(frozen=True, slots=True, order=True)
class CommandOption:
    """An option of a command: `--again`, or `--samples` with a value."""

    name: str
    value: str | None = None


@dataclass(frozen=True, slots=True, order=True)
class RecommendedCommand:
    """A command of rarms. What a person has to fill in is in capitals: `rarms plan --out FILE`."""

    verb: str
    arguments: tuple[str, ...] = ()
    options: tuple[CommandOption, ...] = ()

    @property
    @output
    def text(self) -> str:
        """The words to type, quoted for a shell: `rarms measure vision --again`."""
        options = [word for option in self.options for word in (option.name, option.value) if word is not None]
        return shlex.join(["rarms", self.verb, *self.arguments, *options])

    def also(self, **options: str | int | bool) -> "RecommendedCommand":
        """The same with these options more, as `command` takes them."""
        return replace(self, options=(*self.options, *_given(options)))

    @property
    def takes_manifest(self) -> bool:
        """Whether `-f` says which manifest it is about, and it names none."""
        names_one = any(option.name in {"-f", "--boot"} for option in self.options)
        reads_plan = self.verb == "apply" and bool(self.arguments)
        return not names_one and not reads_plan and self.verb not in _WITHOUT_MANIFEST


def command(verb: str, *arguments: str, **options: str | int | bool) -> RecommendedCommand:
    """Make a command: `command("measure", "vision", again=True, samples=200)`.

    Args:
        verb: its name; of a subcommand both words are the name and the first argument.
        arguments: what stands behind it.
        options: by their names with `_` for `-`, and one more behind a word of Python (`from_`); False: not given.
    """
    return RecommendedCommand(verb, arguments, tuple(_given(options)))


def _given(options: Mapping[str, str | int | bool]) -> Iterator[CommandOption]:
    for key, value in options.items():
        name = key.strip("_").replace("_", "-")
        if value is not False:
            yield CommandOption(f"--{name}" if len(name) > 1 else f"-{name}", None if value is True else str(value))


@dataclass(frozen=True, slots=True)
class Prose(OutputText):
    """Whole sentences in pieces, with the commands that they recommend between; a view puts them together."""

    pieces: tuple[str | RecommendedCommand, ...]

    def __str__(self) -> str:
        """The text with its commands between backticks."""
        return plain_text(self)

    def __bool__(self) -> bool:
        """Whether it says anything."""
        return bool(self.pieces)

    @property
    def commands(self) -> tuple[RecommendedCommand, ...]:
        """The commands that it recommends, in their order."""
        return tuple(piece for piece in self.pieces if isinstance(piece, RecommendedCommand))


Wording: TypeAlias = str | Prose
"""A text that may recommend commands."""


def prose(*parts: Wording | RecommendedCommand) -> Prose:
    """Put text and commands behind each other.

    Args:
        parts: as they follow each other; nothing is put between them.

    Returns:
        The text in as few pieces as it has.
    """
    pieces: list[str | RecommendedCommand] = []
    for part in parts:
        for piece in part.pieces if isinstance(part, Prose) else (part,):
            if isinstance(piece, str) and pieces and isinstance(pieces[-1], str):
                pieces[-1] += piece
            elif piece:
                pieces.append(piece)
    return Prose(tuple(pieces))


def sentences(*parts: Wording) -> Prose:
    """The parts that say something, with a blank between them."""
    said = [part for part in parts if part]
    return prose(*(piece for number, part in enumerate(said) for piece in (" " if number else "", part)))


def plain_text(text: Wording, manifest: str = "") -> str:
    """The text with its commands written out between backticks.

    Args:
        text: with or without commands.
        manifest: what a command that takes a manifest ends with, such as ` -f cell`.
    """
    if isinstance(text, str):
        return text
    return "".join(
        piece if isinstance(piece, str) else f"`{piece.text}{manifest if piece.takes_manifest else ''}`"
        for piece in text.pieces
    )


APPLY = command("apply")
APPLY_ABANDON = command("apply", abandon=True)
DOCTOR = command("doctor")
DRIFT = command("drift")
HISTORY = command("history")
INIT = command("init")
MEASURE = command("measure")
PLAN = command("plan")
PLAN_OUT = command("plan", out="FILE")
START_AT_BOOT = command("start", boot=True)
UNDO = command("undo")
