"""Commands of rarms that messages recommend, and text that holds such commands, both as data; views write them out."""

import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

from rarms_iac.model.output import OutputText, output

_WITHOUT_MANIFEST = frozenset({"init", "completion", "schema", "explain", "fmt"})
"""Verbs without `-f`, and those that are recommended with the file or the code that they are about."""


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

    @output
    def text(self) -> str:
        """The words to type, quoted for a shell: `rarms measure vision --again`."""
        options = [word for option in self.options for word in (option.name, option.value) if word is not None]
        return shlex.join(["rarms", *filter(None, [self.verb]), *self.arguments, *options])

    def also(self, **options: str | int | bool) -> "RecommendedCommand":
        """Return the command with more options behind its own, as `command` takes them."""
        return replace(self, options=(*self.options, *_options_of(options)))

    @property
    def takes_manifest(self) -> bool:
        """Whether the command reads a manifest, and its options do not say which: a view then adds `-f`."""
        has_source = any(option.name in {"-f", "--boot"} for option in self.options)
        reads_plan = self.verb in {"apply", "show"} and bool(self.arguments)
        asks_for_help = any(option.name == "--help" for option in self.options)
        return not (has_source or reads_plan or asks_for_help or self.verb in _WITHOUT_MANIFEST)


def command(verb: str, *arguments: str, **options: str | int | bool) -> RecommendedCommand:
    """Make a command: `command("measure", "vision", again=True, samples=200)`.

    Args:
        verb: the command's name, such as `measure`; empty: `rarms` alone.
        options: values by name, with `_` for `-`, and `_` at the end of a keyword of Python (`from_`). True: an option
            without a value; False: the option is left out.
    """
    return RecommendedCommand(verb, arguments, tuple(_options_of(options)))


def _options_of(options: Mapping[str, str | int | bool]) -> Iterator[CommandOption]:
    for key, value in options.items():
        name = key.strip("_").replace("_", "-")
        if value is not False:
            yield CommandOption(f"--{name}" if len(name) > 1 else f"-{name}", None if value is True else str(value))


@dataclass(frozen=True, slots=True)
class Prose(OutputText):
    """Sentences as alternating pieces of text and recommended commands; a view puts them together."""

    pieces: tuple[str | RecommendedCommand, ...]

    def __str__(self) -> str:
        """Return the text with its commands between backticks."""
        return "".join(piece if isinstance(piece, str) else f"`{piece.text}`" for piece in self.pieces)

    def __bool__(self) -> bool:
        """Return whether there is any text or command."""
        return bool(self.pieces)

    @property
    def commands(self) -> tuple[RecommendedCommand, ...]:
        """The recommended commands, in their order."""
        return tuple(piece for piece in self.pieces if isinstance(piece, RecommendedCommand))


Wording: TypeAlias = str | Prose
"""A text that may recommend commands."""


def prose(*parts: Wording | RecommendedCommand) -> Prose:
    """Join texts and commands.

    Args:
        parts: in their order; no blank is put between them.

    Returns:
        The text; neighbouring strings are one piece, and empty ones are left out.
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
    """Join the parts that are not empty, with a blank between them."""
    filled = [part for part in parts if part]
    return prose(*(piece for number, part in enumerate(filled) for piece in (" " if number else "", part)))


APPLY = command("apply")
APPLY_ABANDON = command("apply", abandon=True)
DOCTOR = command("doctor")
DRIFT = command("drift")
HISTORY = command("history")
INIT = command("init")
MEASURE = command("measure")
PLAN = command("plan")
PLAN_OUT = command("plan", out="FILE")
PROVE = command("prove")
START = command("start")
START_AT_BOOT = command("start", boot=True)
STATUS = command("status")
UNDO = command("undo")
