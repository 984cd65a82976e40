"""The Windows of this computer: `LocalWindows` with wmi, winreg and pywin32, which only Windows has."""

import ctypes
import json
import msvcrt
import os
import re
import sys
import warnings
import winreg
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pywintypes
import win32api
import win32cred
import win32crypt
import win32cryptcon
import win32evtlog
import win32security
import winerror

from rarms_iac.providers.hyperv.observation import MAX_BYTES
from rarms_iac.providers.hyperv.transport import protect
from rarms_iac.providers.hyperv.wmi_document import QUERIES, NotRead, RegistryKey, WmiInstance, local_document
from rarms_iac.storage.reading import open_regular, open_shared, read_open
from rarms_iac.texts.messages import reason_of

assert sys.platform == "win32"

with warnings.catch_warnings():
    # Its texts hold what Python 3.12 warns of where it compiles them first.
    warnings.simplefilter("ignore", SyntaxWarning)
    import wmi

ACCESS_DENIED, NO_NAMESPACE = 0x80041003, 0x8004100E
EXPLANATIONS = {
    ACCESS_DENIED: "only Administrators and Hyper-V Administrators may read this from WMI",
    NO_NAMESPACE: "this Windows does not have the WMI namespace: the role Hyper-V is not installed",
}
OWNER = "owner.txt"  # of `templates/powershell/Rarms/Rarms.psm1`: open while a run holds the computer
ADMINISTRATORS_ONLY = "O:BAG:SYD:P(A;OICI;FA;;;BA)(A;OICI;FA;;;SY)"
"""As `templates/powershell/Rarms/Rarms.psm1` has it."""
HYPERV_ADMINISTRATORS = "S-1-5-32-578"
EVENT = "*[System[Provider[@Name='Microsoft-Windows-Hyper-V-Hypervisor'] and EventID=2]]"
KINDS = {
    winreg.REG_SZ: "String",
    winreg.REG_EXPAND_SZ: "ExpandString",
    winreg.REG_BINARY: "Binary",
    winreg.REG_DWORD: "DWord",
    winreg.REG_MULTI_SZ: "MultiString",
    winreg.REG_QWORD: "QWord",
    winreg.REG_NONE: "None",
}


def observe_here() -> str:
    """Return the output of `observe.ps1` here, a line of JSON, without starting PowerShell."""
    return json.dumps(local_document(ThisWindows()), separators=(",", ":"))


class ThisWindows:
    """The Windows that rarms runs on. Each class of WMI is listed once."""

    def __init__(self) -> None:
        self.instances = cache(self._instances)

    def computer(self) -> str:
        return str(win32api.GetComputerName())

    def bits(self) -> int:
        return 8 * ctypes.sizeof(ctypes.c_void_p)

    def _instances(self, name: str) -> list[WmiInstance]:
        found = self._asked(namespace_of(name), lambda connection: connection.query(f"SELECT * FROM {name}"))  # noqa: S608 - a name of ours
        return [{known: _raw_value(each, known) for known in QUERIES[name]} for each in found]

    def disk(self, path: str) -> WmiInstance:
        """Read the service's answer, which is an instance as XML."""

        def ask(connection: Any) -> str:
            (service,) = connection.query("SELECT * FROM Msvm_ImageManagementService")
            texts = [given for given in service.GetVirtualHardDiskSettingData(Path=path) if "<INSTANCE" in str(given)]
            if not texts:
                raise NotRead("NotFound", f"Hyper-V does not report {path}")
            return str(texts[0])

        text = self._asked(namespace_of("Msvm_"), ask)
        values = {each.get("NAME"): each.findtext("VALUE") for each in ET.fromstring(text).iter("PROPERTY")}  # noqa: S314 - Hyper-V's own
        return {name: values.get(name) for name in QUERIES["Msvm_VirtualHardDiskSettingData"]}

    def _asked(self, namespace: str, ask: Any) -> Any:
        try:
            return ask(wmi.WMI(namespace=namespace, find_classes=False))
        except (wmi.x_wmi, pywintypes.com_error) as problem:
            # The module wraps what a call raises; a query fails while it is listed, which it does not.
            error = problem.com_error if isinstance(problem, wmi.x_wmi) else problem
            code = _code_of(error)
            message = EXPLANATIONS.get(code, reason_of(error))
            raise NotRead(f"0x{code:08x}", f"{message} ({namespace})", denied=code == ACCESS_DENIED) from problem

    def key(self, path: str, *, of_user: bool = False) -> RegistryKey:
        root = winreg.HKEY_CURRENT_USER if of_user else winreg.HKEY_LOCAL_MACHINE
        try:
            with winreg.OpenKey(root, path, access=winreg.KEY_READ | winreg.KEY_WOW64_64KEY) as opened:
                keys, values, _ = winreg.QueryInfoKey(opened)
                found = [winreg.EnumValue(opened, at) for at in range(values)]
                return RegistryKey(
                    values=[_value(*value) for value in found],
                    keys=[winreg.EnumKey(opened, at) for at in range(keys)],
                )
        except OSError as problem:
            raise _not_read(problem, path) from problem

    def is_elevated(self) -> bool:
        """Ask the token: in one that User Account Control filtered, the group only denies."""
        administrators = win32security.CreateWellKnownSid(win32security.WinBuiltinAdministratorsSid, None)
        return bool(win32security.CheckTokenMembership(None, administrators))

    def is_hyperv_administrator(self) -> bool:
        """Return false in a token of a logon before the account joined the group."""
        members = win32security.ConvertStringSidToSid(HYPERV_ADMINISTRATORS)
        return bool(win32security.CheckTokenMembership(None, members))

    def scheduler(self) -> int:
        try:
            newest = win32evtlog.EvtQueryReverseDirection | win32evtlog.EvtQueryChannelPath
            events = win32evtlog.EvtNext(win32evtlog.EvtQuery("System", newest, EVENT), 1)
        except pywintypes.error as problem:
            denied = problem.winerror == 5
            raise NotRead(f"Win32Error{problem.winerror}", reason_of(problem), denied=denied) from problem
        text = win32evtlog.EvtRender(events[0], win32evtlog.EvtRenderEventXml) if events else ""
        data = re.search(r"<Data[^>]*>(0[xX][0-9A-Fa-f]+|[0-9]+)</Data>", text)
        if data is None:
            raise NotRead("NoMatchingEventsFound", "the event log no longer has event 2 of the hypervisor")
        return int(data[1], 0)

    def journal(self) -> tuple[str, str]:
        """Return its owner and its text, both of the same file: a run that begins replaces it."""
        path = own_folder() / "journal.jsonl"
        try:
            with open_regular(path) as file:
                handle = msvcrt.get_osfhandle(file.fileno())
                owned = win32security.GetSecurityInfo(
                    handle, win32security.SE_FILE_OBJECT, win32security.OWNER_SECURITY_INFORMATION
                )
                owner = win32security.ConvertSidToStringSid(owned.GetSecurityDescriptorOwner())
                return owner, read_open(file, path, MAX_BYTES).decode("ascii", "replace")
        except (OSError, pywintypes.error) as problem:
            raise _not_read(problem, str(path)) from problem

    def is_script_running(self) -> bool:
        """Return whether a run has the script's file open: it shares the file for reading only."""
        path = own_folder() / OWNER
        try:
            os.close(open_shared(path, to_write=True))
        except FileNotFoundError:
            return False
        except OSError as problem:
            if problem.winerror == winerror.ERROR_SHARING_VIOLATION:
                return True
            raise _not_read(problem, str(path)) from problem
        return False

    def modules(self) -> list[str]:
        """Return those that come with Windows."""
        system = Path(os.environ.get("SYSTEMROOT", r"C:\Windows")) / "System32"
        found = (system / "WindowsPowerShell" / "v1.0" / "Modules" / "Hyper-V").glob("*/Hyper-V.psd1")
        return sorted((manifest.parent.name for manifest in found), reverse=True)


def own_folder() -> Path:
    """Return the folder in which scripts keep what they know of this computer."""
    return Path(os.environ.get("PROGRAMDATA", r"C:\ProgramData")) / "rarms"


@contextmanager
def credential_files(names: Iterable[str]) -> Iterator[None]:
    """Let scripts read these Credential Manager entries meanwhile: encrypted, for this account alone.

    Args:
        names: as the manifest has them; each is a generic credential (`cmdkey /generic:NAME`). A file that an operator
            made for scripts counts before it, and stays; so does a name that Credential Manager does not have.
    """
    folder = own_folder() / "credentials"
    made: list[Path] = []
    try:
        for name in sorted(set(names)):
            path = folder / f"{name.replace('/', '_')}.txt"
            found = None if path.exists() else _stored_credential(name)
            if found is not None:
                made.append(path)
                _write_credential(path, *found)
        yield
    finally:
        for path in made:
            path.unlink(missing_ok=True)


def _stored_credential(name: str) -> tuple[str, bytes] | None:
    """Return user and password, the latter as Windows keeps it: UTF-16."""
    try:
        found = win32cred.CredRead(name, win32cred.CRED_TYPE_GENERIC)
    except pywintypes.error as problem:
        if problem.winerror == winerror.ERROR_NOT_FOUND:
            return None
        raise
    return str(found["UserName"]), bytes(found["CredentialBlob"])


def _write_credential(path: Path, user: str, password: bytes) -> None:
    """Write it as ConvertFrom-SecureString does: hexadecimal of what only this account on this computer can decrypt."""
    for folder in (own_folder(), path.parent):
        if not folder.exists():
            folder.mkdir()
            protect(str(folder), ADMINISTRATORS_ONLY)
    path.touch(exist_ok=False)
    protect(str(path), ADMINISTRATORS_ONLY)
    secret = win32crypt.CryptProtectData(password, None, None, None, None, win32cryptcon.CRYPTPROTECT_UI_FORBIDDEN)
    path.write_text(f"{user}\n{secret.hex()}\n", encoding="utf-8", newline="\r\n")


def namespace_of(name: str) -> str:
    """Return the namespace of a class."""
    if name.startswith("Msvm_"):
        return r"root\virtualization\v2"
    if name.startswith("MSCluster_"):
        return r"root\MSCluster"
    return r"root\cimv2"


def _raw_value(instance: Any, name: str) -> Any:
    """Return a property as WMI has it; the module would open what a reference leads to, one connection each."""
    known = {each.lower(): each for each in instance.properties}
    found = instance.ole_object.Properties_(known[name.lower()]).Value if name.lower() in known else None
    inside = getattr(found, "Properties_", None)  # of an instance that lies in the property
    return found if inside is None else {each.Name: each.Value for each in inside}


def _code_of(error: Any) -> int:
    """Return WMI's own code: the one in the message for scripts, or the error itself if no connection was made."""
    inner = (getattr(error, "excepinfo", None) or (0,))[-1]
    return int(inner or getattr(error, "hresult", 0) or 0) % 2**32


def _value(name: str, data: Any, kind: int) -> tuple[str, str, int | str]:
    """Return a value as PowerShell reads it: numbers without sign, everything else as text."""
    match data:
        case int() if kind in (winreg.REG_DWORD, winreg.REG_QWORD):
            return name, KINDS[kind], data
        case str() if kind == winreg.REG_EXPAND_SZ:
            return name, KINDS[kind], winreg.ExpandEnvironmentStrings(data)
        case bytes():
            return name, KINDS.get(kind, "Unknown"), " ".join(map(str, data))
        case list():
            return name, KINDS[kind], " ".join(map(str, data))
        case _:
            return name, KINDS.get(kind, "Unknown"), "" if data is None else str(data)


def _not_read(problem: Any, path: str) -> NotRead:
    code = getattr(problem, "winerror", None)
    if code == winerror.ERROR_ACCESS_DENIED:
        return NotRead("UnauthorizedAccess", f"{path} may not be read", denied=True)
    if code in {winerror.ERROR_FILE_NOT_FOUND, winerror.ERROR_PATH_NOT_FOUND}:
        return NotRead("PathNotFound", f"{path} does not exist")
    return NotRead(f"Win32Error{code}", f"{path}: {reason_of(problem)}")
