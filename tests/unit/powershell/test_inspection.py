import random
import re
from collections.abc import Mapping

import pytest

from rarms_iac.powershell.inspection.inspect import inspect, inspect_recorded
from rarms_iac.powershell.render import render_scripts
from rarms_iac.powershell.templates import ScriptForm, module_digest, shipped_module
from tests.builders import codes
from tests.effort import examples
from tests.unit.powershell.mutations import AROUND_THE_PLAN, IN_THE_PLAN, Mutation
from tests.unit.powershell.plans import rendered_plan

SCRIPTS = {name: text.decode("ascii") for name, text in render_scripts(*rendered_plan()).items()}
SINGLE = {name: text.decode("ascii") for name, text in render_scripts(*rendered_plan(), form=ScriptForm.SINGLE).items()}
MODULE = shipped_module()


def module_of(script: str) -> Mapping[str, str]:
    """What a journal holds beside this script."""
    return {} if "New-Module" in script else MODULE


def missed(operators: Mapping[str, Mutation], script: str, *, recorded: bool = False) -> tuple[list[str], set[str]]:
    """The mutants that pass the inspection, and the operators that had a place to change."""
    pick = random.Random(5)
    passed: list[str] = []
    tried: set[str] = set()
    for name, operator in operators.items():
        for _ in range(examples(1)):
            mutant = operator(script, pick)
            if mutant is None or mutant == script:
                continue
            tried.add(name)
            data = mutant.encode("utf-8")
            if not (inspect_recorded(data, "x.ps1", module_of(mutant)) if recorded else inspect(data)):
                passed.append(f"{name}: {difference(script, mutant)}")
    return passed, tried


def difference(text: str, mutant: str) -> str:
    at = next((at for at, (old, new) in enumerate(zip(text, mutant, strict=False)) if old != new), len(text))
    return repr(mutant[max(0, at - 40) : at + 60])


@pytest.mark.parametrize("scripts", [SCRIPTS, SINGLE], ids=["module", "single"])
@pytest.mark.parametrize("name", sorted(SCRIPTS))
def test_what_rarms_renders_passes(name: str, scripts: Mapping[str, str]) -> None:
    assert inspect(scripts[name].encode("ascii"), name) == ()
    assert inspect_recorded(scripts[name].encode("ascii"), name, module_of(scripts[name])) == ()


@pytest.mark.parametrize("scripts", [SCRIPTS, SINGLE], ids=["module", "single"])
def test_mutants_of_an_apply_script_are_caught(scripts: Mapping[str, str]) -> None:
    passed, tried = missed(IN_THE_PLAN | AROUND_THE_PLAN, scripts["onboard.ps1"])

    assert passed == []
    assert tried == IN_THE_PLAN.keys() | AROUND_THE_PLAN.keys()


@pytest.mark.parametrize(
    "change", [("Guest = ''", "Guest = 'x'"), ("Percent = ", "Share = "), ("Run = 'apply'", "Run = 'undo'")]
)
def test_a_script_with_the_facts_of_another_kind_is_caught(change: tuple[str, str]) -> None:
    edited = SCRIPTS["onboard.ps1"].replace(*change).encode("ascii")

    assert codes(inspect(edited)) == ["RARMS211"]


def test_mutants_of_an_undo_script_are_caught() -> None:
    passed, tried = missed(AROUND_THE_PLAN, SCRIPTS["onboard.undo.ps1"])

    assert passed == []
    assert tried == AROUND_THE_PLAN.keys()


def of_another_version(script: str) -> str:
    """As another version of rarms may have made it: other facts, another switch, another module and way to find it."""
    changes = {
        "        Run = '": "        Silence = 5; Run = '",
        "[switch] $Test)": "[switch] $Test, [switch] $Slowly)",
        "rarms 0.1.0": "rarms 0.2.0",
        "\r\n$folder = ": "\r\n$warning = $null\r\n$folder = ",
        "function Unlock-Host": "function Exit-HostOfOld",
    }
    for old, new in changes.items():
        assert old in script or old.startswith("function")
        script = script.replace(old, new)
    _, held, module = script.partition("-ScriptBlock {\r\n")
    digest = module_digest(module.partition("\r\nExport-ModuleMember")[0])
    return re.sub("SHA-256 [0-9A-F]{64}\r\n", f"SHA-256 {digest}\r\n", script) if held else script


@pytest.mark.parametrize("scripts", [SCRIPTS, SINGLE], ids=["module", "single"])
@pytest.mark.parametrize("name", sorted(SCRIPTS))
def test_a_script_of_another_version_passes_out_of_a_journal_only(name: str, scripts: Mapping[str, str]) -> None:
    script = of_another_version(scripts[name])

    assert inspect_recorded(script.encode("ascii"), name, module_of(script)) == ()
    assert "RARMS202" in codes(inspect(script.encode("ascii"), name))


@pytest.mark.parametrize(
    "module",
    [
        {},
        {"Rarms.psd1": MODULE["Rarms.psd1"]},
        {**MODULE, "Rarms.psm1": MODULE["Rarms.psm1"].replace("Stop-Run", "Stop-Ran", 1)},
        {**MODULE, "Rarms.psm1": MODULE["Rarms.psm1"] + "\u2028"},
        {**MODULE, "More.psm1": ""},
    ],
    ids=["none", "half", "edited", "strange", "more"],
)
def test_a_module_that_its_script_does_not_name_is_caught(module: Mapping[str, str]) -> None:
    script = of_another_version(SCRIPTS["onboard.ps1"]).encode("ascii")

    assert codes(inspect_recorded(script, "onboard.ps1", module)) == ["RARMS202"]


def test_a_script_that_holds_its_module_names_it_and_has_none_beside_it() -> None:
    script = SINGLE["onboard.ps1"].encode("ascii")
    edited = script.replace(b"function Unlock-Host", b"function Exit-HostOfOld")

    assert codes(inspect_recorded(script, "onboard.ps1", MODULE)) == ["RARMS202"]
    assert codes(inspect_recorded(edited, "onboard.ps1")) == ["RARMS202"]


def test_a_script_without_a_module_is_caught_out_of_a_journal() -> None:
    script = SCRIPTS["onboard.ps1"].replace("#endregion", "# ends here").encode("ascii")

    assert inspect_recorded(script, "onboard.ps1", MODULE) != ()


def test_mutants_of_the_plan_in_a_script_of_another_version_are_caught() -> None:
    passed, tried = missed(IN_THE_PLAN, of_another_version(SCRIPTS["onboard.ps1"]), recorded=True)

    assert passed == []
    assert tried == IN_THE_PLAN.keys()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("Hyper-V\\Remove-VM -VM $script:Vm -Force", "Hyper-V\\Remove-VM -Force 'vision'"),
        ("Hyper-V\\Remove-VM -VM $script:Vm -Force", "Hyper-V\\Remove-VM -VM 'vision' -Force"),
        ("Hyper-V\\Remove-VM -VM $script:Vm -Force", "Hyper-V\\Remove-VM -VM $script:Vm -Force:$true"),
        ("Hyper-V\\Remove-VM -VM $script:Vm -Force", "Hyper-V\\Remove-VM -VM $script:Vm -ComputerName 'x' -Force"),
        ("Hyper-V\\Start-VM -VM $script:Vm", "Hyper-V\\Start-VM -VM $script:Vm -VM $script:Vm"),
        ("Hyper-V\\Start-VM -VM $script:Vm", "Hyper-V\\Stop-VM -VM $script:Vm"),
        ("Hyper-V\\Start-VM -VM $script:Vm", "Get-PartitionReading -Machine 'x'"),
        ("(Hyper-V\\Get-VMHardDiskDrive -VM $script:Vm)", "(Remove-DiskFile -Path 'x')"),
        ("Guest = ''", "Guest = ''; Guard = { Write-Mark }"),
    ],
)
def test_a_call_that_rarms_does_not_write_there_is_caught(old: str, new: str) -> None:
    script = SCRIPTS["onboard.ps1"]
    assert old in script

    edited = script.replace(old, new, 1).encode("ascii")

    assert inspect(edited) != ()
    assert codes(inspect_recorded(edited, "x.ps1", MODULE)) == ["RARMS211"]


SETTINGS = "\r\nSet-StrictMode -Version 3.0\r\n"
LAST = "\r\n& $invoke -Run $run\r\nexit $code\r\n"


@pytest.mark.parametrize("script", [SCRIPTS["onboard.ps1"], of_another_version(SCRIPTS["onboard.ps1"])])
@pytest.mark.parametrize(
    ("old", "new"),
    [
        (SETTINGS, "\r\nRemove-Item C:\\ -Recurse -Force\r\nSet-StrictMode -Version 3.0\r\n"),
        (SETTINGS, "\r\n$PSDefaultParameterValues = @{ '*:Force' = $true }\r\n"),
        (SETTINGS, "\r\n$script:PSDefaultParameterValues = $script:Plan\r\n"),
        (SETTINGS, "\r\n$env:PSModulePath = 'C:\\x'\r\n"),
        (SETTINGS, "\r\n$script:Steps = Restart-Computer\r\n"),
        (SETTINGS, "\r\n$script:Steps = 'x' > 'C:\\x'\r\n"),
        (SETTINGS, "\r\n$script:Steps = [System.IO.StreamWriter] 'C:\\x'\r\n"),
        (SETTINGS, "\r\n$script:Steps = $ErrorActionPreference = 'Continue'\r\n"),
        (SETTINGS, "\r\nfunction script:Set-StrictMode { Restart-Computer }\r\n"),
        (SETTINGS, "\r\ntrap { Restart-Computer }\r\n"),
        (SETTINGS, "\r\n#Requires -Modules Evil\r\nSet-StrictMode -Version 3.0\r\n"),
        (LAST, f"{LAST}Invoke-Expression 'Restart-Computer'\r\n"),
        (LAST, f"\r\n#Requires -Modules Evil{LAST}"),
        (LAST, "\r\n& $invoke -Run (Restart-Computer)\r\nexit $code\r\n"),
        (LAST, "\r\n& $invoke -Run $run | Restart-Computer\r\nexit $code\r\n"),
        (LAST, "\r\n# nothing is called\r\n"),
        ("\r\n}\r\n#region", "\r\n}, (Restart-Computer)\r\n#region"),
        ("\r\n#endregion\r\n", "\r\nif ($true) {\r\n#endregion\r\n}\r\n"),
        ("[int] $LockTimeout =", "[int] $LockTimeout = $(Restart-Computer) +"),
        ("[int] $LockTimeout =", "[ValidateScript({ Restart-Computer })] [int] $LockTimeout ="),
        ("[int] $LockTimeout = 0", "[System.IO.StreamWriter] $LockTimeout = 'x'"),
        ("#Requires -Version 5.1\r\n", "#Requires -Version 5.1\r\n#Requires -Modules Evil\r\n"),
        ("#Requires -Version 5.1\r\n", "#Requires -Version 5.1\r\nRestart-Computer\r\n"),
    ],
)
def test_what_runs_beside_the_plan_is_caught_also_out_of_a_journal(script: str, old: str, new: str) -> None:
    assert script.count(old) == 1

    edited = script.replace(old, new).encode("ascii")

    assert inspect_recorded(script.encode("ascii"), "x.ps1", MODULE) == ()
    assert inspect_recorded(edited, "x.ps1", MODULE) != ()
