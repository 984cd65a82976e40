"""The shape of the whole command line, read from its commands: for completion scripts and the reference."""

import re
from collections.abc import Iterator

import click

from rarms_iac.cli.group import root_group
from rarms_iac.cli.table import COMMANDS
from rarms_iac.storage.shipped import known_codes
from rarms_iac.views.completion import CommandShape, OptionShape
from rarms_iac.views.finding_forms import OutputFormat

HELP_OPTION = OptionShape(flags=("-h", "--help"), help="Show this message and exit.")


def top_shape() -> tuple[OptionShape, ...]:
    """The options of `rarms` itself."""
    return (*_options(root_group()), HELP_OPTION)


def command_shapes() -> tuple[CommandShape, ...]:
    """Every command, in the table's order. Imports them all."""
    return tuple(_shape(name, command) for name, command in all_commands())


def all_commands() -> Iterator[tuple[str, click.Command]]:
    """Every command with its name, in the table's order. Imports them all."""
    group = root_group()
    context = click.Context(group, info_name="rarms")
    for name in COMMANDS:
        command = group.get_command(context, name)
        assert command is not None, f"the table names {name}, and there is no such command"
        yield name, command


def _shape(name: str, command: click.Command) -> CommandShape:
    arguments = [parameter for parameter in command.params if isinstance(parameter, click.Argument)]
    called = " ".join(f"{argument.name} {argument.metavar}" for argument in arguments)
    return CommandShape(
        name=name,
        help=COMMANDS[name],
        options=(*_options(command), HELP_OPTION),
        words=tuple(word for argument in arguments for word in _choices(argument)),
        # a partition has the name of its most critical component
        takes_names=re.search("component|partition", called, re.IGNORECASE) is not None,
    )


def _options(command: click.Command) -> tuple[OptionShape, ...]:
    return tuple(
        OptionShape(
            flags=(*parameter.opts, *parameter.secondary_opts),
            help=" ".join((parameter.help or "").split()),
            takes_value=not parameter.is_flag,
            choices=_choices(parameter),
        )
        for parameter in command.params
        if isinstance(parameter, click.Option)
    )


def _choices(parameter: click.Parameter) -> tuple[str, ...]:
    if parameter.metavar == "FINDING|COMPONENT":
        return known_codes()
    if parameter.metavar == "FORMAT[=FILE]":
        return tuple(OutputFormat)
    return tuple(map(str, parameter.type.choices)) if isinstance(parameter.type, click.Choice) else ()
