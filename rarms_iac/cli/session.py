"""The session that every command gets beside its options, and the commands' common form."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import wraps
from typing import Concatenate, ParamSpec

import click

from rarms_iac.app.errors import RequestError
from rarms_iac.cli.ending import ExitCode, Interrupts
from rarms_iac.cli.table import COMMANDS
from rarms_iac.views.terminal import Terminal

P = ParamSpec("P")


@dataclass(slots=True, kw_only=True)
class Session:
    """One run of the command line."""

    terminal: Terminal
    interrupts: Interrupts = field(default_factory=Interrupts)
    command: str = ""  # its name, as soon as it runs
    as_json: bool = False  # a program reads standard output: an early end is told there, too
    answer_follows: bool = False  # a run that is done is not the command's answer: what follows it is


class RarmsCommand(click.Command):
    """A command that also takes the options every command takes, wherever they stand."""

    def __init__(self, *args: object, **kwargs: object) -> None:
        super().__init__(*args, **kwargs)  # type: ignore[arg-type]  # handed through as they came from click
        self.params.extend(common_options())

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """As click does.

        Raises:
            click.UsageError: the words are wrong; it knows whose words they are, which click forgets for some.
        """
        try:
            return super().parse_args(ctx, args)
        except click.UsageError as error:
            error.ctx = error.ctx or ctx
            raise


def common_options() -> list[click.Parameter]:
    """`--no-color` and `--debug`, which act on the session and reach no command."""
    return [
        click.Option(
            ["--no-color", "--no-colour"],
            is_flag=True,
            expose_value=False,
            callback=_without_colour,
            help="Write plain text; NO_COLOR=1 does the same.",
        ),
        click.Option(
            ["--debug"],
            is_flag=True,
            expose_value=False,
            callback=_debug,
            help="Show the trace of an error.",
        ),
    ]


def rarms_command(
    name: str, *, epilog: str | None = None
) -> Callable[[Callable[Concatenate[Session, P], ExitCode]], click.Command]:
    """Make a click command of a function that takes the session and its options, and returns the exit code."""

    def make(function: Callable[Concatenate[Session, P], ExitCode]) -> click.Command:
        @wraps(function)
        def with_session(*args: P.args, **kwargs: P.kwargs) -> ExitCode:
            context = click.get_current_context()
            session = context.ensure_object(Session)
            session.command = name
            try:
                return function(session, *args, **kwargs)
            except RequestError as error:
                raise click.UsageError(str(error), context) from error

        return click.command(name, cls=RarmsCommand, short_help=COMMANDS[name], epilog=epilog)(with_session)

    return make


def _without_colour(context: click.Context, _parameter: click.Parameter, value: bool) -> None:
    if value:
        context.find_root().obj.terminal.without_colour()


def _debug(context: click.Context, _parameter: click.Parameter, value: bool) -> None:
    if value:
        context.find_root().obj.terminal.debug = True
