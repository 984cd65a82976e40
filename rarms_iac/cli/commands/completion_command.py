"""`rarms completion SHELL`: print the completion script of a shell."""

import click

from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.cli.shape import command_shapes, top_shape
from rarms_iac.views.completion import Shell, completion_script


@rarms_command("completion")
@click.argument("shell", type=click.Choice([shell.value for shell in Shell]))
def command(session: Session, *, shell: str) -> ExitCode:
    """Print a completion script for a shell, to be sourced or saved.

    It completes commands, options and their fixed values, and starts no Python for that.
    """
    session.terminal.data(completion_script(Shell(shell), top_shape(), command_shapes()))
    return ExitCode.DONE
