"""What every script must pass before it is shown or run: bytes, what is fixed, and the tree of its plan."""

from collections.abc import Iterator, Mapping
from itertools import chain
from types import MappingProxyType

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place
from rarms_iac.powershell.inspection.layout import check_layout, split_script, without_fixed
from rarms_iac.powershell.inspection.recorded import check_around_plan, check_module
from rarms_iac.powershell.inspection.steps import check_recorded_plan, check_steps
from rarms_iac.powershell.templates import ENTRY
from rarms_iac.powershell.tree import NotParsed, parse_strictly
from rarms_iac.storage.script_signature import without_key_signature

BYTES = Finding.error("RARMS200", "A script is not pure ASCII with CRLF")
PARSE = Finding.error("RARMS201", "A script cannot be read as PowerShell")

LARGEST = 16 * 1024 * 1024
"""Bytes of a script that is looked at; a plan of a thousand partitions makes a tenth of it."""


def inspect(script: bytes, name: str = "script.ps1", *, entry: str = ENTRY) -> tuple[Diagnostic, ...]:
    """Find what is wrong with a script that this version of rarms made, and that may have been edited.

    Args:
        script: its bytes.
        name: its file name, for the findings.
        entry: the function that its end calls.

    Returns:
        The findings in the order of the script's lines; none where it may be shown and run. Steps are looked at where
            all around them is as rarms writes it.
    """
    if problems := tuple(_check_bytes(script, name)):
        return problems
    text = without_key_signature(script.decode("ascii"))
    parts = split_script(text)
    if problems := tuple(check_layout(name, parts, entry)):
        return problems
    try:
        root = parse_strictly(without_fixed(text, entry))
    except NotParsed as error:
        return (_not_parsed(name, error),)
    return tuple(check_steps(name, root, entry))


def inspect_recorded(
    script: bytes, name: str, module: Mapping[str, str] = MappingProxyType({})
) -> tuple[Diagnostic, ...]:
    """Find what is wrong with a script out of a host's journal, which any version of rarms may have made.

    What is fixed in it is that version's, so it is not compared: an upgrade must not strand a run. Outside of functions
    only what every version writes may stand; what its functions do, but for the plan, is not looked at.

    Args:
        script: its bytes, without a signature block.
        name: its file name, for the findings.
        module: the files of its module by name, as the journal holds them; none where the script holds it.

    Returns:
        The first finding; none where its plan has the form of a plan, and nothing else runs before it is called.
    """
    if problems := tuple(_check_bytes(script, name)):
        return problems[:1]
    text = without_key_signature(script.decode("ascii"))
    try:
        root = parse_strictly(without_fixed(text))
    except NotParsed as error:
        return (_not_parsed(name, error),)
    checks = (check_recorded_plan(name, root), check_around_plan(name, text, root), check_module(name, text, module))
    return tuple(chain.from_iterable(checks))[:1]


def _not_parsed(name: str, error: NotParsed) -> Diagnostic:
    place = Place(file=name, line=error.line, column=1)
    return PARSE.at(
        place,
        error.message,
        "render the script again, or mend this line",
        values={"script": name, "reason": error.message},
    )


def _check_bytes(script: bytes, name: str) -> Iterator[Diagnostic]:
    if len(script) > LARGEST:
        yield BYTES.at(
            Place(file=name, line=1, column=1),
            f"it has {len(script)} bytes",
            "split the plan",
            values={"script": name, "bytes": len(script), "most_bytes": LARGEST},
        )
        return
    *lines, rest = script.split(b"\n")
    if rest or not lines:
        yield BYTES.at(
            Place(file=name, line=len(lines) + 1, column=1),
            "the last line does not end",
            "write its CRLF",
            values={"script": name},
        )
    for number, line in enumerate(lines, start=1):
        place = Place(file=name, line=number, column=1)
        if bad := [byte for byte in line.removesuffix(b"\r") if not 0x20 <= byte <= 0x7E]:
            advice = "5.1 reads a script in the code page of its Windows: only ASCII is the same everywhere"
            yield BYTES.at(
                place, f"a byte 0x{bad[0]:02x} is not printable ASCII", advice, values={"script": name, "byte": bad[0]}
            )
        elif not line.endswith(b"\r"):
            yield BYTES.at(
                place,
                "the line does not end with CR LF",
                "write it with CRLF, to its last line",
                values={"script": name},
            )
