"""Cmdlets of the real PowerShell ask the model: they bind as Hyper-V's do, and their objects follow it."""

import pytest

from tests.fake_powershell.cells import a_stranger, a_windows
from tests.fake_powershell.host import WindowsHost
from tests.fake_powershell.run import Ran, put
from tests.real_powershell.runner import RealPowerShell

pytestmark = pytest.mark.needs("powershell-windows", "wine")


def ran(real: RealPowerShell, host: WindowsHost, *statements: str) -> Ran:
    put(host, {"x.ps1": "\r\n".join(["$ErrorActionPreference = 'Stop'", *statements]).encode("ascii")})
    return real.run(host, "x.ps1", as_json=False)


def test_objects_follow_the_machine(real: RealPowerShell) -> None:
    host = a_windows(a_stranger("backup"))

    told = ran(
        real,
        host,
        "$vm = @(Hyper-V\\Get-VM)[0]",
        "$cpu = Hyper-V\\Get-VMProcessor -VM $vm",
        "Hyper-V\\Set-VM -VM $vm -Notes 'new'",
        "$vm | Hyper-V\\Set-VMProcessor -Reserve 7",
        "'{0} {1} {2}' -f $vm.Name, $vm.Notes, $cpu.Reserve",
        "$vm.Id.GetType().FullName + ' ' + $cpu.Reserve.GetType().FullName",
    )

    assert told.lines == ("backup new 7", "System.Guid System.Int64"), told.says
    assert host.machine("backup").notes == "new"


def test_entries_are_written_to_the_event_log_of_windows(real: RealPowerShell) -> None:
    """.NET writes an entry after it has made the source known in the registry."""
    host = a_windows()
    source = "SYSTEM\\CurrentControlSet\\Services\\EventLog\\Application\\rarms"

    told = ran(
        real,
        host,
        f"[Microsoft.Win32.Registry]::LocalMachine.DeleteSubKeyTree('{source}', $false)",
        "[System.Diagnostics.EventLog]::WriteEntry('rarms', 'an entry', 'Warning', 3)",
        f"$null -ne [Microsoft.Win32.Registry]::LocalMachine.OpenSubKey('{source}')",
    )

    assert (told.lines, host.event_log) == (("True",), [("Warning", 3, "an entry")]), told.says


@pytest.mark.parametrize(
    ("call", "error"),
    [
        ("Hyper-V\\Get-VM -Name 'a' -Id '00000000-0000-4000-8000-000000000000'", "AmbiguousParameterSet"),
        ("Hyper-V\\Get-VM -Nam 'a' -Nonsense 1", "NamedParameterNotFound"),
        ("Hyper-V\\Set-VM -VM 'backup' -Notes 'x'", "CannotConvertArgumentNoMessage"),
        ("Hyper-V\\Set-VM -VM @(Hyper-V\\Get-VM)[0] -AutomaticStartAction 'Never'", "ParameterArgumentValidationError"),
        ("Hyper-V\\Get-VM -Id '00000000-0000-4000-8000-000000000000'", "InvalidParameter"),
    ],
)
def test_wrong_call_is_refused_as_hyperv_refuses_it(real: RealPowerShell, call: str, error: str) -> None:
    host = a_windows(a_stranger("backup"))

    told = ran(real, host, f"try {{ {call} }} catch {{ $_.FullyQualifiedErrorId }}")

    assert (told.code, host.effects) == (0, []), told.says
    assert told.lines[-1].startswith(f"{error},Microsoft.HyperV.PowerShell.Commands."), told.says


def test_preview_of_a_cmdlet_changes_nothing(real: RealPowerShell) -> None:
    host = a_windows(a_stranger("backup"))

    told = ran(real, host, "@(Hyper-V\\Get-VM)[0] | Hyper-V\\Set-VMProcessor -Reserve 7 -WhatIf")

    assert told.lines[0].startswith("What if: "), told.says
    assert host.effects == []


def test_job_of_a_script_asks_the_same_model(real: RealPowerShell) -> None:
    host = a_windows(a_stranger("backup"))

    told = ran(
        real,
        host,
        "$job = Start-Job -ScriptBlock { @(Hyper-V\\Get-VM)[0] | Hyper-V\\Set-VM -Notes 'by a job'; 'done' }",
        "$job | Wait-Job | Receive-Job",
        "$job | Remove-Job",
        "@(Hyper-V\\Get-VM)[0].Notes",
    )

    assert told.lines == ("done", "by a job"), told.says


def test_killed_script_leaves_what_it_wrote(real: RealPowerShell) -> None:
    host = a_windows(kill_after=1)

    told = ran(
        real,
        host,
        "$stream = [System.IO.FileStream]::new('C:\\run\\a.txt', 'OpenOrCreate', 'Write', 'None')",
        "try { $stream.Write([byte[]] @(65), 0, 1); $stream.Write([byte[]] @(66), 0, 1) }",
        "finally { [System.IO.File]::Delete('C:\\run\\a.txt') }",
    )

    assert told.code is None
    assert host.effects == ["open C:\\run\\a.txt", "write C:\\run\\a.txt"]
    assert host.data("C:\\run\\a.txt") == b"A"
    assert ran(real, host.copy(), "[System.IO.File]::Delete('C:\\run\\a.txt')").code == 0
