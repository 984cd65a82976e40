"""What rarms names of the package wmi, on a Windows without Hyper-V: the model of the host answers, over a socket.

It runs under the Windows CPython alone, ahead of the real package on PYTHONPATH; `tests/real_powershell/wmi_server.py`
is the other end. The owners of files are the model's, too: wine keeps none.
"""

import json
import os
import socket
from types import SimpleNamespace
from typing import Any

import win32file
import win32security


class x_wmi(Exception):  # noqa: N801 - the package's own name
    """A refusal, with the error of COM in it."""

    def __init__(self, code: int) -> None:
        super().__init__(hex(code))
        self.com_error = SimpleNamespace(hresult=code, excepinfo=None, strerror="the model refuses")


class WMI:
    """A connection to a namespace."""

    def __init__(self, namespace: str, find_classes: bool) -> None:
        self.namespace = namespace

    def query(self, text: str) -> list[Any]:
        name = text.removeprefix("SELECT * FROM ")
        if name == "Msvm_ImageManagementService":
            return [SimpleNamespace(GetVirtualHardDiskSettingData=lambda Path: ("", 0, _ask("disk", Path)))]  # noqa: N803
        return [_instance(values) for values in _ask("instances", name)]


def _ask(what: str, name: str) -> Any:
    host, _, port = os.environ["RARMS_TEST_WMI"].partition(":")
    with socket.create_connection((host, int(port))) as connection, connection.makefile("rw", encoding="utf-8") as file:
        file.write(json.dumps([what, name]) + "\n")
        file.flush()
        answer = json.loads(file.readline())
    if "refused" in answer:
        raise x_wmi(answer["refused"])
    return answer["value"]


def _instance(values: dict[str, Any]) -> Any:
    """Return what the package makes of an instance: the names of its properties, and COM's object with the values."""
    ole_object = SimpleNamespace(Properties_=lambda name: SimpleNamespace(Value=values[name]))
    return SimpleNamespace(properties=dict.fromkeys(values), ole_object=ole_object)


def _security(handle: int, kind: int, parts: int) -> Any:
    """Return a security descriptor that has the owner of an open file alone."""
    path = win32file.GetFinalPathNameByHandle(handle, 0).removeprefix("\\\\?\\")
    return win32security.ConvertStringSecurityDescriptorToSecurityDescriptor(
        f"O:{_ask('owner', path)}", win32security.SDDL_REVISION_1
    )


win32security.GetSecurityInfo = _security
