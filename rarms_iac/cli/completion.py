"""Completion: click's own for bash, zsh and fish, a short script for PowerShell; names come from the manifest."""

import os
from collections.abc import Callable

import click
from click.shell_completion import (
    CompletionItem,
    ShellComplete,
    add_completion_class,
    get_completion_class,
    shell_complete,
)

from rarms_iac.cli.group import root_group

VARIABLE = "_RARMS_COMPLETE"
"""Set by a completion script: what the shell wants to know."""

_PATHS = {"PATH": "file", "FILE": "file", "[FILE]...": "file", "[PLAN]": "file", "FOLDER": "dir"}
"""What the shell itself completes, by the metavar."""

_SECTIONS = {
    **dict.fromkeys(("component", "components", "partition", "partitions", "subject"), "components"),
    "hosts": "hosts",
    "interference": "interference",
}
"""The manifest's section whose keys a field takes; a partition has the name of its most critical component."""

Completer = Callable[[click.Context, click.Parameter, str], list[CompletionItem[str]]]


@add_completion_class
class PowerShellComplete(ShellComplete):
    """PowerShell: the words come one a line, the unfinished one apart; a value and its help go back on a line."""

    name = "powershell"
    source_template = """\
Register-ArgumentCompleter -Native -CommandName %(prog_name)s -ScriptBlock {
    param($wordToComplete, $commandAst, $cursorPosition)
    $words = $commandAst.CommandElements | Where-Object { $_.Extent.EndOffset -lt $cursorPosition }
    $env:COMP_WORDS = ($words | Select-Object -Skip 1) -join "`n"
    $env:COMP_CWORD = $wordToComplete
    $env:%(complete_var)s = 'powershell_complete'
    %(prog_name)s | ForEach-Object {
        $value, $help = $_ -split "`t", 2
        [System.Management.Automation.CompletionResult]::new($value, $value, 'ParameterValue', $help)
    }
    Remove-Item Env:COMP_WORDS, Env:COMP_CWORD, Env:%(complete_var)s -ErrorAction SilentlyContinue
}
"""

    def get_completion_args(self) -> tuple[list[str], str]:
        """Return the finished words, and the one at the cursor."""
        return os.environ.get("COMP_WORDS", "").splitlines(), os.environ.get("COMP_CWORD", "")

    def get_completions(self, args: list[str], incomplete: str) -> list[CompletionItem[str]]:
        """Return words only: without any, PowerShell offers files by itself."""
        return [item for item in super().get_completions(args, incomplete) if item.type == "plain"]

    def format_completion(self, item: CompletionItem[str]) -> str:
        """Return the value and its help, which PowerShell wants not to be empty."""
        return f"{item.value}\t{item.help or item.value}"


def answer_completion(instruction: str) -> int:
    """Tell a completion script what may stand at the cursor; the process' exit code. Raises nothing."""
    try:
        return shell_complete(root_group(), {}, "rarms", VARIABLE, instruction)
    except Exception:  # noqa: BLE001 - a half-typed line gets no words, and no traceback
        return 1


def completion_script(shell: str) -> str:
    """Return the script that asks rarms at each Tab; it ends with a line end."""
    completer = get_completion_class(shell)
    assert completer is not None, "the command takes no other"
    # NOTE: not `BashComplete.source`, which starts a bash to learn its version.
    return ShellComplete.source(completer(root_group(), {}, "rarms", VARIABLE)).lstrip("\n")


def completer_of(field: str, metavar: str | None) -> Completer | None:
    """Return the completion of a request's field; None: click knows, or nothing does."""
    if field == "output":
        return lambda _context, _parameter, text: _starting_with(text, _output_forms())
    if field in _SECTIONS:
        return lambda context, _parameter, text: _starting_with(text, (*_declared(context, field), *_codes(field)))
    if metavar in _PATHS:
        return lambda _context, _parameter, text: [CompletionItem(text, type=_PATHS[metavar])]
    return None


def _starting_with(text: str, words: tuple[str, ...]) -> list[CompletionItem[str]]:
    return [CompletionItem(word) for word in words if word.startswith(text)]


def _output_forms() -> tuple[str, ...]:
    from rarms_iac.views.finding_forms import OutputFormat

    return tuple(OutputFormat)


def _codes(field: str) -> tuple[str, ...]:
    from rarms_iac.storage.shipped import known_codes

    return known_codes() if field == "subject" else ()


def _declared(context: click.Context, field: str) -> tuple[str, ...]:
    """Return the keys of the manifest's section, as far as it can be read."""
    from rarms_iac.app.manifests import declared_names
    from rarms_iac.app.requests import DEFAULT_MANIFEST

    return declared_names(context.params.get("manifest") or DEFAULT_MANIFEST, _SECTIONS[field])
