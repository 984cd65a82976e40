"""`rarms` itself: the table of commands, and a group that imports a command only when it is called."""

import os
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType

import click
from click.shell_completion import CompletionItem

from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.cli.ending import WrongRequest
from rarms_iac.cli.session import common_options, session_flag
from rarms_iac.model.commands import INIT, prose

COMMANDS: Mapping[str, str] = MappingProxyType(
    {
        "init": "Write a commented manifest to start from.",
        "validate": "Check manifests without a host.",
        "fmt": "Write manifests in canonical form, with their comments.",
        "install": "Install rarms on Linux hosts over ssh, or remove it there.",
        "doctor": "Check that the hosts can honour reservations.",
        "status": "Show the state of the hosts, the proofs, and the next command.",
        "measure": "Find the reservations that components need.",
        "select": "Choose the performance that is good enough for a component.",
        "tune": "Combine components so that their reservations fit.",
        "plan": "Show what would change on the hosts.",
        "show": "Show a plan file.",
        "apply": "Apply a plan file, or plan, ask and apply.",
        "undo": "Undo the last apply.",
        "history": "List the applies and undos on the hosts.",
        "prove": "Run the applied layout and compare it with the thresholds.",
        "stop": "Stop partitions until they are started again.",
        "start": "Start partitions that were stopped.",
        "destroy": "Remove all that rarms created for this application.",
        "drift": "Show changes that were made outside rarms, and changes not applied yet.",
        "import": "Manage a partition that rarms did not create.",
        "release": "Stop managing a partition without changing it.",
        "snapshot": "Save the state of a host in a file.",
        "run": "Run components on this machine, to check their `run`.",
        "graph": "Draw hosts, partitions and components.",
        "report": "Show performance against reservation, as a page with lines to drag.",
        "studio": "Open a local page to measure, plan and apply.",
        "export": "Write the measurements as CSV or XLSX.",
        "explain": "Explain a finding, or why a component gets its reservation.",
        "schema": "Print a JSON Schema.",
        "completion": "Print a completion script for a shell.",
        "simulate": "Change a simulated host as another tool would.",
    }
)
"""In the order in which they are met."""

FOR_SIMULATED_HOSTS = frozenset({"simulate"})
"""Commands that no real host knows; help lists them apart."""

_TOGETHER = {
    "manifest_commands": ("init", "validate", "fmt"),
    "host_commands": ("doctor", "status", "history", "drift", "snapshot", "simulate", "install"),
    "component_commands": ("select", "prove", "run"),
    "apply_commands": ("apply", "undo"),
    "partition_commands": ("stop", "start", "destroy", "import", "release"),
    "report_commands": ("graph", "report", "export", "studio"),
    "plan_commands": ("plan", "show"),
    "measure_commands": ("measure", "tune"),
    "help_commands": ("explain", "schema", "completion"),
}
"""Modules of more than one command, by name; each of the rest has its own, `measure_command`."""


def load_command(name: str) -> click.Command:
    """Return the command of this name, which is one of `COMMANDS`; its module is imported now."""
    module = next((module for module, names in _TOGETHER.items() if name in names), f"{name}_command")
    command: click.Command = getattr(import_module(f"rarms_iac.cli.commands.{module}"), f"{name}_command")
    return command


def all_commands() -> dict[str, click.Command]:
    """Import and return every command by name, in the table's order."""
    return {name: load_command(name) for name in COMMANDS}


HELP = """From a manifest in git to CPU reservations on a host: plan, review, apply.

\b
  rarms            show the state and the next command
  rarms init       write a first manifest
  rarms validate   check it
  rarms plan       show the changes
  rarms apply      make the changes
"""

EPILOG = "`rarms COMMAND --help` describes a command; `rarms explain RARMS014` explains a finding."


class LazyGroup(click.Group):
    """Commands by a table of names; a command's module is imported when it is looked up."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the words up to the command.

        Raises:
            WrongRequest: an option of the command stands before it.
        """
        words = tuple(args)
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as error:
            verb = next((word for word in words if word in COMMANDS), None)
            options = [name for parameter in load_command(verb).params for name in parameter.opts] if verb else []
            if error.option_name not in options:
                raise
            message = f"The option {error.option_name} belongs to rarms {verb}: write it after the command."
            raise WrongRequest(RequestError(message), ctx) from None

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        """Return all names in the table's order."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002 - click's signature
        """Return the command of this name, imported now."""
        if cmd_name not in COMMANDS:
            return None
        return load_command(cmd_name)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002 - click's signature
        """Write the list of `rarms --help` from the table."""
        with formatter.section("Commands"):
            formatter.write_dl([each for each in COMMANDS.items() if each[0] not in FOR_SIMULATED_HOSTS])
        with formatter.section("On simulated hosts"):
            formatter.write_dl([each for each in COMMANDS.items() if each[0] in FOR_SIMULATED_HOSTS])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem[str]]:
        """Return commands from the table, then the options."""
        commands = [CompletionItem(name, help=text) for name, text in COMMANDS.items() if name.startswith(incomplete)]
        return [*commands, *click.Command.shell_complete(self, ctx, incomplete)]

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that the first word names.

        Raises:
            click.UsageError: there is none; the message offers the nearest.
        """
        if args and ctx.obj is not None:
            ctx.obj.command = args[0]  # before it is imported: an interrupt may come as early
        if args and args[0] not in COMMANDS and not args[0].startswith("-") and not ctx.resilient_parsing:
            from rarms_iac.texts.messages import suggestion

            raise click.UsageError(f'Unknown command "{args[0]}".{suggestion(args[0], COMMANDS)}', ctx)
        return super().resolve_command(ctx, args)


def root_group() -> LazyGroup:
    """Return the whole command line."""
    version = session_flag("--version", act=_version, text="Show the version and exit.", is_eager=True)
    return LazyGroup(
        name="rarms",
        help=HELP,
        epilog=EPILOG,
        params=[version, *common_options()],
        add_help_option=False,  # `common_options` has it
        no_args_is_help=False,
        invoke_without_command=True,
        callback=_status_without_command,
    )


@click.pass_context
def _status_without_command(context: click.Context) -> int | None:
    """Show the status for `rarms` alone, if there is a manifest."""
    if context.invoked_subcommand is not None:
        return None
    from rarms_iac.app.requests import DEFAULT_MANIFEST
    from rarms_iac.manifest.load import find_manifest_above

    named = os.environ.get("RARMS_MANIFEST")
    manifest = Path(named or DEFAULT_MANIFEST)
    if not manifest.exists() and (named or find_manifest_above() is None):
        raise WrongRequest(
            RequestError(f"This folder has no {manifest}.", prose("Write a first manifest: ", INIT, ".")), context
        )
    command = load_command("status")
    with command.make_context("status", [], parent=context) as status:
        code: int = command.invoke(status)
    return code


def _version(context: click.Context, _parameter: click.Parameter, value: bool) -> None:
    if value:
        from rarms_iac.model.version import __version__

        context.find_root().obj.terminal.data(f"rarms {__version__}\n")
        context.exit()
