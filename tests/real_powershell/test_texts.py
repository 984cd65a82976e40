"""What needs no host of the model, so that Windows PowerShell 5.1 shows it, too: texts, literals, module, cmdlets."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path

import pytest

from rarms_iac.powershell.literals import literal
from rarms_iac.powershell.templates import shipped_module
from rarms_iac.storage.records import sealed_line
from tests.effort import examples
from tests.powershell_lint.filled import everything
from tests.real_powershell.any_engine import SYSTEM, run_on_files
from tests.real_powershell.engines import Engine
from tests.real_powershell.runner import HERE, made_modules
from tests.unit.powershell.hostile import hostile_texts

pytestmark = pytest.mark.needs(f"powershell-{SYSTEM}")

PARSE = """param([string] $Folder)
$ErrorActionPreference = 'Stop'
foreach ($file in @(Get-ChildItem -LiteralPath $Folder -Recurse -File)) {
    $tokens = $problems = $null
    [void] [System.Management.Automation.Language.Parser]::ParseFile($file.FullName, [ref] $tokens, [ref] $problems)
    $help = if ($file.Name -like 'onboard.*') { (Get-Help -Name $file.FullName).Synopsis }
    '{0}|{1}|{2}' -f $file.Name, @($problems).Count, (@($help) -join ' ').Trim()
}
"""

LITERALS = """param([string] $Folder)
$ErrorActionPreference = 'Stop'
Set-StrictMode -Version 3.0
foreach ($text in @(& ([System.IO.Path]::Combine($Folder, 'all.ps1')))) {
    (@(foreach ($one in $text.ToCharArray()) { '{0:x4}' -f [int] $one }) -join '') + '.'
}
"""

NEWER = """param([string] $Folder)
try { & '{compile}' -Sources $Folder -Modules $Folder } catch { $_.Exception.Message; exit 3 }
"""

MODULE = """param([string] $Folder)
$ErrorActionPreference = 'Stop'
# PowerShell for Linux has no cultures here.
if ($env:OS -ceq 'Windows_NT') { [System.Threading.Thread]::CurrentThread.CurrentCulture = 'tr-TR' }
$rarms = Import-Module -Name ([System.IO.Path]::Combine($Folder, 'Rarms.psd1')) -PassThru
(@($rarms.ExportedFunctions.Keys) | Sort-Object) -join ' '
& $rarms {
    $record = [ordered] @{ number = 3; status = 'begun'; kind = 'step_recorded' }
    (Get-Sealed -Text (ConvertTo-AsciiJson -Value $record)).Trim()
    $text = '<' + [char] 0xe4 + [char] 0x2028 + "'&>"
    ConvertTo-AsciiJson -Value ([ordered] @{ text = $text; empty = @(); one = @(1) })
    $table = Get-OrdinalTable -From @{ i = 1 }
    $table['I'] = 2
    $table['i' + [char] 0x200b] = 3
    '{0} {1} {2}' -f $table.Count, $table['i'], (Test-Same -AnyCase -Left 'FILE' -Right 'file')
    ConvertTo-Processor -Percent 160
}
"""

BOUND = """param([string] $Folder)
$ErrorActionPreference = 'Stop'
& '{compile}' -Sources '{sources}' -Modules '{modules}'
$env:PSModulePath = '{modules}' + [System.IO.Path]::PathSeparator + $env:PSModulePath
$command = Get-Command -Name 'Hyper-V\\Set-VMProcessor'
'{0} {1} {2}' -f $command.CommandType, $command.Version, $command.Parameters['Reserve'].ParameterType.Name
$calls = { param($Node) $Node -is [System.Management.Automation.Language.CommandAst] }
$known = @{}
Import-Module -Name 'Hyper-V', 'Microsoft.PowerShell.Management', 'Microsoft.PowerShell.Utility'
foreach ($one in @(Get-Command -CommandType Cmdlet -ListImported)) { $known[$one.Name] = $true }
$bound = 0
foreach ($file in @(Get-ChildItem -LiteralPath $Folder -Recurse -File)) {
    $tokens = $problems = $null
    $tree = [System.Management.Automation.Language.Parser]::ParseFile($file.FullName, [ref] $tokens, [ref] $problems)
    foreach ($call in @($tree.FindAll($calls, $true))) {
        $name = $call.GetCommandName()
        if (-not $name -or -not $known.Contains($name.Split('\\')[-1])) { continue }
        $binding = [System.Management.Automation.Language.StaticParameterBinder]::BindCommand($call, $true)
        foreach ($key in @($binding.BindingExceptions.Keys)) {
            '{0}: {1}: {2}' -f $file.Name, $key, $call.Extent.Text
        }
        $bound += @($binding.BoundParameters.Keys).Count
    }
}
$bound
"""
UNBOUND = {
    "a parameter of no set": "Hyper-V\\Get-VM -Name 'x' -Id 'y'",
    "a parameter given twice": "Hyper-V\\Get-VMProcessor -VM $x -VM $x",
    "a parameter that is not there": "Hyper-V\\Get-VMProcessor -VN $x",
    "a parameter without its value": "Hyper-V\\Set-VMProcessor -VM $x -Reserve",
}


def test_every_text_is_parsed_and_has_help(engine: Engine, tmp_path: Path) -> None:
    files = everything()

    ended = run_on_files(engine, tmp_path, PARSE, files)

    assert (ended.code, ended.err) == (0, ""), ended
    said = [line.split("|") for line in ended.out.splitlines()]
    assert len(said) == len(files)
    assert [line for line in said if line[1] != "0"] == []
    helps = [says for name, _, says in said if name.startswith("onboard.")]
    assert len(helps) == sum(re.search(r"(^|/)onboard\.", name) is not None for name in files)
    assert all(says.startswith("rarms ") for says in helps), helps


def test_literals_are_read_back(engine: Engine, tmp_path: Path) -> None:
    texts = hostile_texts(examples(300), seed=46)
    lines = "\r\n".join(["", *map(literal, texts), ""])

    ended = run_on_files(engine, tmp_path, LITERALS, {"all.ps1": lines.encode("ascii")})

    assert (ended.code, ended.err) == (0, ""), ended
    read = [bytes.fromhex(line.removesuffix(".")).decode("utf-16-be") for line in ended.out.splitlines()]
    assert read == texts


def test_module_compares_and_writes_alike(engine: Engine, tmp_path: Path) -> None:
    """On Windows under the culture of Turkey, where I is not the upper case of i."""
    files = {name: text.encode("ascii") for name, text in shipped_module().items()}

    ended = run_on_files(engine, tmp_path, MODULE, files)

    assert (ended.code, ended.err) == (0, ""), ended
    functions, sealed, text, compared, share = ended.out.splitlines()
    assert f"'{functions.split()[0]}'" in shipped_module()["Rarms.psd1"]
    assert len(functions.split()) == 8
    assert sealed.encode() + b"\n" == sealed_line({"number": 3, "status": "begun", "kind": "step_recorded"})
    assert text.isascii()
    assert json.loads(text) == {"text": "<ä\u2028'&>", "empty": [], "one": [1]}
    assert (compared, share) == ("3 1 True", "1.6 LP")


def bound(engine: Engine, folder: Path, files: Mapping[str, bytes]) -> list[str]:
    """How the cmdlet with the name Set-VMProcessor was made, which calls do not bind, and how many parameters do."""
    modules = made_modules(linux=SYSTEM == "linux")
    script = BOUND.replace("{compile}", engine.path(HERE / "csharp" / "compile.ps1"))
    script = script.replace("{sources}", engine.path(modules.with_name("sources")))

    ended = run_on_files(engine, folder, script.replace("{modules}", engine.path(modules)), files)

    assert ended.code == 0, ended
    return ended.out.splitlines()


def test_calls_of_compiled_cmdlets_bind(engine: Engine, tmp_path: Path) -> None:
    made, *unbound, count = bound(engine, tmp_path, everything())

    assert made == "Cmdlet 2.0.0.0 Int64"
    assert unbound == []
    assert int(count) > 500


def test_calls_that_do_not_bind_are_found(engine: Engine, tmp_path: Path) -> None:
    files = {f"{name}.ps1": f"$x = 1\n{text}\n".encode("ascii") for name, text in UNBOUND.items()}

    _, *unbound, _ = bound(engine, tmp_path, files)

    assert sorted({says.partition(".ps1")[0] for says in unbound}) == sorted(UNBOUND)


def test_newer_csharp_is_refused(engine: Engine, tmp_path: Path) -> None:
    """The compiler of Windows PowerShell 5.1 knows C# 5 only."""
    text = b'public static class Newer { public static string Text { get { return $"{1}"; } } }\n'
    compiler = engine.path(HERE / "csharp" / "compile.ps1")
    script = NEWER.replace("{compile}", compiler)

    ended = run_on_files(engine, tmp_path, script, {"newer.cs": text})

    assert ended.code == 3, ended
    assert "CS8026" in ended.out or "'$'" in ended.out, ended
