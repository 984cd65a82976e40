"""What a journal's script does before its plan is called: it gives values to names, and defines functions.

Another version may have made it, so its parts are not compared. What functions do is free (decision 0043). All else at
the script's top has one of the forms here, which every version writes.
"""

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING

from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.model.wording import quoted
from rarms_iac.powershell.inspection.layout import HEAD, comment_problems, head_problems, split_script
from rarms_iac.powershell.statements import top_statements
from rarms_iac.powershell.templates import ENTRY, PLAN
from rarms_iac.powershell.tree import line_of, text_of

if TYPE_CHECKING:
    from tree_sitter import Node

_LAST = f"{ENTRY} -Steps {{ {PLAN} }}"
_PARAMETER = r"\[(?:switch|int|string)\] \$[A-Za-z]+(?: = (?:[0-9]+|'[A-Za-z0-9]*'))?"
_WORDS = r"(?:[A-Za-z]+ = )?'[^'\r\n]*'"
_PARAMETERS = re.compile(
    r"\[CmdletBinding\(SupportsShouldProcess, (?:PositionalBinding = \$false, )?"
    r"ConfirmImpact = '(?:Medium|High)'\)\]\s+"
    rf"(?:\[Diagnostics\.CodeAnalysis\.SuppressMessageAttribute\({_WORDS}(?:,\s+{_WORDS})*\)\]\s+)?"
    rf"param\({_PARAMETER}(?:, {_PARAMETER})*\)"
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
        "if ($Force -and -not $PSBoundParameters.ContainsKey('Confirm')) { $ConfirmPreference = 'None' }",
    }
)
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
    body = "\n".join([parts.plan, *(piece.text for piece in parts.fixed if not piece.is_shipped), parts.end])
    for problem in (*head_problems(parts.head), *comment_problems(body)):
        yield HEAD.at(
            Place(file=name, line=1, column=1),
            problem,
            "render the script again",
            values={"script": name, "reason": problem},
        )
    statements = [node for node in top_statements(root) if node.type not in {"comment", "empty_statement"}]
    for at, node in enumerate(statements, start=1):
        if not (text_of(node) == _LAST if at == len(statements) else _is_definition(node)):
            detail = f"beside its plan stands {quoted(text_of(node), 60)}"
            yield HEAD.at(
                Place(file=name, line=line_of(node), column=1),
                detail,
                "render the script again",
                values={"script": name, "text": text_of(node)[:60]},
            )


def _is_definition(node: "Node") -> bool:
    text = text_of(node)
    match node.type:
        case "param_block":
            return _PARAMETERS.fullmatch(text) is not None
        case "function_statement":
            return _FUNCTION.match(text) is not None
        case _:
            return text in _SETTINGS or _gives_value(node)


def _gives_value(node: "Node") -> bool:
    match [child for child in node.children if child.type != "comment"]:
        case [assignment] if node.type == "pipeline":
            return _gives_value(assignment)
        case [name, operator, value] if node.type == "assignment_expression" and text_of(operator) == "=":
            text = text_of(value)
            return _NAME.fullmatch(text_of(name)) is not None and (text in _VALUES or bool(_VALUE.fullmatch(text)))
        case _:
            return False
