"""PowerShell's own cmdlets, on the fake's files and registry."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from tests.fake_powershell import guests, hyperv, modules, windows
from tests.fake_powershell.dotnet import AccessList
from tests.fake_powershell.host import ADMINISTRATORS, Entry, Interrupted, Key
from tests.fake_powershell.hyperv import refused
from tests.fake_powershell.scopes import Scope
from tests.fake_powershell.text import from_json, to_json
from tests.fake_powershell.values import (
    EMPTY,
    Enumerated,
    Long,
    Record,
    ScriptError,
    Table,
    Thing,
    Unsupported,
    Value,
    cannot_convert,
    number,
    text,
)

Given = Mapping[str, Value]


class RegistryKey(Thing):
    """What Get-Item gives of a key."""

    type_name = "Microsoft.Win32.RegistryKey"

    def __init__(self, key: Key) -> None:
        super().__init__(PSChildName=key.path.rpartition("\\")[2])
        self.key = key

    def do_getvaluenames(self) -> list[Value]:
        return [entry.name for entry in self.key.values.values()]

    def do_getvalue(self, name: Value) -> Value:
        found = self.key.values.get(text(name).lower())
        return _as_read(found) if found else None

    def do_getvaluekind(self, name: Value) -> Value:
        found = self.key.values.get(text(name).lower())
        if found is None:
            raise ScriptError("The specified registry key does not exist.", error_id="IOException")
        return Enumerated(found.kind)


def _as_read(entry: Entry) -> Value:
    match entry.kind:
        case "DWord":
            data = number(entry.data)
            return data - 2**32 if data >= 2**31 else data
        case "QWord":
            return Long(number(entry.data))
        case "Binary":
            return [int(word) for word in str(entry.data).split()]
        case _:
            return str(entry.data)


def _is_registry(path: str) -> bool:
    return path.upper().startswith("HKLM:\\")


def not_found(path: str, command: str) -> ScriptError:
    return ScriptError(
        f"Cannot find path '{path}' because it does not exist.",
        error_id=f"PathNotFound,Microsoft.PowerShell.Commands.{command}",
        category="ObjectNotFound",
        kind="System.Management.Automation.ItemNotFoundException",
    )


def test_path(scope: Scope, given: Given) -> bool:
    host, path = scope.session.host, text(given["literalpath"])
    return (host.key(path) if _is_registry(path) else host.file(path)) is not None


def get_item(scope: Scope, given: Given) -> Thing:
    host, path = scope.session.host, text(given["literalpath"])
    refused(scope.session.host, f"Get-Item {path}")
    if _is_registry(path):
        key = host.key(path)
        if key is None:
            raise not_found(path, "GetItemCommand")
        return RegistryKey(key)
    file = host.file(path)
    if file is None or _hides(scope, path.rpartition("\\")[0]):
        raise not_found(path, "GetItemCommand")
    return Record(FullName=file.path)


def get_child_item(scope: Scope, given: Given) -> list[Value]:
    host, path = scope.session.host, text(given["literalpath"])
    refused(scope.session.host, f"Get-ChildItem {path}")
    if not _is_registry(path):
        return _in_folder(scope, path)
    if host.key(path) is None:
        raise not_found(f"HKEY_LOCAL_MACHINE{path.removeprefix('HKLM:')}", "GetChildItemCommand")
    return [RegistryKey(key) for key in host.below(path)]


def _in_folder(scope: Scope, path: str) -> list[Value]:
    folder = scope.session.host.file(path)
    if folder is None:
        raise not_found(path, "GetChildItemCommand")
    if _hides(scope, path):
        raise ScriptError(
            f"Access to the path '{path}' is denied.",
            error_id="DirUnauthorizedAccessError,Microsoft.PowerShell.Commands.GetChildItemCommand",
            category="PermissionDenied",
        )
    inside = path.lower() + "\\"
    host = scope.session.host
    configurations = [vm.folder for vm in host.vms.values() if vm.folder.lower() == path.lower()]
    inner = [file.path for at, file in host.files.items() if at.startswith(inside)]
    return [Record(FullName=found) for found in [*inner, *configurations]]


def _hides(scope: Scope, folder: str) -> bool:
    """Whether the caller may not see what is in a folder."""
    file = scope.session.host.file(folder)
    return file is not None and file.protected and not scope.session.host.elevated


def _elevated(scope: Scope, path: str) -> None:
    if not scope.session.host.elevated:
        raise ScriptError(
            f"Requested registry access to {path} is not allowed.",
            error_id="PermissionDenied",
            category="PermissionDenied",
        )


def new_item(scope: Scope, given: Given) -> Value:
    host, path = scope.session.host, text(given["path"])
    if not _is_registry(path) or given.get("force"):
        raise Unsupported("New-Item of a file, or with -Force, which empties a key that is there")
    _elevated(scope, path)
    if host.key(path.rpartition("\\")[0]) is None:
        raise not_found(path, "NewItemCommand")
    if host.key(path):
        raise ScriptError("A key in this path already exists.", error_id="ResourceExists", category="ResourceExists")
    host.effect(f"New-Item {path}", lambda: host.add_key(path))
    return RegistryKey(host.registry.get(path.lower(), Key(path=path)))


def _value_name(given: Given) -> str:
    """No cmdlet takes the empty name of a key's own value; of its other name they do not agree what it means."""
    name = text(given["name"])
    if not name:
        raise ScriptError(
            "Cannot bind argument to parameter 'Name' because it is an empty string.",
            error_id="ParameterArgumentValidationErrorEmptyStringNotAllowed",
            category="InvalidData",
        )
    if name.lower() == "(default)":
        raise Unsupported("a cmdlet and the value (default)")
    return name


def new_item_property(scope: Scope, given: Given) -> Value:
    host, path, name = scope.session.host, text(given["literalpath"]), _value_name(given)
    _elevated(scope, path)
    key = host.key(path)
    if key is None:
        raise not_found(path, "NewItemPropertyCommand")
    if name.lower() in key.values and not given.get("force"):
        raise ScriptError("The property already exists.", error_id="IOException", category="WriteError")
    kept = key.values.get(name.lower())
    entry = Entry(name=kept.name if kept else name, kind=_kind(given), data=_as_written(given))
    host.effect(f"New-ItemProperty {path} {name}", lambda: key.values.__setitem__(name.lower(), entry))
    return Record()


_KINDS = {kind.lower(): kind for kind in ("DWord", "QWord", "String", "ExpandString", "MultiString", "Binary")}


def _kind(given: Given) -> str:
    kind = text(given["propertytype"]).lower()
    if kind not in _KINDS:
        raise cannot_convert(kind, "Microsoft.Win32.RegistryValueKind")
    return _KINDS[kind]


def _as_written(given: Given) -> int | str:
    """What is stored; a DWord is given without sign, as the registry's provider gives it back (windows.md 6.6)."""
    value = given["value"]
    match _kind(given):
        case "DWord":
            data = number(value)
            if not 0 <= data < 2**32:
                raise cannot_convert(value, "System.UInt32")
            return data
        case "String" | "ExpandString":
            return text(value)
        case other:
            raise Unsupported(f"a value of type {other}")


def remove_item_property(scope: Scope, given: Given) -> Value:
    host, path, name = scope.session.host, text(given["literalpath"]), _value_name(given)
    _elevated(scope, path)
    key = host.key(path)
    if key is None or name.lower() not in key.values:
        raise not_found(path, "RemoveItemPropertyCommand")
    host.effect(f"Remove-ItemProperty {path} {name}", lambda: key.values.pop(name.lower()))
    return EMPTY


def remove_item(scope: Scope, given: Given) -> Value:
    host, path = scope.session.host, text(given["literalpath"])
    if not _is_registry(path):
        file = host.file(path)
        if file is None or file.data is None:
            raise not_found(path, "RemoveItemCommand")
        if any(path.lower() == disk.lower() for vm in host.vms.values() for disk in vm.disks):
            raise AssertionError(f"the disk {path} of a machine is deleted")
        host.effect(f"Remove-Item {path}", lambda: host.files.pop(path.lower()))
        return EMPTY
    _elevated(scope, path)
    if host.key(path) is None:
        raise not_found(path, "RemoveItemCommand")
    if host.below(path):
        raise ScriptError(f"{path} has children and -Recurse was not given: nobody is there to answer the prompt")
    host.effect(f"Remove-Item {path}", lambda: host.registry.pop(path.lower()))
    return EMPTY


def convert_to_secure_string(scope: Scope, given: Given) -> Record:
    """What ConvertFrom-SecureString wrote for this user on this computer; `other` stands for anybody else's."""
    if given["string"] == "other":
        raise ScriptError("Error occurred during a cryptographic operation.", error_id="ImportSecureString")
    return Record(Secret=text(given["string"]))


def get_acl(scope: Scope, given: Given) -> AccessList:
    path = text(given["literalpath"])
    file = scope.session.host.file(path)
    if file is None:
        raise not_found(path, "GetAclCommand")
    return AccessList(file)


def set_acl(scope: Scope, given: Given) -> Value:
    host, path, acl = scope.session.host, text(given["literalpath"]), given["aclobject"]
    file = host.file(path)
    if file is None or not isinstance(acl, AccessList):
        raise not_found(path, "SetAclCommand")
    if not re.fullmatch(r"O:BAG:SYD:P\(A;(OICI)?;FA;;;BA\)\(A;(OICI)?;FA;;;SY\)", acl.sddl):
        raise Unsupported(f"the rights {acl.sddl}")

    def do() -> None:
        file.owner, file.protected = ADMINISTRATORS, True

    host.effect(f"Set-Acl {path}", do)
    return EMPTY


def join_path(scope: Scope, given: Given) -> str:
    path, child = text(given["path"]), text(given["childpath"])
    if not path:
        raise ScriptError("Cannot bind argument to parameter 'Path' because it is an empty string.")
    if path[:2].upper() not in ("C:", "HK"):
        raise ScriptError(
            f"Cannot find drive. A drive with the name '{path[0]}' does not exist.", error_id="DriveNotFound"
        )
    return path.rstrip("\\") + "\\" + child.lstrip("\\")


def start_sleep(scope: Scope, given: Given) -> Value:
    if scope.session.runner is not None:
        scope.session.runner.pass_time(number(given["milliseconds"]))
        return EMPTY
    if scope.session.host.interrupt:
        raise Interrupted
    host = scope.session.host
    host.clock += number(given["milliseconds"])
    if host.slept:
        host.slept(host)
    return EMPTY


def write_information(scope: Scope, given: Given) -> Value:
    assert given["informationaction"] == "Continue"
    scope.session.talk.append(text(given["messagedata"]))
    return EMPTY


def write_progress(scope: Scope, given: Given) -> Value:
    """A bar is shown where the preference says so; a text must not be empty."""
    if text(scope.read("progresspreference")) != "Continue":
        return EMPTY
    assert text(given["activity"])
    if given.get("completed"):
        scope.session.host.progress.append(("", -1))
        return EMPTY
    assert text(given["status"])
    scope.session.host.progress.append((text(given["status"]), number(given["percentcomplete"])))
    return EMPTY


def convert_to_json(scope: Scope, given: Given) -> str:
    nested = isinstance(given["inputobject"], Table) and any(
        isinstance(value, Table | list | Record) for _, value in given["inputobject"].items()
    )
    if not given["compress"] or (given.get("depth") != 20 and nested):
        raise Unsupported("JSON in another form")
    return to_json(given["inputobject"], windows_powershell=scope.session.windows_powershell)


def set_strict_mode(scope: Scope, given: Given) -> Value:
    """Of the scope that it is called in, and of those below that say nothing else."""
    if "off" not in given and text(given["version"]) not in ("3.0", "3", "Latest"):
        raise Unsupported("another strict mode than 3.0")
    scope.strict = "off" not in given
    return EMPTY


def _silent(scope: Scope, given: Given) -> Value:
    return EMPTY


def _of_hyperv(call: Callable[[hyperv.Caller, Given], Value]) -> Callable[[Scope, Given], Value]:
    return lambda scope, given: call(scope.session, given)


def receive_job(scope: Scope, given: Given) -> Value:
    if isinstance(given["job"], guests.Job):
        return guests.receive(scope, given["job"])
    return hyperv.receive_job(scope.session, given)


def remove_job(scope: Scope, given: Given) -> Value:
    if isinstance(given["job"], guests.Job):
        return guests.remove_job(scope, given)
    return hyperv.remove_job(scope.session, given)


CMDLETS: dict[str, Callable[[Scope, Given], Value]] = {
    "test-path": test_path,
    "get-item": get_item,
    "get-childitem": get_child_item,
    "new-item": new_item,
    "new-itemproperty": new_item_property,
    "remove-itemproperty": remove_item_property,
    "remove-item": remove_item,
    "get-acl": get_acl,
    "set-acl": set_acl,
    "join-path": join_path,
    "start-sleep": start_sleep,
    "write-information": write_information,
    "write-verbose": _silent,
    "write-progress": write_progress,
    "set-strictmode": set_strict_mode,
    "convertto-json": convert_to_json,
    "convertfrom-json": lambda scope, given: from_json(text(given["inputobject"])),
    "get-module": lambda scope, given: [Record(Version=version) for version in scope.session.host.module],
    "get-command": modules.get_command,
    "get-alias": modules.get_alias,
    "export-modulemember": modules.export_module_member,
    "import-module": modules.import_module,
    "new-module": modules.new_module,
    "new-pssession": guests.new_session,
    "remove-pssession": guests.remove_session,
    "invoke-command": guests.invoke_command,
    "convertto-securestring": convert_to_secure_string,
    **{name: _of_hyperv(call) for name, call in (hyperv.CMDLETS | windows.CMDLETS).items()},
    "receive-job": receive_job,
    "remove-job": remove_job,
}
