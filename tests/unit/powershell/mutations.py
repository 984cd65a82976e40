"""What somebody, or a bug, could do to a good script. Each operator answers with a changed script, or None."""

import random
import re
from collections.abc import Callable

Mutation = Callable[[str, random.Random], str | None]

LINE = "\r\n"
CMDLETS = r"(?<![\w$.-])(?:Hyper-V\\)?(?:Get|Set|New|Remove|Add|Test|Start|Stop|Join|ConvertTo)-[A-Z]\w+(?= -)"
PARAMETERS = r"(?<=[ (])-(?!(?:eq|ne|gt|lt|le|f|or|and|not|join|split|replace|band|c\w+)\b)[A-Z]\w+(?=[ )])"


def _replace(pattern: str, change: Callable[[re.Match[str], random.Random], str]) -> Mutation:
    """Changes one of the places, any of them."""

    def mutate(script: str, pick: random.Random) -> str | None:
        found = [match for match in re.finditer(pattern, script) if not _in_comment(script, match.start())]
        if not found:
            return None
        chosen = pick.choice(found)
        return script[: chosen.start()] + change(chosen, pick) + script[chosen.end() :]

    return mutate


def _in_comment(script: str, at: int) -> bool:
    """Whether it only stands in a remark, where no change matters."""
    line = script[script.rfind("\n", 0, at) + 1 : at]
    return line.lstrip().startswith("#") or "  # " in line


def _insert(*lines: str) -> Mutation:
    """Puts a line of its own before a line that begins a statement."""

    def mutate(script: str, pick: random.Random) -> str | None:
        starts = [
            match.start()
            for match in re.finditer(r"(?m)^ +(?=\$\w+ = |Hyper-V\\|\[ordered\]|Add-Step|Use-Target|Write-)", script)
        ]
        if not starts:
            return None
        at = pick.choice(starts)
        return script[:at] + "    " + pick.choice(lines) + LINE + script[at:]

    return mutate


def _spelt(match: re.Match[str], pick: random.Random) -> str:
    word = match[0]
    at = pick.randrange(2, len(word))
    return word[:at] + pick.choice("xq") + word[at:]


def _shortened(match: re.Match[str], _: random.Random) -> str:
    return match[0][:-1] if len(match[0]) > 3 else match[0] + "x"


def _value(*choices: str) -> Callable[[re.Match[str], random.Random], str]:
    return lambda _, pick: pick.choice(choices)


def _before(*choices: str) -> Callable[[re.Match[str], random.Random], str]:
    return lambda match, pick: pick.choice(choices) + match[0]


def _after(*choices: str) -> Callable[[re.Match[str], random.Random], str]:
    return lambda match, pick: match[0] + pick.choice(choices)


def _lost_quote(script: str, pick: random.Random) -> str | None:
    places = [match.start() for match in re.finditer("'", script) if not _in_comment(script, match.start())]
    at = pick.choice(places)
    return script[:at] + script[at + 1 :]


def _strange_character(script: str, pick: random.Random) -> str:
    at = pick.randrange(len(script))
    return script[:at] + pick.choice("\u2019\u2018\u00a0\u201c\u2013é\0\u2028\ufeff\x1b\t\x0b") + script[at:]


def _line_end(script: str, pick: random.Random) -> str:
    at = pick.choice([match.start() for match in re.finditer(LINE, script)])
    return script[:at] + "\n" + script[at + 2 :]


def _escaped_dynamic(match: re.Match[str], _: random.Random) -> str:
    return match[0][:5] + "`" + match[0][5:]


def _in_runtime(script: str, pick: random.Random) -> str:
    """One character of what is fixed, the runtime or a part, becomes another."""
    begin, end = script.index("# --- runtime"), script.rindex("# --- end of the ")
    at = pick.choice([at for at in range(begin, end) if script[at].isalnum()])
    return script[:at] + ("b" if script[at] == "a" else "a") + script[at + 1 :]


def _part(change: Callable[[str, str], str]) -> Mutation:
    """Changes one of the parts behind the runtime, any of them: what it is given is the whole part, and the script."""

    def mutate(script: str, pick: random.Random) -> str:
        found = re.findall(r"(?ms)^# --- part .*?^# --- end of the part [^\n]*\n", script)
        return change(pick.choice(found), script)

    return mutate


DANGEROUS: dict[str, Mutation] = {
    "a parameter misspelt": _replace(PARAMETERS, _spelt),
    "a parameter shortened": _replace(PARAMETERS, _shortened),
    "a cmdlet misspelt": _replace(CMDLETS, _spelt),
    "a cmdlet of another module": _replace(
        r"Hyper-V\\(?=\w+-VM)", _value("", "VMware.VimAutomation.Core\\", "SCVMM\\")
    ),
    "Invoke-Expression": _insert("Invoke-Expression -Command $text", "Invoke-Expression 'x'", "iex $line", "IEX 'x'"),
    "iex by variable": _insert("$x = 'iex'; & $x 'y'", "& ('i' + 'ex') 'y'", "& (Get-Item -LiteralPath 'x')"),
    "a .NET call": _insert(
        "[System.Diagnostics.Process]::Start('calc')",
        "[System.IO.File]::Delete('C:\\x')",
        "[System.Reflection.Assembly]::LoadFile('x')",
        "[Environment]::Exit(0)",
        "[System.IO.File]::AppendAllText('x', 'y')",
    ),
    "& on a string": _insert("& 'calc.exe'", "& calc.exe", "& 'Hyper-V\\Get-VM'", "&Get-VM"),
    ".Invoke()": _insert("$vm.Invoke()", "{ Get-Item -LiteralPath 'x' }.Invoke()", "$name.InvokeReturnAsIs()"),
    "a block from text": _insert("[scriptblock]::Create('x')", "& ([scriptblock]::Create('x'))"),
    "dot-sourcing": _insert(". ./x.ps1", ". 'C:\\x.ps1'", ". $path", ". { Get-Item -LiteralPath 'x' }"),
    "redirection": _replace(CMDLETS + r"[^\r\n{}()|]*(?=\r\n)", _after(" > C:\\x.txt", " >> x", " 2> x", " *> x")),
    "an alias": _insert("gci -LiteralPath 'x'", "rm 'x'", "del x", "? { $_ }", "gvm", "echo 'x'", "sc x y"),
    "a program": _insert("cmd /c del x", "bcdedit /set hypervisorschedulertype root", "powershell -c x", "calc"),
    "another cmdlet": _insert(
        "Write-Host -Object 'x'",
        "Restart-Computer",
        "Restart-Computer -Force",
        "Set-ExecutionPolicy -ExecutionPolicy Bypass",
        "Start-Process -FilePath 'x'",
        "Add-Type -TypeDefinition 'x'",
        "New-Object -ComObject 'x'",
        "Invoke-Command -ScriptBlock { Get-Item -LiteralPath 'x' }",
        "Import-Module -Name 'x'",
        "Set-Variable -Name 'x' -Value 1",
        "Hyper-V\\Export-VM -Name 'x' -Path 'y'",
        "Hyper-V\\Restore-VMSnapshot -Name 'x' -VMName 'y'",
    ),
    "a backtick": _replace(CMDLETS, _escaped_dynamic),
    "a line joined": _replace(r"\r\n", _before(" `")),
    "splatting": _insert("$p = @{ Name = 'x' }; Hyper-V\\Get-VM @p", "Hyper-V\\Get-VM @args"),
    "text that is expanded": _insert('$x = "a $(Get-VM) b"', '$x = "$vm"', '$x = @"' + LINE + "a" + LINE + '"@'),
    "a value without a name": _replace(CMDLETS, _after(" 'x'", " $x", " 5")),
    "a parameter of no set": _replace(r"Hyper-V\\Get-VM\w+(?= -VM )", _after(" -VMName 'x'", " -ComputerName 'x'")),
    "a parameter twice": _replace(r"-(?:VM|Path|LiteralPath) \$\w+", lambda match, _: f"{match[0]} {match[0]}"),
    "a member by a value": _insert("$vm.('Del' + 'ete')()", "$vm.$name()", "$vm.'Delete'()"),
    "a member of its own choice": _insert("$vm.Delete()", "$key.DeleteSubKeyTree('x')", "$x = $vm.GetType()"),
    "a type": _insert("[System.Net.WebClient]::new()", "[PowerShell]::Create()", "[wmi] 'x'", "[adsi] 'x'"),
    "an operator": _insert("$x = 1 -as 'type'", "$x = 1 -is 'int'", "$x = 5 -shl 2", "$x = 7 / 2", "$x = 7 % 2"),
    "a variable of PowerShell": _insert(
        "$PSDefaultParameterValues = @{ '*:Force' = $true }",
        "$env:PATH = 'x'",
        "$global:x = 1",
        "$WhatIfPreference = $false",
        "${function:Get-VM} = { 1 }",
        "$function:x = 'y'",
        "$x = $ExecutionContext",
    ),
    "a trap": _insert(
        "trap { continue }", "Start-Job -ScriptBlock { 1 }", "class X { }", "switch (1) { 1 { 2 } }", "data { 1 }"
    ),
    "a function over a cmdlet": _insert("function Get-Item { 1 }", "function Get-Things { 1 }", "filter x { 1 }"),
    "a comment that PowerShell heeds": _insert(
        "#Requires -Modules Evil", "#requires -Modules Evil", "# SIG # Begin signature block", "<# more #>"
    ),
    "a quote lost": _lost_quote,
    "a strange character": _strange_character,
    "a line end": _line_end,
    "an unused variable": _insert("$neverRead = 5"),
    "an empty catch": _insert("try { Hyper-V\\Get-VM } catch { }"),
    "null on the right": _insert("if ($vm -eq $null) { Hyper-V\\Get-VM }"),
    "text behind the end": lambda script, pick: (
        script + pick.choice(["Get-Item -LiteralPath 'x'", "exit 1", "'x'"]) + LINE
    ),
    "a chain": _replace(
        CMDLETS + r"[^\r\n{}()|]*(?=\r\n)", _after(" | iex", " | Out-File x", " && calc", " ; calc", " &")
    ),
}
"""Faults that matter in any script."""

CHANGING: dict[str, Mutation] = {
    "a changed runtime": _in_runtime,
    "a forced key": _replace(r"\[void\] \(New-Item -Path \$Path", _after(" -Force")),
    "a runtime without its end": lambda script, _: script.replace("# --- end of the runtime", "# --- the runtime"),
    "a part that is missing": _part(lambda part, script: script.replace(part, "")),
    "a part that is there twice": _part(lambda part, script: script.replace(part, part + part)),
    "a part of somebody else's": _part(
        lambda part, script: script.replace(part, part.replace("# --- part ", "# --- part x"))
    ),
    "a part that goes on": _part(
        lambda part, script: script.replace(part, part + "function Test-More { Get-Item -LiteralPath 'x' }" + LINE)
    ),
    "a part before the runtime": _part(lambda part, script: part + script.replace(part, "")),
    "a guard that lets anything through": lambda script, _: script.replace("{ Assert-VmHost }", "{ Get-Operator }"),
    "a guard that is gone": lambda script, _: script.replace("        Guard = { Assert-VmHost }" + LINE, ""),
    "a guard of a guest": lambda script, _: script.replace("{ Assert-VmHost }", "{ Assert-Guest }"),
    "room that is not asked for": _replace(r"(?<=-Fits \{ )Test-Capacity", _before("Clear-Mark; ")),
    "something behind what is fixed": lambda script, pick: script.replace(
        LINE + "Invoke-Run",
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
        + "Invoke-Run",
    ),
    "something beside the plan": lambda script, pick: script.replace(
        LINE + "function Add-Plan {",
        LINE
        + pick.choice(["Hyper-V\\Get-VM", "$x = 5", "function Add-More { Hyper-V\\Get-VM }"])
        + LINE
        + "function Add-Plan {",
    ),
    "a plan that ends early": _replace(r"(?m)^    Use-Target", _before("}" + LINE + "function Add-More {" + LINE)),
    "a profile that reaches in": lambda script, _: script.replace("$PSDefaultParameterValues = @{}" + LINE, ""),
    "a head that does something": lambda script, _: "Hyper-V\\Get-VM" + LINE + script,
    "a head that asks for less": lambda script, _: script.replace("#Requires -RunAsAdministrator" + LINE, ""),
    "a help of another command": lambda script, _: script.replace(
        ".NOTES" + LINE, ".FORWARDHELPTARGETNAME Get-Help" + LINE + ".NOTES" + LINE
    ),
    "a help that ends early": lambda script, _: script.replace(".NOTES" + LINE, "#>" + LINE + "Hyper-V\\Get-VM" + LINE),
    "a signature": lambda script, _: "# SIG # Begin signature block" + LINE + script,
    "a step that computes": _replace(
        r"(?<=-Before )@\{ ", _after("'x' = (Get-Item -LiteralPath 'x'); ", "'x' = $script:Vm; ")
    ),
    "a read that changes": _replace(
        r"(?<=-Read \{ )Read-\w+", _before("Hyper-V\\Start-VM -Name 'x'; ", "Clear-Mark; ")
    ),
    "a set that loops": _replace(r"(?<=-Set \{)\r\n", _after("foreach ($x in 1, 2) { Write-Mark }" + LINE)),
    "a set that assigns": _replace(r"(?<=-Set \{)\r\n", _after("$x = 5" + LINE, "$script:Done = @{}" + LINE)),
    "a set that runs the runtime": _replace(r"(?<=-Set \{)\r\n", _after("Exit-Host" + LINE, "exit 0" + LINE)),
    "a step with a part more": _replace(r"Add-Step(?= -Action)", _after(" -Force $true", " -Needs 'x'")),
    "a step that says a part twice": _replace(r"Add-Step(?= -Action)", _after(" -Set { Clear-Mark }")),
    "another end": lambda script, _: script.replace("Invoke-Run -Steps { Add-Plan }", "Add-Plan"),
}

READING: dict[str, Mutation] = {
    "a read-only script that writes": _insert(
        "Hyper-V\\Start-VM -Name 'x'",
        "Hyper-V\\Set-VM -Name 'x' -Notes ''",
        "Hyper-V\\Remove-VM -Name 'x' -Force",
        "New-Item -Path 'HKLM:\\SOFTWARE\\x'",
        "New-ItemProperty -LiteralPath 'x' -Name 'y' -Value 1",
        "Remove-Item -LiteralPath 'x'",
        "Set-Content -LiteralPath 'x' -Value 'y'",
        "[System.IO.File]::WriteAllText('x', 'y')",
        "[System.IO.Directory]::CreateDirectory('x')",
        "Invoke-CimMethod -ClassName 'x' -MethodName 'y'",
        "$key.SetValue('x', 1)",
        "Out-File -FilePath 'x' -InputObject 'y'",
    ),
}
