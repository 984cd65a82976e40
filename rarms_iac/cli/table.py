"""All commands with the line that `rarms --help` shows: a table, so that help imports no command."""

from collections.abc import Mapping
from types import MappingProxyType

COMMANDS: Mapping[str, str] = MappingProxyType(
    {
        "init": "Write a commented manifest to start from.",
        "validate": "Check manifests; needs no host.",
        "fmt": "Write manifests in their canonical form, comments kept.",
        "doctor": "Tell what makes a plan ineffective or unsafe on the hosts.",
        "status": "Show what is on the hosts, what was proven, and what to do next.",
        "measure": "Find the reservations that components need.",
        "select": "Choose the performance that is good enough for a component.",
        "tune": "Combine components so that their reservations fit.",
        "plan": "Show what would change on the hosts.",
        "show": "Show a plan file.",
        "apply": "Do what a plan says, or plan, ask and do it.",
        "undo": "Take the last apply back.",
        "history": "Tell what was applied by whom and when, and what was undone.",
        "prove": "Run all components in the applied layout, beside their thresholds.",
        "stop": "Stop partitions until they are started again.",
        "start": "Start partitions that were stopped.",
        "destroy": "Remove what rarms made for this application.",
        "drift": "Tell what changed on the hosts, and what is not applied yet.",
        "import": "Take over a partition that rarms did not make.",
        "release": "Let go of a partition: it stays, rarms forgets it.",
        "snapshot": "Write down what a host looks like.",
        "simulate": "Change a simulated host as somebody else would.",
        "run": "Run components on this machine, to see whether their `run` is right.",
        "graph": "Draw hosts, partitions and components.",
        "report": "Show performance against reservation, as a page with lines to drag.",
        "export": "Write what was measured as CSV or XLSX.",
        "explain": "Explain a finding, or how a component comes to what it gets.",
        "schema": "Print a JSON Schema.",
        "completion": "Print a completion script for a shell.",
    }
)
"""In the order in which they are met. `cli/commands/<name>_command.py` holds each (`import` is a keyword)."""


def module_of(command: str) -> str:
    """The module that holds a command, as `command`."""
    return f"rarms_iac.cli.commands.{command}_command"
