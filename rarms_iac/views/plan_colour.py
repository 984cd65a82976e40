"""Colour for a plan's text: a pass of its own that adds escape sequences and changes nothing else."""

import re

from rarms_iac.views.diagnostics.colour import coloured

RESET = "\x1b[0m"
BOLD = "\x1b[1m"
COLOURS = {
    "+": "\x1b[32m",
    "~": "\x1b[33m",
    "-/+": "\x1b[31m",
    "-": "\x1b[31m",
    ">": "\x1b[36m",
    "<": "\x1b[36m",
}

_CHANGE = re.compile(r"^  (?P<symbol>\+|~|-/\+|-|>|<) (?P<address>(?:partition|task)/\S+)(?P<rest>.*)$")
_STRONG = re.compile(r"^(?:Host |Plan: |No changes)")


def coloured_plan(text: str) -> str:
    """The text of `plan_text` with colour; findings in it as `coloured` does."""
    return "\n".join(map(_line, coloured(text).split("\n")))


def _line(line: str) -> str:
    change = _CHANGE.match(line)
    if change:
        symbol = change["symbol"]
        return f"  {COLOURS[symbol]}{symbol}{RESET} {BOLD}{change['address']}{RESET}{change['rest']}"
    if _STRONG.match(line):
        return f"{BOLD}{line}{RESET}"
    return line.replace("(forces ", f"{COLOURS['-']}(forces ") + RESET if "(forces " in line else line
