"""PSScriptAnalyzer finds nothing in what rarms makes, and finds the mistakes that the lint leaves to it."""

from collections.abc import Mapping
from pathlib import Path

import pytest

from tests.powershell_lint.filled import everything
from tests.real_powershell.any_engine import SYSTEM, run_on_files
from tests.real_powershell.engines import Engine

pytestmark = pytest.mark.needs(f"powershell-{SYSTEM}")

ANALYZE = """param([string] $Folder)
$ErrorActionPreference = 'Stop'
if (-not (Get-Module -ListAvailable -Name PSScriptAnalyzer)) { 'no analyzer'; exit 0 }
$files = @(Get-ChildItem -LiteralPath $Folder -Recurse -File)
foreach ($file in $files) {
    foreach ($found in @(Invoke-ScriptAnalyzer -Path $file.FullName)) {
        '{0}:{1}: {2}' -f $file.Name, $found.Line, $found.RuleName
    }
}
'{0} files' -f $files.Count
"""

PLANTED = {
    "a plural": ("function Get-Things { 1 }", "PSUseSingularNouns"),
    "a verb of its own": ("function Fetch-Thing { 1 }", "PSUseApprovedVerbs"),
    "a change that does not ask": ("function Remove-Thing { 1 }", "PSUseShouldProcessForStateChangingFunctions"),
    "a variable that is not read": ("function Get-It { $x = 5 }", "PSUseDeclaredVarsMoreThanAssignments"),
    "a parameter that is not read": ("function Get-It { param($Name) 5 }", "PSReviewUnusedParameter"),
    "an empty catch": ("try { Get-Item -LiteralPath 'x' } catch { }", "PSAvoidUsingEmptyCatchBlock"),
    "null on the right": ("if (@(1) -eq $null) { 1 }", "PSPossibleIncorrectComparisonWithNull"),
}


def found(engine: Engine, folder: Path, files: Mapping[str, bytes]) -> list[str]:
    """Return what the analyzer says of these files: `name:line: rule`."""
    ended = run_on_files(engine, folder, ANALYZE, files)

    if ended.out.strip() == "no analyzer":
        pytest.skip(f"PSScriptAnalyzer is not installed for {engine.program}: scripts/make-powershell says how")
    *said, counted = ended.out.splitlines()
    assert (ended.code, counted, ended.err) == (0, f"{len(files)} files", ""), ended
    return said


def test_analyzer_finds_nothing(engine: Engine, tmp_path: Path) -> None:
    assert found(engine, tmp_path, everything()) == []


def test_analyzer_finds_planted_mistakes(engine: Engine, tmp_path: Path) -> None:
    files = {f"{name}.ps1": f"{text}\n".encode("ascii") for name, (text, _) in PLANTED.items()}

    said = found(engine, tmp_path, files)

    assert sorted(said) == sorted(f"{name}.ps1:1: {rule}" for name, (_, rule) in PLANTED.items())
