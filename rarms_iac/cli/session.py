"""The session that every command gets with its requests, and the options that act on it alone."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import click

from rarms_iac.cli.ending import Interrupts
from rarms_iac.views.terminal import Terminal

if TYPE_CHECKING:
    from rich.console import RenderableType


@dataclass(slots=True, kw_only=True)
class Session:
    """One run of the command line."""

    terminal: Terminal
    interrupts: Interrupts = field(default_factory=Interrupts)
    command: str = ""  # its name, as soon as it runs
    as_json: bool = False  # a program reads standard output: an early end is reported there, too
    answer_follows: bool = False  # a run that is done is not the command's answer: what follows it is

    def answer(self, as_json: Callable[[], str], as_text: Callable[[], "RenderableType"]) -> None:
        """Write the command's answer for a program, or for a person."""
        if self.as_json:
            self.terminal.data(as_json())
        else:
            self.terminal.show(as_text())


def common_options() -> list[click.Parameter]:
    """Make `--no-color`, `--debug` and `--help`, which act on the session and reach no command."""
    return [
        session_flag("--no-color", act=_without_colour, text="Write plain text; NO_COLOR=1 does the same."),
        session_flag("--debug", act=_debug, text="Show the trace of an error."),
        session_flag("-h", "--help", act=_help, text="Show this message and exit.", is_eager=True),
    ]


def session_flag(
    *flags: str, act: Callable[[click.Context, click.Parameter, bool], None], text: str, is_eager: bool = False
) -> click.Option:
    """Return an option that acts on the session and reaches no command."""
    return click.Option(flags, is_flag=True, is_eager=is_eager, expose_value=False, callback=act, help=text)


def _without_colour(context: click.Context, _parameter: click.Parameter, value: bool) -> None:
    if value:
        context.find_root().obj.terminal.without_colour()


def _debug(context: click.Context, _parameter: click.Parameter, value: bool) -> None:
    if value:
        context.find_root().obj.terminal.debug = True


def _help(context: click.Context, _parameter: click.Parameter, value: bool) -> None:
    """Write the help, which click itself would write with an error where the reader has seen enough."""
    if value and not context.resilient_parsing:
        context.find_root().obj.terminal.data(f"{context.get_help()}\n")
        context.exit()
