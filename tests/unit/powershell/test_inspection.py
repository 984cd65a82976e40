import random
from collections.abc import Mapping

import pytest

from rarms_iac.powershell.inspection.inspect import inspect, inspect_recorded
from rarms_iac.powershell.render import render_scripts
from tests.builders import codes
from tests.effort import examples
from tests.unit.powershell.mutations import AROUND_THE_PLAN, IN_THE_PLAN, Mutation
from tests.unit.powershell.plans import rendered_plan

SCRIPTS = {name: text.decode("ascii") for name, text in render_scripts(*rendered_plan()).items()}


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
            if not (inspect_recorded(data, "x.ps1") if recorded else inspect(data)):
                passed.append(f"{name}: {difference(script, mutant)}")
    return passed, tried


def difference(text: str, mutant: str) -> str:
    at = next((at for at, (old, new) in enumerate(zip(text, mutant, strict=False)) if old != new), len(text))
    return repr(mutant[max(0, at - 40) : at + 60])


@pytest.mark.parametrize("name", sorted(SCRIPTS))
def test_what_rarms_renders_passes(name: str) -> None:
    assert inspect(SCRIPTS[name].encode("ascii"), name) == ()
    assert inspect_recorded(SCRIPTS[name].encode("ascii"), name) == ()


def test_mutants_of_an_apply_script_are_caught() -> None:
    passed, tried = missed(IN_THE_PLAN | AROUND_THE_PLAN, SCRIPTS["onboard.ps1"])

    assert passed == []
    assert tried == IN_THE_PLAN.keys() | AROUND_THE_PLAN.keys()


def test_mutants_of_an_undo_script_are_caught() -> None:
    passed, tried = missed(AROUND_THE_PLAN, SCRIPTS["onboard.undo.ps1"])

    assert passed == []
    assert tried == AROUND_THE_PLAN.keys()


def of_another_version(script: str) -> str:
    """As another version of rarms may have made it: other facts, another switch, other fixed parts."""
    changes = {
        "        Run = '": "        Silence = 5; Run = '",
        "[switch] $Force)": "[switch] $Force, [switch] $Slowly)",
        "function Unlock-Host": "function Exit-HostOfOld",
        "# --- part journal:": "# --- part ledger:",
        "# --- end of the part journal ": "# --- end of the part ledger ",
    }
    for old, new in changes.items():
        assert old in script
        script = script.replace(old, new)
    return script


@pytest.mark.parametrize("name", sorted(SCRIPTS))
def test_a_script_of_another_version_passes_out_of_a_journal_only(name: str) -> None:
    script = of_another_version(SCRIPTS[name]).encode("ascii")

    assert inspect_recorded(script, name) == ()
    assert "RARMS202" in codes(inspect(script, name))


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
        ("(Get-PendingName -Name ", "(Remove-DiskFile -Path "),
        ("Guard = { Assert-VmHost }", "Guard = { Write-Mark }"),
        ("Guard = { Assert-VmHost }", "Guard = 'x'"),
    ],
)
def test_a_call_that_rarms_does_not_write_there_is_caught(old: str, new: str) -> None:
    script = SCRIPTS["onboard.ps1"]
    assert old in script

    edited = script.replace(old, new, 1).encode("ascii")

    assert inspect(edited) != ()
    assert codes(inspect_recorded(edited, "x.ps1")) == ["RARMS211"]


HEAD_OF_THE_RUNTIME = "\r\nSet-StrictMode -Version 3.0\r\n"
LAST = "\r\nInvoke-Run -Steps { Add-Plan }\r\n"


@pytest.mark.parametrize("script", [SCRIPTS["onboard.ps1"], of_another_version(SCRIPTS["onboard.ps1"])])
@pytest.mark.parametrize(
    ("old", "new"),
    [
        (HEAD_OF_THE_RUNTIME, "\r\nRemove-Item C:\\ -Recurse -Force\r\nSet-StrictMode -Version 3.0\r\n"),
        (HEAD_OF_THE_RUNTIME, "\r\n$PSDefaultParameterValues = @{ '*:Force' = $true }\r\n"),
        (HEAD_OF_THE_RUNTIME, "\r\n$script:PSDefaultParameterValues = $script:Plan\r\n"),
        (HEAD_OF_THE_RUNTIME, "\r\n$env:PSModulePath = 'C:\\x'\r\n"),
        (HEAD_OF_THE_RUNTIME, "\r\n$script:Steps = Restart-Computer\r\n"),
        (HEAD_OF_THE_RUNTIME, "\r\n$script:Steps = 'x' > 'C:\\x'\r\n"),
        (HEAD_OF_THE_RUNTIME, "\r\n$script:Steps = [System.IO.StreamWriter] 'C:\\x'\r\n"),
        (HEAD_OF_THE_RUNTIME, "\r\n$script:Steps = $ErrorActionPreference = 'Continue'\r\n"),
        (HEAD_OF_THE_RUNTIME, "\r\nfunction script:Add-Plan { Restart-Computer }\r\n"),
        (HEAD_OF_THE_RUNTIME, "\r\ntrap { Restart-Computer }\r\n"),
        (HEAD_OF_THE_RUNTIME, "\r\n#Requires -Modules Evil\r\nSet-StrictMode -Version 3.0\r\n"),
        (LAST, f"{LAST}Invoke-Expression 'Restart-Computer'\r\n"),
        (LAST, "\r\n#Requires -Modules Evil\r\nInvoke-Run -Steps { Add-Plan }\r\n"),
        (LAST, "\r\nInvoke-Run -Steps { Add-Plan; Restart-Computer }\r\n"),
        (LAST, "\r\nInvoke-Run -Steps { Add-Plan } | Restart-Computer\r\n"),
        (LAST, "\r\n# nothing is called\r\n"),
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

    assert inspect_recorded(script.encode("ascii"), "x.ps1") == ()
    assert inspect_recorded(edited, "x.ps1") != ()
