import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.needs import CHECKOUT, SHARED
from tests.powershell_lint import cmdlets


def said(name: str, *given: str, positional: int = 0, piped: bool = False) -> list[str]:
    called = cmdlets.cmdlet(name)
    assert called
    return [problem.message for problem in cmdlets.problems_of_call(called, given, positional=positional, piped=piped)]


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("Set-VMProcessor", ["VM", "Reserve", "Maximum", "RelativeWeight"]),
        ("New-VM", ["Name", "Generation", "MemoryStartupBytes", "NoVHD", "SwitchName"]),
        ("New-VHD", ["Path", "ParentPath", "Differencing"]),
        ("Get-VM", []),
        ("Get-VM", ["Id", "ErrorAction"]),
        ("New-ItemProperty", ["LiteralPath", "Name", "PropertyType", "Value"]),
    ],
)
def test_calls_that_bind(name: str, given: list[str]) -> None:
    assert said(name, *given) == []


@pytest.mark.parametrize(
    ("name", "given", "problem"),
    [
        ("Set-VMProcessor", ["VM", "Reserv"], "-Reserv is an abbreviation"),
        ("Set-VM", ["VM", "Automatic"], "-Automatic is an abbreviation"),
        ("Set-VMProcessor", ["VM", "Foo"], "Set-VMProcessor has no parameter -Foo"),
        ("Set-VMProcessor", ["VM", "VMName"], "Set-VMProcessor has no parameter set for -VM, -VMName"),
        ("Set-VMProcessor", ["Reserve"], "Set-VMProcessor has no parameter set for -Reserve"),
        ("Set-VMProcessor", ["VM", "reserve"], "-reserve is written -Reserve"),
        ("Set-VMProcessor", ["VM", "cf"], "-cf is an alias"),
        ("Set-VMProcessor", ["VM", "VM"], "-vm is given twice"),
        ("Get-VM", ["VMName"], "-VMName is an alias"),
        ("Get-Item", ["LiteralPath", "UseTransaction"], "-UseTransaction of Get-Item does not exist in PowerShell 7"),
        ("ConvertTo-Json", ["InputObject", "AsArray"], "ConvertTo-Json has no parameter -AsArray"),
        ("New-Item", ["LiteralPath"], "New-Item has no parameter -LiteralPath"),
    ],
)
def test_calls_that_do_not_bind(name: str, given: list[str], problem: str) -> None:
    assert said(name, *given) == [problem]


def test_values_have_names_and_input_comes_by_pipeline() -> None:
    assert said("Get-VM", positional=1) == ["Get-VM is given a value without a name"]
    assert said("Select-Object", "First") == []
    assert said("ConvertTo-Json", "Depth") == ["ConvertTo-Json has no parameter set for -Depth"]
    assert said("ConvertTo-Json", "Depth", piped=True) == []


def test_accepted_values_and_switches() -> None:
    called = cmdlets.cmdlet("Set-VM")
    assert called
    action, notes = called.parameter("AutomaticStartAction"), called.parameter("Notes")
    assert action
    assert notes
    assert action.accepted == ("Nothing", "StartIfRunning", "Start")
    assert (called.should_process, notes.is_switch, notes.type) == (True, False, "String")


@pytest.mark.needs("shared")
def test_the_tables_are_what_their_script_makes(tmp_path: Path) -> None:
    room = CHECKOUT / "tests/powershell_lint"
    copy, made = tmp_path / "make_tables.py", tmp_path / "tables/cmdlets.json"
    made.parent.mkdir()
    copy.write_bytes((room / "make_tables.py").read_bytes())
    subprocess.run([sys.executable, copy, SHARED / "hyperv/cmdlets.json"], check=True)

    committed = room / "tables/cmdlets.json"
    assert made.read_bytes() == committed.read_bytes()
    assert len(json.loads(committed.read_text(encoding="utf-8"))) == len(cmdlets._tables())
