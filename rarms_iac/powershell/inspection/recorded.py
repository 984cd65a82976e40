"""What a journal's script does beside its plan: it has parameters and settings, its module, and one call of that.

Another version may have made it. Its module is held to the digests that the script names, and to nothing of this
version; the lines that find or hold the module are that version's, too (decision 0043). All else at the top of the
script has one of the forms here, which every version writes.
"""

import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.model.wording import quoted
from rarms_iac.powershell.inspection.parts import (
    HEAD,
    NEW_MODULE,
    RUNTIME,
    FixedPiece,
    comment_problems,
    head_problems,
    split_script,
)
from rarms_iac.powershell.statements import block_in, top_statements
from rarms_iac.powershell.templates import MODULE_END, PLAN, ScriptForm, as_script, module_digest
from rarms_iac.powershell.tree import line_number, text_of

if TYPE_CHECKING:
    from tree_sitter import Node

_PARAMETER = r"\[(?:switch|int|string)\] \$[A-Za-z]+(?: = (?:[0-9]+|'[A-Za-z0-9]*'))?"
_PARAMETERS = re.compile(
    r"\[CmdletBinding\(SupportsShouldProcess, PositionalBinding = \$false, ConfirmImpact = '(?:Medium|High)'\)\]\s+"
    rf"param\({_PARAMETER}(?:, {_PARAMETER})*\)"
)

# NOTE: a form that a released version wrote stays here, for the journals that hold it.
_SETTINGS = frozenset(
    {
        "if ([string] $ExecutionContext.SessionState.LanguageMode -cne 'FullLanguage') "
        "{ throw 'App Control: allow this script by its signer' }",
        "if (-not $PSCommandPath -or $MyInvocation.InvocationName -ceq '.') "
        "{ throw 'run this script as a file, not dot-sourced' }",
        "$PSDefaultParameterValues = @{}",
        "$ErrorActionPreference = 'Stop'",
        "$VerbosePreference = 'SilentlyContinue'",
        "Set-StrictMode -Version 3.0",
        "$code = 1",
        "if ($Force -and -not $PSBoundParameters.ContainsKey('Confirm')) { $ConfirmPreference = 'None' }",
        "$run = @{\r\n"
        "    Caller = $PSCmdlet; ScriptPath = $PSCommandPath; ModulePath = $folder; ExitCode = [ref] $code; "
        "Plan = $plan\r\n"
        "    Preview = $WhatIfPreference; Confirmation = $ConfirmPreference; AsJson = $AsJson; Test = $Test\r\n"
        "    LockTimeout = $LockTimeout; Abandon = $Abandon\r\n"
        "}",
        "$invoke = $rarms.ExportedFunctions['Invoke-RarmsPlan']",
        "& $invoke -Run $run",
    }
)
_LAST = "exit $code"
_DIGEST = re.compile(r"^    '([A-Za-z.1]+)' = '([0-9A-F]{64})'$", re.MULTILINE)
_OWN_DIGEST = re.compile(r", SHA-256 ([0-9A-F]{64})$")
_OWN_END = f"\nExport-ModuleMember -Function 'Invoke-RarmsPlan'\n}}\n{MODULE_END}"


def check_around_plan(name: str, script: str, root: "Node") -> Iterator[Diagnostic]:
    """Find what a script out of a journal holds beside plan and module that no version of rarms writes there.

    Args:
        name: the script's, for the findings.
        script: its text.
        root: of its tree; its module's lines may be left out.

    Yields:
        What PowerShell would heed in a comment, or run before the plan is called or after.
    """
    parts = split_script(script)
    for problem in (*head_problems(parts.head), *comment_problems(parts.plan + parts.end)):
        yield HEAD.at(
            Place(file=name, line=1, column=1),
            problem,
            "render the script again",
            values={"script": name, "reason": problem},
        )
    statements = [
        node
        for node in top_statements(root)
        if node.type not in {"comment", "empty_statement"} and not (parts.fixed and _is_within(node, parts.fixed))
    ]
    for at, node in enumerate(statements, start=1):
        text = text_of(node)
        if text != _LAST if at == len(statements) else not (_is_plan(node) or _is_setting(node)):
            yield HEAD.at(
                Place(file=name, line=line_number(node), column=1),
                "beside its plan stands {_quoted}",
                "render the script again",
                script=name,
                text=text[:60],
                _quoted=quoted(text, 60),
            )


def check_module(name: str, script: str, module: Mapping[str, str]) -> Iterator[Diagnostic]:
    """Find whether a script out of a journal has another module than it names; this version's is not asked.

    Args:
        name: the script's, for the findings.
        script: its text.
        module: the module's files by name, as the journal holds them; a signature block in them does not count.

    Yields:
        That a file of it is missing, superfluous or another than the script's digests say.
    """
    fixed = split_script(script).fixed
    if fixed is None:
        problem = "it has no module"
    elif _digests_of(module, fixed) == _digests_named(fixed):
        return
    elif fixed.form is ScriptForm.SINGLE:
        problem = "the module in it is another than it names"
    else:
        problem = "the module that was kept with it is another than it names" if module else "its module was not kept"
    yield RUNTIME.at(Place(file=name, line=1, column=1), problem, "render the script again", values={"script": name})


def _digests_named(fixed: FixedPiece) -> dict[str, str]:
    """The SHA-256 that a script names for each file of its module, and under no name for the module that it holds."""
    if fixed.form is ScriptForm.MODULE:
        return dict(_DIGEST.findall(fixed.text))
    named = _OWN_DIGEST.search(fixed.text.partition("\n")[0])
    return {"": named[1]} if named else {}


def _digests_of(module: Mapping[str, str], fixed: FixedPiece) -> dict[str, str]:
    texts = dict(module)
    if fixed.form is ScriptForm.SINGLE:
        texts[""] = as_script(fixed.text.partition(f"{NEW_MODULE}\n")[2].removesuffix(_OWN_END)).decode("ascii")
    return {name: module_digest(text) if text.isascii() else "" for name, text in texts.items()}


def _is_within(node: "Node", fixed: FixedPiece) -> bool:
    return fixed.first <= line_number(node) and node.end_point.row < fixed.last


def _is_plan(node: "Node") -> bool:
    """Whether a statement is the script's plan, whose steps are looked at elsewhere, and no more."""
    before, _, after = text_of(node).partition(text_of(block_in(node)))
    return (before.rstrip(), after.strip()) == (f"{PLAN} = {{", "}")


def _is_setting(node: "Node") -> bool:
    text = text_of(node)
    return _PARAMETERS.fullmatch(text) is not None if node.type == "param_block" else text in _SETTINGS
