"""The text of `docs/commands.md`: the `--help` text of every command, in one page.

`python -m scripts.commands_reference > docs/commands.md` writes it.
"""

import sys

import click

from rarms_iac.cli.group import all_commands, root_group

WIDTH = 80

HEAD = """# Commands

<!-- Generated: python -m scripts.commands_reference > docs/commands.md. A test compares. -->

This page shows the `--help` text of each command. Results go to standard output. Progress and findings go to standard
error.

| exit code | meaning |
|---|---|
| 0 | done, nothing to do, or warnings only |
| 1 | rarms or a host failed, or rarms cannot reach a host |
| 2 | `plan --detailed-exitcode`: changes; `validate`, `doctor`: errors; `fmt --check`: not formatted; `drift`: drift |
| 3 | refused: the host has changed, or another run holds it or is unfinished; or the plan is stale, edited or used |
| 4 | errors in the manifest (except `validate`), reservations do not fit, or a threshold is not shown to be met |
| 5 | `drift`: only changes that are not applied yet |
| 64 | wrong usage, or a name that neither the manifest nor a host has |
| 130, 143 | interrupted by Ctrl-C or SIGTERM; run the same command again to continue |

`apply` without PLAN, `destroy`, `stop`, `start`, `import` and `release` first finish an unfinished run, and then plan.
`undo` finishes an unfinished undo. So you can run an interrupted command again. The exit code is 0 when all work is
done.

Without a terminal, rarms does not ask. Without the option for consent, the exit code is 64, and nothing is changed. If
`measure` or `tune` finds running partitions, the exit code is 3. These options replace the questions:

| question | commands | consent |
|---|---|---|
| apply these changes? | all that show a plan: `apply`, `undo`, `stop`, `destroy` and others | `--auto-approve` |
| stop the partitions during the measurement? | `measure`, `tune` | `--stop-partitions` |
| use all idle time of the hosts? | `prove`, `apply --prove` | `--load-host` |
| which level is acceptable, and write it? | `measure --interactive` | `select COMPONENT --at LEVEL` |
| measure more settings for a level? | `measure --interactive` | `measure --from A --to B` |
| which components to combine, and write it? | `measure --interactive`, `tune --interactive` | `tune` |

`tune` without `--interactive` does not ask. It combines components and writes the partitions. With `--dry-run` it
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
