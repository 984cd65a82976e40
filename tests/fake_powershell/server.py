"""What an operator types into PowerShell on the pages of docs: our scripts, and the commands that make a server a host.

A host lies in a file of the folder that is worked in (`powershell.save`); a guest's Windows in a folder of its own.
"""

from __future__ import annotations

import io
import json
import shlex
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path

from tests.fake_powershell import program as powershell
from tests.fake_powershell.host import Entry, WindowsHost
from tests.fake_powershell.observing import host_from

NO_NAMESPACE = ("HRESULT 0x8004100e,GetCimInstanceCommand", "ObjectNotFound", "Invalid namespace ")
NO_CMDLET = ("CommandNotFoundException", "ObjectNotFound", "The term is not recognized as the name of a cmdlet.")
CLASSES = ("ComputerSystem", "ProcessorSettingData", "KvpExchangeComponent", "ShutdownComponent")
CMDLETS = ("Get-VM", "Get-VMHost", "Get-VMHostNumaNode", "Get-VMSwitch")
GUEST = "HKLM:\\SOFTWARE\\Microsoft\\Virtual Machine\\Guest\\Parameters"


def a_bare_server(document: Path, *files: str) -> WindowsHost:
    """The server that was observed, as it was before the role was installed, without machines."""
    host = host_from(json.loads(document.read_bytes()), *files)
    host.vms.clear()
    host.cpu_groups, host.switches, host.module = [], [], []
    host.scheduler, host.hypervisor_running, host.counters = None, False, False
    host.refusals |= {f"Get-CimInstance Msvm_{name}": NO_NAMESPACE for name in CLASSES}
    host.refusals |= dict.fromkeys(CMDLETS, NO_CMDLET)
    return host


def a_guest(name: str) -> WindowsHost:
    """The Windows inside a machine of this name."""
    guest = WindowsHost(computer=name.upper())
    guest.add_key("HKLM:\\SOFTWARE\\Microsoft\\Windows NT\\CurrentVersion\\Multimedia\\SystemProfile\\Tasks")
    parameters = guest.add_key(GUEST).values
    for value, data in (("VirtualMachineName", name), ("VirtualMachineId", "8C0F5E9A-0000-4000-8000-000000000001")):
        parameters[value.lower()] = Entry(name=value, kind="String", data=data)
    return guest


def _install_role(host: WindowsHost) -> None:
    host.refusals.clear()
    host.module, host.scheduler, host.hypervisor_running, host.counters = ["2.0.0.0"], 3, True, True


def _keep_credential(host: WindowsHost) -> None:
    text = f"{host.guest_user}\r\n{host.guest_secret}\r\n"
    host.write_file("C:\\ProgramData\\rarms\\credentials\\cell_guests.txt", text.encode("ascii"))


def _nothing(host: WindowsHost) -> None:
    """Only what comes after it does something."""


FOLDER = "$env:ProgramData\\rarms\\credentials"
SECRET = "$guest.UserName, (ConvertFrom-SecureString $guest.Password)"
TYPED: dict[str, Callable[[WindowsHost], None]] = {
    f"New-Item -ItemType Directory -Path {FOLDER}": _nothing,
    "$guest = Get-Credential": _nothing,
    f"Set-Content -Path {FOLDER}\\cell_guests.txt -Value {SECRET}": _keep_credential,
    "Install-WindowsFeature -Name Hyper-V -IncludeManagementTools -Restart": _install_role,
    "New-VMSwitch -Name cell -SwitchType Internal": lambda host: host.switches.append("cell"),
    "New-VMSwitch -Name office -SwitchType Internal": lambda host: host.switches.append("office"),
}
"""What becomes of the host; any other command is a mistake of its page."""


def typed(command: str, guest: str = "") -> int:
    """The exit code of a command in the folder that is worked in, on its host or in that guest.

    Raises:
        KeyError: the command is none that a host or our scripts know.
    """
    folder = Path(f"guest-{guest}") if guest else Path()
    if guest and not folder.exists():
        folder.mkdir()
        powershell.save(folder, a_guest(guest))
    words, _, output = command.partition(" > ")
    program, *options = shlex.split(words.replace("\\", "/"))
    if program == "powershell":
        return _run(folder, options, output)
    host = powershell.load(folder)
    TYPED[command](host)
    powershell.save(folder, host)
    return 0


def _run(folder: Path, options: list[str], output: str) -> int:
    at = options.index("-File") + 1
    options[at] = str(Path(options[at]).absolute())
    printed = io.StringIO()
    with redirect_stdout(printed):
        code = powershell.main([str(folder.absolute()), *options])
    if output:
        Path(output).write_text(printed.getvalue(), encoding="utf-16")  # as `>` of Windows PowerShell does
    return code
