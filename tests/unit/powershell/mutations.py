"""What a person, or a bug, could do to a good script. Each operator answers with a changed script, or None."""

import random
import re
from collections.abc import Callable

Mutation = Callable[[str, random.Random], str | None]

LINE = "\r\n"
CMDLETS = r"(?<![\w$.-])(?:Hyper-V\\)?(?:Get|Set|New|Remove|Add|Test|Start|Rename|Read|Write|Clear)-[A-Z]\w+(?= -)"
PARAMETERS = r"(?<=[ (])-(?!(?:eq|ne|gt|lt|le|f|or|and|not|join|split|replace|band|c\w+)\b)[A-Z]\w+(?=[ )])"


def _replace(pattern: str, change: Callable[[re.Match[str], random.Random], str]) -> Mutation:
    """Changes one of the places in the plan, any of them."""

    def mutate(script: str, pick: random.Random) -> str | None:
        begin, end = script.index("$plan = {"), script.index("#region The module")
        found = [
            match
            for match in re.compile(pattern).finditer(script, begin, end)
            if not _in_comment(script, match.start())
        ]
        if not found:
            return None
        chosen = pick.choice(found)
        return script[: chosen.start()] + change(chosen, pick) + script[chosen.end() :]

    return mutate


def _in_comment(script: str, at: int) -> bool:
    """Whether it only stands in a remark, where no change matters."""
    line = script[script.rfind("\n", 0, at) + 1 : at]
    return line.lstrip().startswith("#") or "  # " in line


def _spelt(match: re.Match[str], pick: random.Random) -> str:
    word = match[0]
    at = pick.randrange(2, len(word))
    return word[:at] + pick.choice("xq") + word[at:]


def _shortened(match: re.Match[str], _: random.Random) -> str:
    return match[0][:-1] if len(match[0]) > 3 else match[0] + "x"


def _instead(*choices: str) -> Callable[[re.Match[str], random.Random], str]:
    return lambda _, pick: pick.choice(choices)


def _before(*choices: str) -> Callable[[re.Match[str], random.Random], str]:
    return lambda match, pick: pick.choice(choices) + match[0]


def _after(*choices: str) -> Callable[[re.Match[str], random.Random], str]:
    return lambda match, pick: match[0] + pick.choice(choices)


def _strange_character(script: str, pick: random.Random) -> str:
    at = pick.randrange(len(script))
    return script[:at] + pick.choice("\u2019\u2018\u00a0\u201c\u2013é\0\u2028\ufeff\x1b\t\x0b") + script[at:]


def _line_end(script: str, pick: random.Random) -> str:
    at = pick.choice([match.start() for match in re.finditer(LINE, script)])
    return script[:at] + "\n" + script[at + 2 :]


def _in_module(script: str, pick: random.Random) -> str:
    """One character of what gives the script its module becomes another."""
    begin, end = script.index("#region The module"), script.index("#endregion")
    at = pick.choice([at for at in range(begin, end) if script[at].isalnum()])
    return script[:at] + ("b" if script[at] == "a" else "a") + script[at + 1 :]


def _module(change: Callable[[str, str], str]) -> Mutation:
    """Changes what gives the script its module: what it is given is that piece, and the script."""

    def mutate(script: str, _: random.Random) -> str:
        found = re.search(r"(?ms)^#region The module.*?^#endregion\r\n", script)
        return change(found[0], script) if found else script

    return mutate


IN_THE_PLAN: dict[str, Mutation] = {
    "a parameter misspelt": _replace(PARAMETERS, _spelt),
    "a parameter shortened": _replace(PARAMETERS, _shortened),
    "a cmdlet misspelt": _replace(CMDLETS, _spelt),
    "a cmdlet of another module": _replace(
        r"Hyper-V\\(?=\w+-VM)", _instead("", "VMware.VimAutomation.Core\\", "SCVMM\\")
    ),
    "a statement more": _replace(
        r"(?m)^    (?=Add-Step|Use-Target)|(?<=-Set \{)\r\n",
        _after(
            *(
                f"    {line}{LINE}"
                for line in (
                    "Invoke-Expression 'x'",
                    "& ('i' + 'ex') 'y'",
                    ". 'C:\\x.ps1'",
                    "[System.IO.File]::Delete('C:\\x')",
                    "bcdedit /set hypervisorschedulertype root",
                    "Hyper-V\\Export-VM -Name 'x' -Path 'y'",
                    "$x = 5",
                    "$env:PATH = 'x'",
                    "${function:Get-VM} = { 1 }",
                    "$vm.Delete()",
                    "trap { continue }",
                    "function Get-Item { 1 }",
                    "foreach ($x in 1, 2) { Write-Mark }",
                    "Unlock-Host",
                    "exit 0",
                )
            )
        ),
    ),
    "a redirection": _replace(CMDLETS + r"[^\r\n{}()|]*(?=\r\n)", _after(" > C:\\x.txt", " >> x", " 2> x", " *> x")),
    "a chain": _replace(
        CMDLETS + r"[^\r\n{}()|]*(?=\r\n)", _after(" | iex", " | Out-File x", " && calc", " ; calc", " &")
    ),
    "a backtick": _replace(CMDLETS, lambda match, _: f"{match[0][:5]}`{match[0][5:]}"),
    "a line joined": _replace(r"\r\n", _before(" `")),
    "a value without a name": _replace(CMDLETS, _after(" 'x'", " $x", " 5")),
    "a parameter more": _replace(CMDLETS, _after(" -VMName 'x'", " -ComputerName 'x'", " -WhatIf")),
    "a parameter twice": _replace(r"-VM \$script:Vm", lambda match, _: f"{match[0]} {match[0]}"),
    "splatting": _replace(r"-VM \$script:Vm", lambda *_: "@args"),
    "text that is expanded": _replace(r"'[A-Za-z-]+'", lambda match, _: '"$(' + match[0] + ')"'),
    "a value that is computed": _replace(r"'[A-Za-z-]+'", lambda match, _: f"({match[0]} + $x)"),
    "a quote lost": _replace("'", lambda *_: ""),
    "room that is not asked for": _replace(r"(?<=-Fits \{ )Test-Capacity", _before("Clear-Mark; ")),
    "a step that computes": _replace(
        r"(?<=-Before )@\{ ", _after("'x' = (Get-Item -LiteralPath 'x'); ", "'x' = $script:Vm; ")
    ),
    "a read that changes": _replace(r"(?<=-Read \{ )Get-\w+", _before("Hyper-V\\Start-VM -Name 'x'; ", "Clear-Mark; ")),
    "a step with a part more": _replace(r"Add-Step(?= -Action)", _after(" -Force $true", " -Needs 'x'")),
    "a step that says a part twice": _replace(r"Add-Step(?= -Action)", _after(" -Set { Clear-Mark }")),
}
"""Faults in the steps: also where another version of rarms made the script."""


AROUND_THE_PLAN: dict[str, Mutation] = {
    "a changed module": _in_module,
    "a module without its end": lambda script, _: script.replace("#endregion", "#endregions"),
    "a module that is missing": _module(lambda module, script: script.replace(module, "")),
    "a module that is there twice": _module(lambda module, script: script.replace(module, module + module)),
    "a module that goes on": _module(
        lambda module, script: script.replace(
            module, module + "function Test-More { Get-Item -LiteralPath 'x' }" + LINE
        )
    ),
    "a module before the plan": _module(lambda module, script: module + script.replace(module, "")),
    "something behind what is fixed": lambda script, pick: script.replace(
        LINE + "$code = 1",
        LINE
        + pick.choice(
            [
                "param([string] $x = (Hyper-V\\Remove-VM -Name 'y' -Force))",
                "[CmdletBinding()]" + LINE + "param()",
                "| Hyper-V\\Remove-VM -Name 'x' -Force",
                "end { Hyper-V\\Get-VM }",
                "@{ x = 1 }",
            ]
        )
        + LINE
        + "$code = 1",
    ),
    "something beside the plan": lambda script, pick: script.replace(
        LINE + "$plan = {",
        LINE + pick.choice(["Hyper-V\\Get-VM", "$x = 5", "function Add-More { Hyper-V\\Get-VM }"]) + LINE + "$plan = {",
    ),
    "a plan that ends early": _replace(r"(?m)^    Use-Target", _before("}" + LINE + "$more = {" + LINE)),
    "a profile that reaches in": lambda script, _: script.replace("$PSDefaultParameterValues = @{}" + LINE, ""),
    "a head that does something": lambda script, _: "Hyper-V\\Get-VM" + LINE + script,
    "a head that asks for less": lambda script, _: script.replace("#Requires -RunAsAdministrator" + LINE, ""),
    "a help of another command": lambda script, pick: script.replace(
        ".NOTES" + LINE,
        pick.choice([".FORWARDHELPTARGETNAME", ".ForwardHelpTargetName"]) + " Get-Help" + LINE + ".NOTES" + LINE,
    ),
    "a help that ends early": lambda script, _: script.replace(".NOTES" + LINE, "#>" + LINE + "Hyper-V\\Get-VM" + LINE),
    "a signature": lambda script, _: "# SIG # Begin signature block" + LINE + script,
    "another end": lambda script, _: script.replace("& $invoke -Run $run", "& $plan"),
    "text behind the end": lambda script, pick: (
        script + pick.choice(["Get-Item -LiteralPath 'x'", "exit 1", "'x'"]) + LINE
    ),
    "a strange character": _strange_character,
    "a line end": _line_end,
    "a comment that PowerShell heeds": _replace(
        r"(?m)^    (?=Add-Step|Use-Target)",
        _before("#Requires -Modules Evil" + LINE, "# SIG # Begin signature block" + LINE, "<# more #>" + LINE),
    ),
}
"""Faults in all that stands around them."""
