"""Whether a script may be shown or run: the checks that it must pass, one after the other."""

from collections.abc import Mapping
from itertools import chain
from types import MappingProxyType

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place
from rarms_iac.powershell.inspection.encoding import check_bytes
from rarms_iac.powershell.inspection.parts import check_parts, split_script, without_fixed
from rarms_iac.powershell.inspection.recorded import check_around_plan, check_module
from rarms_iac.powershell.inspection.steps import check_recorded_plan, check_steps
from rarms_iac.powershell.templates import ENTRY
from rarms_iac.powershell.tree import NotParsed, parse_strictly
from rarms_iac.storage.script_signature import without_key_signature

PARSE = Finding.error("RARMS201", "A script cannot be read as PowerShell")


def inspect(script: bytes, name: str = "script.ps1", *, entry: str = ENTRY) -> tuple[Diagnostic, ...]:
    """Find what is wrong with a script that this version of rarms made, and that may have been edited.

    Args:
        script: its bytes.
        name: its file name, for the findings.
        entry: the function that its end calls.

    Returns:
        The findings of the first check that fails: of bytes, of parts, of syntax, of steps. None where the script may
            be shown and run.
    """
    if problems := tuple(check_bytes(script, name)):
        return problems
    text = without_key_signature(script.decode("ascii"))
    parts = split_script(text)
    if problems := tuple(check_parts(name, parts, entry)):
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
    if problems := tuple(check_bytes(script, name)):
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
