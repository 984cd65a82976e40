"""All commands with the line that `rarms --help` shows: a table, so that help imports no command."""

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType

import click

COMMANDS: Mapping[str, str] = MappingProxyType(
    {
        "init": "Write a commented manifest to start from.",
        "validate": "Check manifests; needs no host.",
        "fmt": "Write manifests in their canonical form, comments kept.",
        "install": "Install rarms on Linux hosts over ssh, or remove it there.",
        "doctor": "Tell what makes a plan ineffective or unsafe on the hosts.",
        "status": "Show what is on the hosts, what was proven, and what to do next.",
        "measure": "Find the reservations that components need.",
        "select": "Choose the performance that is good enough for a component.",
        "tune": "Combine components so that their reservations fit.",
        "plan": "Show what would change on the hosts.",
        "show": "Show a plan file.",
        "apply": "Do what a plan says, or plan, ask and do it.",
        "undo": "Undo the last apply.",
        "history": "Tell what was applied by whom and when, and what was undone.",
        "prove": "Run all components in the applied layout, beside their thresholds.",
        "stop": "Stop partitions until they are started again.",
        "start": "Start partitions that were stopped.",
        "destroy": "Remove what rarms made for this application.",
        "drift": "Tell what changed on the hosts, and what is not applied yet.",
        "import": "Take over a partition that rarms did not make.",
        "release": "Let go of a partition: it stays, rarms forgets it.",
        "snapshot": "Write down what a host looks like.",
        "run": "Run components on this machine, to see whether their `run` is right.",
        "graph": "Draw hosts, partitions and components.",
        "report": "Show performance against reservation, as a page with lines to drag.",
        "studio": "Serve measuring, planning and applying as a page on this machine.",
        "export": "Write what was measured as CSV or XLSX.",
        "explain": "Explain a finding, or how a component comes to what it gets.",
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
    "host_commands": ("doctor", "status", "history", "drift", "snapshot", "simulate"),
    "component_commands": ("select", "prove", "run"),
    "apply_commands": ("apply", "undo"),
    "partition_commands": ("stop", "start", "destroy", "import", "release"),
    "report_commands": ("graph", "report", "export"),
    "help_commands": ("explain", "schema", "completion"),
}
"""Modules of more than one command, by name; each of the rest has its own, `measure_command`."""


def load_command(name: str) -> click.Command:
    """Return the command of this name, which is one of `COMMANDS`; its module is imported now."""
    module = next((module for module, names in _TOGETHER.items() if name in names), f"{name}_command")
    command: click.Command = getattr(import_module(f"rarms_iac.cli.commands.{module}"), f"{name}_command")
    return command


def all_commands() -> dict[str, click.Command]:
    """Every command by its name, in the table's order. Imports them all."""
    return {name: load_command(name) for name in COMMANDS}
