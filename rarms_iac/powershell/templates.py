"""The templates of scripts: loops and finished literals, nothing else."""

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from functools import cache
from typing import TYPE_CHECKING

from rarms_iac.model.version import __version__
from rarms_iac.storage.shipped import shipped, shipped_text

if TYPE_CHECKING:
    from jinja2 import Environment


FOLDER = "templates/powershell"


@cache
def _environment() -> "Environment":
    """Make the environment of a script; a name that a template does not get is an error."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(  # noqa: S701 - PowerShell is not HTML: what enters is a literal or a remark already
        loader=FileSystemLoader(str(shipped(FOLDER)), encoding="utf-8"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        newline_sequence="\n",
    )


def fill(template: str, values: Mapping[str, object]) -> bytes:
    """Return the filled template as the bytes of a script: ASCII, CRLF.

    Raises:
        UnicodeEncodeError: something entered that was no literal.
    """
    return as_script(_environment().get_template(template).render(**values))


def as_script(text: str) -> bytes:
    """Encode text with LF as the bytes of a script."""
    return text.replace("\n", "\r\n").encode("ascii")


def template_text(name: str) -> str:
    """Return a template's text, with LF."""
    return shipped_text(f"{FOLDER}/{name}")


TARGET, STEP_CALL = "Use-Target", "Add-Step"
"""What a plan calls."""

GUARD = "Test-Open"
"""What a call in a step of several asks first."""

ENTRY, MEASURING_ENTRY = "Invoke-RarmsPlan", "Invoke-RarmsMeasuring"
"""What the end of a script calls: it does a plan's steps, or measures."""

ROWS, ROW, LATER_ROW = "$rows", "$row", "$script:Row"
"""The table of what differs among machines alike, a row of it, and the same in blocks, which run later."""

EACH_ROW = f"foreach ({ROW} in {ROWS}) {{"

VM = "$script:Vm"
"""In a call: the machine that the step has read."""

WIDTH = 140
"""Characters of a line, where a call can be broken at all."""


_FACTS = (
    ("Run", "Purpose", "Plan", "Application", "Robot", "Serial", "Guest"),
    ("Undo", "UndoDigest"),
    ("Computer", "Identity"),
)
_HOST_FACTS = (
    # What the host has to give: per cent of its processors, bytes of its memory.
    ("LogicalProcessors", "Cores", "ThreadsPerCore", "Percent", "Memory", "AcceptScheduler"),
)
HOST_FACT_NAMES = frozenset(name for row in _HOST_FACTS for name in row)
"""Facts that only the script of a host has, but for its undo, which promises nothing."""


def fact_lines(run: Mapping[str, str]) -> list[str]:
    """Return the facts of a run as the entries of a table, some to a line.

    Args:
        run: literals by name; of `HOST_FACT_NAMES` only those that are there.
    """
    rows = ([f"{name} = {run[name]}" for name in row if name in run] for row in (*_FACTS, *_HOST_FACTS))
    return ["; ".join(row) for row in rows if row]


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetText:
    """The target of the steps behind it: a literal, and the call that reads it."""

    address: str
    reading: str
    in_rows: bool = False  # it stands below a table, and hands its row on


@dataclass(frozen=True, slots=True, kw_only=True)
class StepText:
    """A step as its parts stand in a script: literals, tables of readings by name, calls."""

    action: str
    same: Mapping[str, str]  # read before and after alike
    before: Mapping[str, str]
    after: Mapping[str, str]
    calls: Sequence[str]
    options: Sequence[tuple[str, str]] = ()  # further parameters of `Add-Step` with their values


def statement_lines(statement: TargetText | StepText) -> list[str]:
    """Return the lines of a statement of a plan."""
    if isinstance(statement, StepText):
        return step_lines(statement)
    row = f" -Row {ROW}" if statement.in_rows else ""
    return [f"    {TARGET} -Address {statement.address}{row} -Read {{ {statement.reading} }}"]


def table_lines(rows: Sequence[Mapping[str, str]], remarks: Sequence[str]) -> list[str]:
    """Return a table of literals, and the opening of the block that is done for each row; the caller closes it.

    Args:
        rows: literals by name of their column.
        remarks: what stands behind each row; empty: nothing.
    """
    lines = [f"    {ROWS} = @("]
    for row, remark in zip(rows, remarks, strict=True):
        entries = _wrapped(row, 12)
        entries[0] = f"        @{{ {entries[0].strip()}"
        entries[-1] += f" }} # {remark}" if remark else " }"
        lines += entries
    return [*lines, "    )", f"    {EACH_ROW}"]


def step_lines(step: StepText) -> list[str]:
    """Return the call that adds a step, on as few lines as are wide enough; a step that writes a mark has one line."""
    options = [*step.options, *([("Same", _table(step.same))] if step.same else [])]
    start = " ".join([f"    {STEP_CALL} -Action", step.action, *(f"-{name} {text}" for name, text in options)])
    before, after = _table(step.before), _table(step.after)
    if step.calls == ("Write-Mark",):
        return [f"{start} -Before {before} -After {after} -Set {{ Write-Mark }}"]
    if len(opening := f"{start} -Before {before} -After {after}") + len(" -Set {") <= WIDTH:
        return _with_set(opening, step.calls)
    if len(opening := f"{start} -Before {before} -After @{{") <= WIDTH:
        return [opening, *_wrapped(step.after), *_with_set("    }", step.calls)]
    wrapped = [*_wrapped(step.before), "    } -After @{", *_wrapped(step.after)]
    return [f"{start} -Before @{{", *wrapped, *_with_set("    }", step.calls)]


def guarded(call: str, names: Iterable[str]) -> str:
    """Return a call that is made only if one of these names, as literals, is not as the step wants it."""
    return f"if ({GUARD} -Name {', '.join(names)}) {{ {call} }}"


def _with_set(opening: str, calls: Sequence[str]) -> list[str]:
    """Return the end of a step: a single call stands on the line that opens its block, if it fits."""
    if len(calls) == 1 and len(short := f"{opening} -Set {{ {calls[0]} }}") <= WIDTH:
        return [short]
    return [f"{opening} -Set {{", *(f"        {call}" for call in calls), "    }"]


def _table(readings: Mapping[str, str]) -> str:
    return f"@{{ {'; '.join(_entries(readings))} }}" if readings else "@{}"


def _wrapped(readings: Mapping[str, str], indentation: int = 8) -> list[str]:
    """Return lines with as many entries as fit."""
    lines: list[str] = []
    for entry in _entries(readings):
        if lines and len(lines[-1]) + len(entry) + 2 <= WIDTH:
            lines[-1] += f"; {entry}"
        else:
            lines.append(" " * indentation + entry)
    return lines


def _entries(readings: Mapping[str, str]) -> list[str]:
    return [f"{name} = {value}" for name, value in readings.items()]


SIGNATURE = r"(?<=\r\n)\s*# SIG # Begin signature block\r\n(?:# [^\r\n]*\r\n)*# SIG # End signature block\s*$"
"""What `Set-AuthenticodeSignature` adds to a script: remarks at its end, by the module's own pattern."""


def without_signature(script: str) -> str:
    """Return the text of a script, with CRLF, without its signature block, if it has one."""
    return re.sub(SIGNATURE, "", script)


NEW_MODULE = "$rarms = New-Module -Name Rarms -ScriptBlock {"
"""The line behind which a script that is one file holds its module."""

MODULE_FOLDER = "Rarms"
MODULE_FILES = (f"{MODULE_FOLDER}.psd1", f"{MODULE_FOLDER}.psm1")
"""The files of the module, in a folder next to a script."""

MEASURING_PARTS = ("test_partitions", "runner", "measuring")
"""What a script that measures has behind the module's own functions."""


class ScriptForm(Enum):
    """The place of the functions that a script calls."""

    MODULE = auto()  # in the folder Rarms next to it
    SINGLE = auto()  # in the script itself


@cache
def module_file(name: str) -> bytes:
    """Return the bytes of a file of the module, one of `MODULE_FILES`, with CRLF."""
    return as_script(template_text(f"{MODULE_FOLDER}/{name}"))


def shipped_module() -> dict[str, str]:
    """Return the files of this version's module by name, with CRLF."""
    return {name: module_file(name).decode("ascii") for name in MODULE_FILES}


def module_digest(text: str) -> str:
    """Return the SHA-256 of a file of the module in upper case, as scripts hold it, without a signature block."""
    return hashlib.sha256(without_signature(text).encode("latin-1")).hexdigest().upper()


def module_digests() -> dict[str, str]:
    """Return the digests of this version's module by file."""
    return {name: module_digest(text) for name, text in shipped_module().items()}


@cache
def module_text(form: ScriptForm, entry: str = ENTRY) -> str:
    """Return the text that loads the module, with LF: the digests of its files and their import, or the module itself.

    Args:
        form: of the script; one that measures has the single form alone.
        entry: what the script's end calls.
    """
    if form is ScriptForm.MODULE:
        text = fill("module.ps1.j2", {"version": __version__, "digests": module_digests().items()}).decode("ascii")
    else:
        parts = MEASURING_PARTS if entry == MEASURING_ENTRY else ()
        own = "\n".join(map(str.rstrip, [template_text(f"{MODULE_FOLDER}/{MODULE_FILES[1]}"), *map(part_text, parts)]))
        digest = module_digest(as_script(own).decode("ascii"))
        values = {"version": __version__, "digest": digest, "text": own, "entry": entry}
        text = fill("single.ps1.j2", values).decode("ascii")
    return text.replace("\r\n", "\n").rstrip("\n")


def module_section(name: str) -> str:
    """Return the functions of a section of the module, with LF: those that another script has, too."""
    module = template_text(f"{MODULE_FOLDER}/{MODULE_FILES[1]}")
    return module.partition(f"\n# === {name}: ")[2].partition("\n")[2].partition("\n# === ")[0].rstrip()


def receiver_text() -> str:
    """Return the functions that take scripts from standard input and run the first, with LF."""
    return "\n\n".join(map(module_section, ("shared", "receiver")))


def part_text(name: str) -> str:
    """Return one of `MEASURING_PARTS`, with LF."""
    return template_text(f"parts/{name}.ps1")


LOSING = frozenset(
    {"Stop-Partition", "Remove-VM", "Remove-Item", "Remove-TaskClass", "Restore-TaskClass"},
)
"""Calls that stop, remove or delete what was there."""


def impact_of(calls: Iterable[str]) -> str:
    """Return PowerShell's question before a script does these calls, if `$ConfirmPreference` is not above it."""
    names = {call.partition(" ")[0].rpartition("\\")[2] for call in calls}
    return "Medium" if LOSING.isdisjoint(names) else "High"
