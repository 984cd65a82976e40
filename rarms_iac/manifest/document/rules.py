"""Keys that need or exclude each other, which no single field can say.

They are looked for in the plain values, so that they are reported together with the errors of fields; `RULES` says the
same to editors.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.model.run import Run, Samples

BrokenRule = tuple[tuple[str | int, ...], str, Mapping[str, Any]]
"""Path, kind of error and its facts; `messages.py` puts them into words."""


def _only_its_own_block(kind: ProviderKind) -> dict[str, Any]:
    """Return a host without `provider` is simulated."""
    said: dict[str, Any] = {"properties": {"provider": {"const": kind.value}}}
    if kind is not ProviderKind.SIMULATED:
        said["required"] = ["provider"]
    others = [{"required": [other.value]} for other in ProviderKind if other is not kind]
    return {"if": said, "then": {"not": {"anyOf": others}}}


RULES: Mapping[type, Mapping[str, Any]] = {
    Host: {"allOf": [_only_its_own_block(kind) for kind in ProviderKind]},
    Run: {"oneOf": [{"required": ["command"]}, {"required": ["call"]}]},
    Samples: {
        "if": {"properties": {"from": {"const": "pattern"}}, "required": ["from"]},
        "then": {"required": ["pattern"]},
        "else": {"not": {"required": ["pattern"]}},
        "anyOf": [
            {"properties": {"from": {"enum": ["json_lines", "pattern"]}}, "required": ["from"]},
            {"not": {"required": ["stream"]}},
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
        if ("command" in run) == ("call" in run):
            yield path, "rarms_exactly_one", {"names": "command call"}
        yield from _pattern((*path, "samples"), run.get("samples"))
        yield from _stream((*path, "samples"), run.get("samples"))


def _pattern(path: tuple[str, ...], samples: Any) -> Iterator[BrokenRule]:
    if isinstance(samples, dict) and (samples.get("from") == "pattern") != ("pattern" in samples):
        missing = "pattern" not in samples
        yield path, "rarms_together", {"key": "pattern", "needs": "from: pattern", "missing": missing}


def _stream(path: tuple[str, ...], samples: Any) -> Iterator[BrokenRule]:
    if isinstance(samples, dict) and "stream" in samples and samples.get("from", "per_run") == "per_run":
        needs = "from: json_lines or from: pattern"
        yield path, "rarms_together", {"key": "stream", "needs": needs, "missing": False}
