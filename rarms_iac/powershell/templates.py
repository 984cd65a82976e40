"""The templates of scripts: loops and finished literals, nothing else."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from rarms_iac.powershell.tokens import TokenKind, tokens
from rarms_iac.storage.shipped import shipped, shipped_text

if TYPE_CHECKING:
    from jinja2 import Environment


FOLDER = "templates/powershell"


@cache
def _environment() -> "Environment":
    """Made when a script is; a name that a template does not get is an error."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(  # noqa: S701 - PowerShell is no HTML: what enters is a literal or a remark already
        loader=FileSystemLoader(str(shipped(FOLDER)), encoding="utf-8"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        newline_sequence="\n",
    )


def fill(template: str, values: Mapping[str, object]) -> bytes:
    """The template's text as the bytes of a script: ASCII, CRLF.

    Raises:
        UnicodeEncodeError: something entered that was no literal.
    """
    return as_script(_environment().get_template(template).render(**values))


def as_script(text: str) -> bytes:
    """Text with LF as the bytes of a script."""
    return text.replace("\n", "\r\n").encode("ascii")


def read(name: str) -> str:
    """A template's text as it lies in its file, with LF."""
    return shipped_text(f"{FOLDER}/{name}")


PLAN, FACTS, TARGET, STEP_CALL = "Add-Plan", "$script:Plan", "Use-Target", "Add-Step"
"""The function that holds a plan, the variable that gets the run's facts, and what the plan calls."""

ENTRY, MEASURING_ENTRY = "Invoke-Run", "Invoke-Measuring"
"""What calls the plan, at the end of a script: a plan's steps, or a measurement."""

VM = "$script:Vm"
"""In a call: the machine that the step has read."""

WIDTH = 140
"""Characters of a line, where a call can be broken at all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StepText:
    """A step as its parts stand in a script: literals, tables of readings by name, calls."""

    action: str
    before: Mapping[str, str]
    after: Mapping[str, str]
    calls: Sequence[str]
    options: Sequence[tuple[str, str]] = ()  # further parameters of `Add-Step` with their values


def step_lines(step: StepText) -> list[str]:
    """The call that adds a step, on as few lines as are wide enough; one that writes a mark is always one line."""
    start = " ".join([f"    {STEP_CALL} -Action", step.action, *(f"-{name} {text}" for name, text in step.options)])
    before, after = _table(step.before), _table(step.after)
    if step.calls == ("Write-Mark",):
        return [f"{start} -Before {before} -After {after} -Set {{ Write-Mark }}"]
    if len(opening := f"{start} -Before {before} -After {after}") + len(" -Set {") <= WIDTH:
        return _with_set(opening, step.calls)
    if len(opening := f"{start} -Before {before} -After @{{") <= WIDTH:
        return [opening, *_wrapped(step.after), *_with_set("    }", step.calls)]
    wrapped = [*_wrapped(step.before), "    } -After @{", *_wrapped(step.after)]
    return [f"{start} -Before @{{", *wrapped, *_with_set("    }", step.calls)]


def _with_set(opening: str, calls: Sequence[str]) -> list[str]:
    """The end of a step: one call stands on the line that opens its block, where there is room."""
    if len(calls) == 1 and len(short := f"{opening} -Set {{ {calls[0]} }}") <= WIDTH:
        return [short]
    return [f"{opening} -Set {{", *(f"        {call}" for call in calls), "    }"]


def target_line(address: str, reading: str) -> str:
    """The call that says what the steps behind it are about: its address, and the call that reads it."""
    return f"    {TARGET} -Address {address} -Read {{ {reading} }}"


def _table(readings: Mapping[str, str]) -> str:
    return f"@{{ {'; '.join(_entries(readings))} }}"


def _wrapped(readings: Mapping[str, str]) -> list[str]:
    """As many entries on each line as it takes."""
    lines: list[str] = []
    for entry in _entries(readings):
        if lines and len(lines[-1]) + len(entry) + 2 <= WIDTH:
            lines[-1] += f"; {entry}"
        else:
            lines.append(f"        {entry}")
    return lines


def _entries(readings: Mapping[str, str]) -> list[str]:
    return [f"{name} = {value}" for name, value in readings.items()]


SIGNATURE = r"(?<=\r\n)\s*# SIG # Begin signature block\r\n(?:# [^\r\n]*\r\n)*# SIG # End signature block\s*$"
"""What `Set-AuthenticodeSignature` adds to a script: remarks at its end, by the pattern of the journal part."""


def without_signature(script: str) -> str:
    """The text of a script, with CRLF, that may have been signed, as it was before."""
    return re.sub(SIGNATURE, "", script)


RUNTIME_BEGIN = "# --- runtime:"
RUNTIME_END = "# --- end of the runtime"

PARTS = (
    "lock",
    "journal",
    "preview",
    "host",
    "guest",
    "machines",
    "devices",
    "making",
    "capacity",
    "stop",
    "disks",
    "tasks",
    "unseen",
    "test_partitions",
    "runner",
    "measuring",
)
"""Their names, in the order in which a script carries them."""

_FUNCTION = re.compile(r"^function ([A-Za-z-]+) \{$", re.MULTILINE)


def part_begin(name: str) -> str:
    """How the first line of a part begins."""
    return f"# --- part {name}:"


def part_end(name: str) -> str:
    """How its last line begins."""
    return f"# --- end of the part {name} "


@cache
def runtime() -> str:
    """The runtime, which is fixed in every script, with LF, from its first to its last line."""
    return read("runtime.ps1").rstrip("\n")


@cache
def part_text(name: str) -> str:
    """A part, with LF, from its first to its last line."""
    return read(f"parts/{name}.ps1").rstrip("\n")


def parts_for(steps: str) -> tuple[str, ...]:
    """The names of the parts that the runtime and these steps need, in their order.

    Raises:
        NotTokens: the text ends inside a string.
    """
    needed: set[str] = set()
    waiting = {*_needs(""), *_called(steps)}
    while waiting:
        name = waiting.pop()
        if name not in needed:
            needed.add(name)
            waiting |= _needs(name)
    return tuple(name for name in PARTS if name in needed)


@cache
def _needs(name: str) -> frozenset[str]:
    """The parts that a part calls; an empty name is the runtime."""
    return frozenset(_called(part_text(name) if name else runtime()))


LOSING = frozenset(
    {"Stop-Partition", "Remove-VM", "Remove-DiskFile", "Remove-TaskClass", "Restore-TaskClass"},
)
"""Calls that stop, remove or delete what was there."""


def impact_of(steps: str) -> str:
    """What PowerShell asks a user before a script does these steps, if its `$ConfirmPreference` is not above that.

    Raises:
        NotTokens: the text ends inside a string.
    """
    words = {token.text.rpartition("\\")[2] for token in tokens(steps) if token.kind is TokenKind.WORD}
    return "Medium" if LOSING.isdisjoint(words) else "High"


def _called(text: str) -> set[str]:
    """The parts whose functions a text calls; what stands in its strings and remarks is no call."""
    part_of = _part_of_function()
    return {part_of[token.text] for token in tokens(text) if token.kind is TokenKind.WORD and token.text in part_of}


@cache
def _part_of_function() -> Mapping[str, str]:
    """By function: the part that defines it."""
    return {function: name for name in PARTS for function in _FUNCTION.findall(part_text(name))}
