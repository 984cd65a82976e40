"""The same run on the stand-in for PowerShell and on the real one: what each says and leaves, and where they differ."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from itertools import groupby
from typing import Any

from tests.fake_powershell.host import WindowsHost
from tests.fake_powershell.run import Look, Ran
from tests.fake_powershell.values import EMPTY, Record, Value, text
from tests.real_powershell.accepted import ENGINE, HOSTS, ORDER, WORDS
from tests.real_powershell.runner import RealPowerShell

Seen = Mapping[str, Any]


def differences(real: RealPowerShell, look: Look) -> list[str]:
    """Return where the real PowerShell does and says another thing than the stand-in did; empty: nowhere."""
    host = look.before
    ran = real.run(host, look.name, **look.how)
    ours = replace(look.ran, lines=tuple(map(_line, look.output)))
    left, right = seen_of(look.after, ours), seen_of(host, ran)
    found = [
        f"{key}, stand-in: {_first(left[key], right[key])}\n{' ' * len(key)}  real:     {_first(right[key], left[key])}"
        for key in left
        if left[key] != right[key]
    ]
    given = " ".join(f"{name}={value}" for name, value in look.how.items() if value)
    return [f"{look.name} {given}", *found, *ran.talk] if found else []


def is_shown(look: Look) -> bool:
    """Whether the real PowerShell can be on such a host."""
    return not any(kind.is_one(look.before) for kind in HOSTS)


def seen_of(host: WindowsHost, ran: Ran) -> Seen:
    """All that a run says and leaves, but for what may differ."""
    return {
        "code": ran.code,
        "lines": [_value(_plain(line)) for line in ran.lines],
        "prompts": ran.prompts,
        "effects": _by_name([_plain(effect) for effect in host.effects]),
        "files": {low: _content(file.data) for low, file in host.files.items()},
        "owners": {low: (file.owner, file.protected) for low, file in host.files.items()},
        "registry": {
            low: {name: (value.name, value.kind, _value(str(value.data))) for name, value in key.values.items()}
            for low, key in host.registry.items()
        },
        "machines": host.vms,
        "event log": [(kind, number, _plain(says)) for kind, number, says in host.event_log or ()],
        "progress": host.progress,
        "clock": host.clock,
    }


def _line(value: Value) -> str:
    """A line, or what an object at the end of a pipeline has."""
    return json.dumps(_held(value)) if isinstance(value, Record) else text(value)


def _held(value: Value) -> Any:
    match value:
        case Record():
            return {name: _held(held) for name, held in value.properties.items()}
        case list():
            return [_held(held) for held in value]
        case bool() | int() | None:
            return value
        case _:
            return None if value is EMPTY else text(value)


def _plain(says: str) -> str:
    """The text without what may differ."""
    for words in WORDS:
        says = re.sub(words.pattern, words.same, says)
    return says


def _by_name(effects: list[str]) -> list[str]:
    """The effects, with values of a key that are removed one after another by name."""
    found: list[str] = []
    for removes, group in groupby(effects, key=lambda effect: effect.startswith(ORDER.effect)):
        named = list(group)
        found += sorted(named) if removes else named
    return found


def _content(data: bytes | None) -> Any:
    """Lines of JSON by their values."""
    if data is None:
        return "a folder"
    says = _plain(data.decode("utf-8", "replace"))
    return [_value(line) for line in says.splitlines()] if says.startswith("{") else says


def _value(line: str) -> Any:
    try:
        found = json.loads(line)
    except json.JSONDecodeError:
        return line
    if isinstance(found, dict) and found.get("format") == "rarms-observation/1":
        del found[ENGINE.probe]
        of_keys = [found[ORDER.key], *(each for name in ORDER.lists_of_keys for each in found[name].get("value", ()))]
        for key in of_keys:
            name = "values" if "values" in key else "value"
            key[name] = sorted(key.get(name, ()), key=lambda value: str(value["name"]))
        if found["journal"]["status"] == "value":
            found["journal"]["value"]["text"] = _content(found["journal"]["value"]["text"].encode())
    return found


def _first(one: Any, other: Any) -> str:
    """What of it is the first to differ from the other."""
    match one, other:
        case (list(), list()) | (str(), str()):
            same = (at for at, pair in enumerate(zip(one, other, strict=False)) if pair[0] != pair[1])
            at = next(same, min(len(one), len(other)))
            if isinstance(one, str):
                return repr(one[max(0, at - 60) : at + 200])
            if at < min(len(one), len(other)):
                return f"[{at}] {_first(one[at], other[at])}"
            return f"[{at}] {one[at : at + 1]!r:.600}"
        case dict(), dict():
            name = next(name for name in {**one, **other} if one.get(name) != other.get(name))
            return f"{name}: {_first(one.get(name), other.get(name))}"
        case _:
            return f"{one!r:.600}"
