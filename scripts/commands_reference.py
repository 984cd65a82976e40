"""The text of `docs/commands.md`: what every `--help` says, in one page.

`python -m scripts.commands_reference > docs/commands.md` writes it.
"""

import sys

import click

from rarms_iac.cli.group import all_commands, root_group

WIDTH = 80

HEAD = """# Commands

<!-- Generated: python -m scripts.commands_reference > docs/commands.md. A test compares. -->

What each `--help` says. Data goes to standard output, talk to standard error.

| exit code | what it says |
|---|---|
| 0 | what was asked is done, nothing was to do, or warnings only |
| 1 | the tool or a host failed, or a host cannot be reached |
| 2 | `plan --detailed-exitcode`: changes; `validate`, `doctor`: errors; `fmt --check`, `drift`: not as it should be |
| 3 | refused: the host moved, is busy or held; the plan is stale, edited or used; another run is unfinished |
| 4 | no result: errors in the manifest (any command but `validate`), or the reservations do not fit |
| 5 | `drift`: only not applied yet |
| 64 | wrong usage, or a name that neither the manifest nor a host has |
| 130, 143 | interrupted by Ctrl-C or SIGTERM: can be resumed |

`apply` without PLAN, `destroy`, `stop`, `start`, `import` and `release` finish an unfinished run first, and then plan.
`undo` finishes an unfinished undo. So a command that was killed can be run again, and its exit code is 0 when the work
is done, whichever of the two runs did it.

Without a terminal rarms does not ask. The exit code is then 64 before anything is done, and 3 if `measure` or `tune`
finds partitions that run. Each question has its own option to consent:

| question | commands | consent |
|---|---|---|
| whether it is done | what shows a plan: `apply`, `undo`, `stop`, `destroy` and others | `--auto-approve` |
| whether partitions are stopped while it is measured | `measure`, `tune` | `--stop-partitions` |
| whether all idle time of the hosts is used | `prove`, `apply --prove` | `--load-host` |
| which level is good enough, and whether it is written | `measure --interactive` | `select COMPONENT --at LEVEL` |
| whether more settings are measured for a level | `measure --interactive` | `measure --from A --to B` |
| what is combined, and whether that is written | `measure --interactive`, `tune --interactive` | `tune` |

`tune` without `--interactive` asks nothing: to combine, and to write the partitions, is what it is for; `--dry-run`
writes nothing.
"""


def reference() -> str:
    """Return the whole page, ending with a line end."""
    group = root_group()
    top = click.Context(group, info_name="rarms", terminal_width=WIDTH, **group.context_settings)
    parts = [HEAD, _section("rarms", group.get_help(top))]
    for name, command in all_commands().items():
        context = click.Context(command, info_name=name, parent=top, terminal_width=WIDTH)
        parts.append(_section(f"rarms {name}", command.get_help(context)))
    return "\n".join(parts)


def _section(title: str, text: str) -> str:
    return f"## {title}\n\n```text\n{text.rstrip()}\n```\n"


if __name__ == "__main__":
    sys.stdout.buffer.write(reference().encode())
