"""Everything that a script must pass before it is shown or run."""

from collections.abc import Iterator
from functools import cache

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place, in_order
from rarms_iac.powershell.inspection.allowed import ScriptKind
from rarms_iac.powershell.inspection.commands import check_commands
from rarms_iac.powershell.inspection.language import check_constructs, check_names
from rarms_iac.powershell.inspection.layout import check_end, check_layout, check_whole, split_script, without_fixed
from rarms_iac.powershell.inspection.script import Function, Script, functions_of
from rarms_iac.powershell.inspection.steps import check_steps
from rarms_iac.powershell.inspection.style import check_style
from rarms_iac.powershell.templates import part_text, read, runtime
from rarms_iac.powershell.tree import NotParsed, parse, sound, walk

BYTES = Finding.error("RARMS200", "A script is not pure ASCII with CRLF")
PARSE = Finding.error("RARMS201", "A script cannot be read as PowerShell")

LARGEST = 16 * 1024 * 1024
"""Bytes of a script that is looked at; a plan of a thousand partitions makes a tenth of it."""


def inspect(
    script: bytes, kind: ScriptKind, name: str = "script.ps1", *, trusting: bool = True
) -> tuple[Diagnostic, ...]:
    """Find what is wrong with a script of this kind.

    Args:
        script: its bytes.
        kind: what it may do.
        name: its file name, for the findings.
        trusting: whether parts that are to the byte what rarms ships are not looked at again.

    Returns:
        The findings in the order of the script's lines; none where it may be shown and run.
    """
    problems = tuple(_check_bytes(script, name))
    if problems:
        return problems
    whole = script.decode("ascii")
    changes = kind not in (ScriptKind.OBSERVE, ScriptKind.BOOTSTRAP)
    text = without_fixed(whole) if changes and trusting else whole
    try:
        root = sound(text)
    except NotParsed as error:
        place = Place(file=name, line=error.line, column=1)
        return (PARSE.at(place, error.message, "render the script again, or mend this line"),)
    parsed = Script(
        name=name,
        text=text,
        root=root,
        kind=kind,
        functions=functions_of(root),
        given=_carried_functions(whole) if text is not whole else {},
        nodes=tuple(walk(root)),
    )
    return in_order(list(_check(parsed, whole)))


def _carried_functions(whole: str) -> dict[str, Function]:
    """The functions of what is fixed in a script."""
    return {
        name: function
        for piece in split_script(whole).fixed
        for name, function in _shipped_functions(piece.name).items()
    }


@cache
def _shipped_functions(name: str) -> dict[str, Function]:
    """The functions of a shipped part, or of the runtime: parsed once, checked by the tests of what rarms ships."""
    return functions_of(parse(part_text(name) if name else runtime()))


def _check_bytes(script: bytes, name: str) -> Iterator[Diagnostic]:
    if len(script) > LARGEST:
        yield BYTES.at(Place(file=name, line=1, column=1), f"it has {len(script)} bytes", "split the plan")
        return
    *lines, rest = script.split(b"\n")
    if rest or not lines:
        yield BYTES.at(Place(file=name, line=len(lines) + 1, column=1), "the last line does not end", "write its CRLF")
    for number, line in enumerate(lines, start=1):
        place = Place(file=name, line=number, column=1)
        if bad := [byte for byte in line.removesuffix(b"\r") if not 0x20 <= byte <= 0x7E]:
            advice = "5.1 reads a script in the code page of its Windows: only ASCII is the same everywhere"
            yield BYTES.at(place, f"a byte 0x{bad[0]:02x} is not printable ASCII", advice)
        elif not line.endswith(b"\r"):
            yield BYTES.at(place, "the line does not end with CR LF", "write it with CRLF, to its last line")


def _check(script: Script, whole: str) -> Iterator[Diagnostic]:
    yield from check_constructs(script)
    yield from check_commands(script)
    yield from check_names(script)
    yield from check_style(script)
    if script.kind is ScriptKind.OBSERVE:
        yield from check_end(script.name, script.text)
    elif script.kind is ScriptKind.BOOTSTRAP:
        yield from check_whole(script.name, script.text, read("bootstrap.ps1"))
    else:
        parts = split_script(whole)
        yield from check_layout(script.name, parts, script.entry)
        yield from check_steps(script, [(piece.first, piece.last) for piece in parts.fixed])
