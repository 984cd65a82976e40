"""The session that every command gets beside its requests, and the options that act on it alone."""

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
    as_json: bool = False  # a program reads standard output: an early end is told there, too
    answer_follows: bool = False  # a run that is done is not the command's answer: what follows it is

    def answer(self, as_json: Callable[[], str], as_text: Callable[[], "RenderableType"]) -> None:
        """Write the command's answer for a program, or for a person."""
        if self.as_json:
            self.terminal.data(as_json())
        else:
            self.terminal.show(as_text())


def common_options() -> list[click.Parameter]:
    """`--no-color` and `--debug`, which act on the session and reach no command."""
    return [
        session_flag("--no-color", _without_colour, "Write plain text; NO_COLOR=1 does the same."),
        session_flag("--debug", _debug, "Show the trace of an error."),
    ]


def session_flag(
    flag: str, act: Callable[[click.Context, click.Parameter, bool], None], text: str, *, is_eager: bool = False
) -> click.Option:
    """An option that acts on the session and reaches no command."""
    return click.Option([flag], is_flag=True, is_eager=is_eager, expose_value=False, callback=act, help=text)


def _without_colour(context: click.Context, _parameter: click.Parameter, value: bool) -> None:
    if value:
        context.find_root().obj.terminal.without_colour()


def _debug(context: click.Context, _parameter: click.Parameter, value: bool) -> None:
    if value:
        context.find_root().obj.terminal.debug = True
