"""What a journal's script does beside its plan: it gives values to names, finds its module, and calls it.

Another version may have made it, so its module is not compared with today's. What functions do is free (decision 0043),
and what a module beside the script holds is held to the digests in the script. All else at the script's top has one of
the forms here, which every version writes.
"""

import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.model.version import __version__
from rarms_iac.model.wording import quoted
from rarms_iac.powershell.inspection.layout import (
    HEAD,
    NEW_MODULE,
    RUNTIME,
    comment_problems,
    head_problems,
    split_script,
)
from rarms_iac.powershell.statements import top_statements
from rarms_iac.powershell.templates import FORMER_PLAN, PLAN, ScriptForm, module_digest, module_text
from rarms_iac.powershell.tree import line_of, text_of, walk

if TYPE_CHECKING:
    from tree_sitter import Node

_FORMER_LAST = f"Invoke-Run -Steps {{ {FORMER_PLAN} }}"
_LAST = "exit $code"
_PARAMETER = r"\[(?:switch|int|string)\] \$[A-Za-z]+(?: = (?:[0-9]+|'[A-Za-z0-9]*'))?"
_WORDS = r"(?:[A-Za-z]+ = )?'[^'\r\n]*'"
_PARAMETERS = re.compile(
    r"\[CmdletBinding\(SupportsShouldProcess, (?:PositionalBinding = \$false, )?"
    r"ConfirmImpact = '(?:Medium|High)'\)\]\s+"
    rf"(?:\[Diagnostics\.CodeAnalysis\.SuppressMessageAttribute\({_WORDS}(?:,\s+{_WORDS})*\)\]\s+)?"
    rf"param\({_PARAMETER}(?:, {_PARAMETER})*\)"
    r"|(?:\[Diagnostics\.CodeAnalysis\.SuppressMessageAttribute\([^)\r\n]*\r\n[^)\r\n]*\)\]\r\n)+param\(\)"
)
_FUNCTION = re.compile(r"function [A-Za-z]+-[A-Za-z0-9]+ \{")

# NOTE: what rarms no longer writes stays here: the journals of earlier versions hold it.
_SETTINGS = frozenset(
    {
        "$PSDefaultParameterValues = @{}",
        "Set-StrictMode -Version 3.0",
        "$ErrorActionPreference = 'Stop'",
        *(
            f"${stream}Preference = 'SilentlyContinue'"
            for stream in ("Debug", "Information", "Progress", "Verbose", "Warning")
        ),
        "$PSModuleAutoLoadingPreference = 'All'",
        "if ([string] $ExecutionContext.SessionState.LanguageMode -cne 'FullLanguage') {\r\n"
        "    throw 'AppLocker or App Control takes the language from PowerShell here: "
        "allow this script by its signer'\r\n}",
        "if (-not $PSCommandPath -or $MyInvocation.InvocationName -ceq '.') "
        "{ throw 'run this script as a file, not dot-sourced' }",
        "if ([string] $ExecutionContext.SessionState.LanguageMode -cne 'FullLanguage') "
        "{ throw 'App Control: allow this script by its signer' }",
        "if ($Force -and -not $PSBoundParameters.ContainsKey('Confirm')) { $ConfirmPreference = 'None' }",
        "$ConfirmPreference = 'None'",
        "$folder = ''",
        "$code = 1",
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
_DIGEST = re.compile(r"^    '([A-Za-z.1]+)' = '([0-9A-F]{64})'$", re.MULTILINE)
_EXPORT = re.compile(r"Export-ModuleMember -Function '[A-Za-z]+-[A-Za-z]+'")
_ADVICE = ": put it there"  # which earlier versions did not give
_IMPORT = re.compile(
    re.sub(
        r"[0-9A-F]{64}",
        "[0-9A-F]{64}",
        re.escape(module_text(ScriptForm.MODULE))
        .replace(re.escape(__version__), r"[0-9A-Za-z.+]+")
        .replace(re.escape(_ADVICE), f"(?:{re.escape(_ADVICE)})?"),
    )
)
"""The lines that find the module beside a script, of any version."""
_NAME = re.compile(r"\$(?:common|form|name|script:(?!PS|\w*Preference$)[A-Z][A-Za-z]*)", re.IGNORECASE)
_VALUE = re.compile(
    r"'[^'\r\n]*'|(?:\[long\] )?[0-9]+|@\(\)|@\{\}|\$(?:true|false|null|PSCmdlet|script:[A-Za-z]+)"
    r"|@\{ [A-Za-z]+ = (?:'[a-z]*'|[0-9]+)(?:; [A-Za-z]+ = (?:'[a-z]*'|[0-9]+))* \}"
)
_VALUES = frozenset(
    {
        "'{0}@{1}, process {2}' -f [Environment]::UserName, [Environment]::MachineName, $PID",
        "Join-Path -Path $common -ChildPath 'rarms'",
        "Join-Path -Path $script:Folder -ChildPath 'journal.jsonl'",
        "Join-Path -Path $script:Folder -ChildPath 'owner.txt'",
        "[System.Diagnostics.Stopwatch]::StartNew()",
        "[System.StringComparer]::Ordinal",
        "[bool] $AsJson",
        "[hashtable]::new($script:Ordinal)",
        "$form.Replace('NAME', $name)",
        "if ($env:ProgramData) { $env:ProgramData } else { [Environment]::GetFolderPath('CommonApplicationData') }",
    }
)


def check_around_plan(name: str, script: str, root: "Node") -> Iterator[Diagnostic]:
    """Find what a script out of a journal holds beside its plan that no version of rarms writes there.

    Args:
        name: the script's, for the findings.
        script: its text.
        root: of its tree; fixed parts that are the shipped ones may be left out.

    Yields:
        What PowerShell would heed in a comment, or run before the plan is called or after.
    """
    parts = split_script(script)
    body = "\n".join([parts.plan, _without_help(parts.fixed.text) if parts.fixed else "", parts.end])
    for problem in (*head_problems(parts.head), *comment_problems(body)):
        yield HEAD.at(
            Place(file=name, line=1, column=1),
            problem,
            "render the script again",
            values={"script": name, "reason": problem},
        )
    statements = [node for node in top_statements(root) if node.type not in {"comment", "empty_statement"}]
    imported = parts.fixed if parts.fixed and _IMPORT.fullmatch(parts.fixed.text) else None
    if imported is not None:
        statements = [node for node in statements if not imported.first <= line_of(node) <= imported.last]
    former = any(node.type == "function_statement" for node in statements)
    for at, node in enumerate(statements, start=1):
        if at == len(statements):
            known = text_of(node) == (_FORMER_LAST if former else _LAST)
        else:
            known = _is_definition(node) or (not former and _is_of_module(node))
        if not known:
            detail = f"beside its plan stands {quoted(text_of(node), 60)}"
            yield HEAD.at(
                Place(file=name, line=line_of(node), column=1),
                detail,
                "render the script again",
                values={"script": name, "text": text_of(node)[:60]},
            )


def check_module(name: str, script: str, module: Mapping[str, str]) -> Iterator[Diagnostic]:
    """Find whether a module out of a journal is another than its script names; this version's is not asked.

    Args:
        name: the script's, for the findings.
        script: its text.
        module: the module's files by name; a signature block in them does not count.

    Yields:
        That a file of it is missing, superfluous or another than the script's digests say.
    """
    fixed = split_script(script).fixed
    imported = fixed.text if fixed is not None and fixed.form is ScriptForm.MODULE else ""
    digests = dict(_DIGEST.findall(imported))
    if {file: module_digest(text) if text.isascii() else "" for file, text in module.items()} != digests:
        detail = "the module that was kept with it is another than it names" if module else "its module was not kept"
        yield RUNTIME.at(Place(file=name, line=1, column=1), detail, "render the script again", values={"script": name})


def _without_help(module: str) -> str:
    """A module's text without the help of its functions, which stands in comments of their own."""
    return re.sub(r"^    <#\n.*?\n    #>$", "", module, flags=re.DOTALL | re.MULTILINE)


def _is_definition(node: "Node") -> bool:
    text = text_of(node)
    match node.type:
        case "param_block":
            return _PARAMETERS.fullmatch(text) is not None
        case "function_statement":
            return _FUNCTION.match(text) is not None
        case _:
            return text in _SETTINGS or _gives_value(node)


def _is_of_module(node: "Node") -> bool:
    """Whether a statement is the script's plan, which is looked at elsewhere, or makes its module of definitions."""
    text = text_of(node)
    if text.startswith(f"{PLAN} = {{"):
        return True
    if not text.startswith(NEW_MODULE):
        return False
    block = next(child for child in walk(node) if child.type == "script_block")
    return all(_is_definition(child) or _EXPORT.fullmatch(text_of(child)) for child in _statements(block))


def _statements(node: "Node") -> Iterator["Node"]:
    """What stands in a block, its parameters included."""
    for child in node.children:
        if child.type in {"script_block_body", "statement_list"}:
            yield from _statements(child)
        elif child.is_named and child.type not in {"comment", "empty_statement"}:
            yield child


def _gives_value(node: "Node") -> bool:
    match [child for child in node.children if child.type != "comment"]:
        case [assignment] if node.type == "pipeline":
            return _gives_value(assignment)
        case [name, operator, value] if node.type == "assignment_expression" and text_of(operator) == "=":
            text = text_of(value)
            return _NAME.fullmatch(text_of(name)) is not None and (text in _VALUES or bool(_VALUE.fullmatch(text)))
        case _:
            return False
