"""Answers the stand-in for the package wmi (`wmi_package/`): what WMI would show of a host, from the model of it."""

import json
import socketserver
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from xml.sax.saxutils import escape

from rarms_iac.providers.hyperv.wmi_document import NotRead
from tests.needs import CHECKOUT
from tests.real_powershell.engines import Engine
from tests.unit.providers.hyperv.made_windows import MadeWindows

PACKAGE = CHECKOUT / "tests" / "real_powershell" / "wmi_package"


@contextmanager
def wmi_of(
    engine: Engine, look: Callable[[], Mapping[str, Any]], owner: Callable[[str], str]
) -> Iterator[Mapping[str, str]]:
    """Answer while the context lasts; the variables have a Windows CPython ask here.

    Args:
        look: what `observe.ps1` would print of the host now; it is called in other threads.
        owner: to whom the file of a path belongs, as an SID; likewise.
    """

    class Handler(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            what, name = json.loads(self.rfile.readline())
            answer = {"value": owner(name)} if what == "owner" else _answer(MadeWindows(look()), what, name)
            self.wfile.write(json.dumps(answer).encode() + b"\n")

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        path = f"{engine.path(PACKAGE)};{engine.path(CHECKOUT)}"
        yield {"RARMS_TEST_WMI": f"127.0.0.1:{server.server_address[1]}", "PYTHONPATH": path}
        server.shutdown()


def _answer(windows: MadeWindows, what: str, name: str) -> Mapping[str, Any]:
    try:
        return {"value": list(windows.instances(name)) if what == "instances" else _xml(windows.disk(name))}
    except NotRead as problem:
        return {"refused": int(problem.error, 16) if problem.error.startswith("0x") else 0x80041003}


def _xml(values: Mapping[str, Any]) -> str:
    """Return an instance as WMI writes it."""
    parts = [
        f'<PROPERTY NAME="{name}" TYPE="string"><VALUE>{escape(str(value))}</VALUE></PROPERTY>'
        for name, value in values.items()
        if value is not None
    ]
    return f'<INSTANCE CLASSNAME="Msvm_VirtualHardDiskSettingData">{"".join(parts)}</INSTANCE>'
