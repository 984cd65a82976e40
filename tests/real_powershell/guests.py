"""The guests of the model for a real PowerShell: what runs inside them is interpreted, on the model's clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

from tests.fake_powershell import guests
from tests.fake_powershell.compiling import compiled
from tests.fake_powershell.scopes import Block
from tests.fake_powershell.values import Thing, Value

TYPES: Mapping[type[Thing], str] = {guests.GuestSession: "RarmsTests.GuestSession", guests.Job: "RarmsTests.GuestJob"}
"""Of each object the class of C#, which asks for its properties."""
CALLS: Mapping[str, Callable[[Any, Any], Value]] = {
    "new-pssession": guests.new_session,
    "remove-pssession": guests.remove_session,
    "invoke-command": lambda scope, given: guests.invoke_command(scope, {**given, "scriptblock": _block(given)}),
    "receive-job": lambda scope, given: guests.receive(scope, given["job"]),
    "remove-job": guests.remove_job,
}


def _block(given: Mapping[str, Any]) -> Block:
    return Block(compiled(given["scriptblock"].encode("ascii")), None)  # type: ignore[arg-type]  # it calls no function


def caller(host: Any) -> Any:
    """Return what the model's guests need of the one who calls."""
    return SimpleNamespace(session=SimpleNamespace(host=host, runners=[]))


def properties(of: Thing) -> dict[str, str]:
    """Return what PowerShell sees of an object of `TYPES`."""
    return {"State": of.runner.state} if isinstance(of, guests.Job) else {}
