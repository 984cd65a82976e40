"""Keys that need or exclude each other, which no single field can say.

They are looked for in the plain values, so that they are reported together with the errors of fields; `RULES` says the
same to editors.
"""

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Any

from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.model.run import Process, Run, Samples

BrokenRule = tuple[tuple[str | int, ...], str, Mapping[str, Any]]
"""Path, kind of error and its facts; `messages.py` puts them into words."""


def _only_its_own_block(kind: ProviderKind) -> dict[str, Any]:
    """Return a host without `provider` is simulated."""
    said: dict[str, Any] = {"properties": {"provider": {"const": kind.value}}}
    if kind is not ProviderKind.SIMULATED:
        said["required"] = ["provider"]
    others = [{"required": [other.value]} for other in ProviderKind if other is not kind]
    return {"if": said, "then": {"not": {"anyOf": others}}}


def _only_with(source: str, *keys: str) -> dict[str, Any]:
    """Return keys that `from` needs with this source, and allows with no other."""
    return {
        "if": {"properties": {"from": {"const": source}}, "required": ["from"]},
        "then": {"required": list(keys)},
        "else": {"not": {"anyOf": [{"required": [key]} for key in keys]}},
    }


_FIELDS = ("response_time", "success", "count")
_WITH_MESSAGES: Mapping[str, Any] = {"properties": {"from": {"const": "ros"}}, "required": ["from"]}
"""Samples that come from messages of ROS."""

STARTED = ("command", "container", "service")
"""Keys of which a process has one."""

LINES_FROM = ("stream", "file", "socket")
"""Keys of `samples` that say where lines are read, of which it has at most one."""

_NO_SETUP_OF_CONTAINERS = {"not": {"required": ["setup", "container"]}}
_SAMPLED_PROCESS = {
    "if": {"required": ["processes"]},
    "then": {"required": ["samples"], "properties": {"samples": {"required": ["process"]}}},
    "else": {"properties": {"samples": {"not": {"required": ["process"]}}}},
}

_NO_RESTART_OF_ONE = {
    "properties": {
        "processes": {
            "additionalProperties": {
                "properties": {
                    "service": {"properties": {"properties": {"properties": {"Restart": {"const": "no"}}}}},
                },
            },
        },
    },
}

_MESSAGES_IN_TIME = {
    "if": {"properties": {"samples": _WITH_MESSAGES}, "required": ["samples"]},
    "then": {"required": ["timeout"], "not": {"required": ["call"]}},
}

_ATTACHED_PRINTS = {
    "if": {"required": ["attach"]},
    "then": {
        "required": ["samples"],
        "properties": {"samples": {"properties": {"from": {"not": {"const": "per_run"}}}, "required": ["from"]}},
    },
}

RULES: Mapping[type, Mapping[str, Any]] = {
    Host: {"allOf": [_only_its_own_block(kind) for kind in ProviderKind]},
    Process: {"oneOf": [{"required": [name]} for name in STARTED], "allOf": [_NO_SETUP_OF_CONTAINERS]},
    Run: {
        "oneOf": [{"required": [name]} for name in (*STARTED, "call", "processes", "attach")],
        "allOf": [_NO_SETUP_OF_CONTAINERS, _SAMPLED_PROCESS, _NO_RESTART_OF_ONE, _MESSAGES_IN_TIME, _ATTACHED_PRINTS],
    },
    Samples: {
        "allOf": [
            _only_with("pattern", "pattern"),
            _only_with("ros", "input", "output"),
            {"if": _WITH_MESSAGES, "then": {"not": {"anyOf": [{"required": [key]} for key in _FIELDS]}}},
            *({"not": {"required": list(pair)}} for pair in combinations(LINES_FROM, 2)),
        ],
        "anyOf": [
            {"properties": {"from": {"enum": ["json_lines", "pattern"]}}, "required": ["from"]},
            {"not": {"anyOf": [{"required": [name]} for name in LINES_FROM]}},
        ],
    },
}
"""What the JSON Schemas of these blocks say of it."""


def broken_rules(document: Any) -> Iterator[BrokenRule]:
    """Yield every broken rule of a document besides the other errors it has."""
    yield from _hosts(document)
    yield from _components(document)


def _mapping(value: Any, key: str) -> dict[str, Any]:
    found = value.get(key) if isinstance(value, dict) else None
    return found if isinstance(found, dict) else {}


def _hosts(document: Any) -> Iterator[BrokenRule]:
    for name, host in _mapping(document, "hosts").items():
        if not isinstance(host, dict):
            continue
        provider = host.get("provider", ProviderKind.SIMULATED.value)
        for block in map(str, ProviderKind):
            if block in host and provider != block and provider in list(ProviderKind):
                yield ("hosts", name, block), "rarms_foreign_block", {"block": block, "provider": provider}


def _components(document: Any) -> Iterator[BrokenRule]:
    for name, component in _mapping(document, "components").items():
        run = component.get("run") if isinstance(component, dict) else None
        if not isinstance(run, dict):
            continue
        path = ("components", name, "run")
        yield from _started(path, run, (*STARTED, "call", "processes", "attach"))
        for process, block in _mapping(run, "processes").items():
            if isinstance(block, dict):
                yield from _started((*path, "processes", process), block, STARTED)
                yield from _restarted((*path, "processes", process), block)
        samples = run.get("samples")
        if ("processes" in run) != (isinstance(samples, dict) and "process" in samples):
            missing = "processes" in run
            facts = {"key": "samples.process" if missing else "process", "needs": "processes", "missing": missing}
            yield path if missing else (*path, "samples"), "rarms_together", facts
        if "attach" in run and (not isinstance(samples, dict) or samples.get("from", "per_run") == "per_run"):
            yield path, "rarms_together", {"key": "samples.from", "needs": "attach", "missing": True}
        if isinstance(samples, dict):
            yield from _samples((*path, "samples"), samples)
            yield from _lines_from((*path, "samples"), samples)
            if samples.get("from") == "ros":
                yield from _with_messages(path, run)


def _started(path: tuple[str, ...], block: dict[str, Any], names: tuple[str, ...]) -> Iterator[BrokenRule]:
    if sum(name in block for name in names) != 1:
        yield path, "rarms_exactly_one", {"names": " ".join(names)}
    if "setup" in block and "container" in block:  # the host's files do not hold inside
        yield path, "rarms_together", {"key": "setup", "needs": "a command, a call or a service", "missing": False}


def _restarted(path: tuple[str, ...], block: dict[str, Any]) -> Iterator[BrokenRule]:
    properties = _mapping(_mapping(block, "service"), "properties")
    if properties.get("Restart", "no") != "no":  # a process that ends fails the running sample, and all start again
        facts = {"key": "Restart", "needs": "a service without `processes`", "missing": False}
        yield (*path, "service", "properties"), "rarms_together", facts


def _samples(path: tuple[str, ...], samples: Mapping[str, Any]) -> Iterator[BrokenRule]:
    source = samples.get("from", "per_run")
    for key, needs in (("pattern", "pattern"), ("input", "ros"), ("output", "ros")):
        if (source == needs) != (key in samples):
            yield path, "rarms_together", {"key": key, "needs": f"from: {needs}", "missing": key not in samples}


def _lines_from(path: tuple[str, ...], samples: Mapping[str, Any]) -> Iterator[BrokenRule]:
    written = [name for name in LINES_FROM if name in samples]
    source = samples.get("from", "per_run")
    if len(written) > 1:
        yield path, "rarms_exactly_one", {"names": " ".join(LINES_FROM)}
    elif written and isinstance(source, str) and source not in {"json_lines", "pattern"}:
        needs = "from: json_lines or from: pattern"
        yield path, "rarms_together", {"key": written[0], "needs": needs, "missing": False}


def _with_messages(path: tuple[str, ...], run: Mapping[str, Any]) -> Iterator[BrokenRule]:
    if "timeout" not in run:
        yield path, "rarms_together", {"key": "timeout", "needs": "samples: {from: ros}", "missing": True}
    if "call" in run:
        yield path, "rarms_together", {"key": "call", "needs": "samples of its own", "missing": False}
    for key in _FIELDS:
        if key in run["samples"]:
            needs = "from: json_lines or from: pattern"
            yield (*path, "samples"), "rarms_together", {"key": key, "needs": needs, "missing": False}
