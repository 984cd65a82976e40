"""Keys that need or exclude each other, which no single field can say.

They are looked for in the plain values, so that they are reported beside the errors of fields; the JSON Schemas of the
blocks say the same (`exactly_one`, `if` / `then`).
"""

from collections.abc import Iterator, Mapping
from typing import Any

from rarms_iac.model.host import ProviderKind

BrokenRule = tuple[tuple[str | int, ...], str, Mapping[str, Any]]
"""Path, kind of error and its facts; `messages.py` puts them into words."""

BLOCK_OF = {ProviderKind.HYPERV: "hyperv", ProviderKind.LINUX: "linux", ProviderKind.SIMULATED: "simulated"}


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
        for kind, block in BLOCK_OF.items():
            if block in host and provider != kind.value and provider in list(ProviderKind):
                yield ("hosts", name, block), "rarms_foreign_block", {"block": block, "provider": provider}


def _components(document: Any) -> Iterator[BrokenRule]:
    for name, component in _mapping(document, "components").items():
        run = component.get("run") if isinstance(component, dict) else None
        if not isinstance(run, dict):
            continue
        path = ("components", name, "run")
        yield from _exactly_one(path, run, "command", "call")
        yield from _exactly_one((*path, "until"), run.get("until"), "samples", "elapsed")
        yield from _pattern((*path, "samples"), run.get("samples"))
        yield from _stream((*path, "samples"), run.get("samples"))


def _exactly_one(path: tuple[str, ...], block: Any, *names: str) -> Iterator[BrokenRule]:
    if isinstance(block, dict):
        written = tuple(name for name in names if name in block)
        if len(written) != 1:
            yield path, "rarms_exactly_one", {"names": names, "written": written}


def _pattern(path: tuple[str, ...], samples: Any) -> Iterator[BrokenRule]:
    if isinstance(samples, dict) and (samples.get("from") == "pattern") != ("pattern" in samples):
        missing = "pattern" not in samples
        yield path, "rarms_together", {"key": "pattern", "needs": "from: pattern", "missing": missing}


def _stream(path: tuple[str, ...], samples: Any) -> Iterator[BrokenRule]:
    if isinstance(samples, dict) and "stream" in samples and samples.get("from", "per_run") == "per_run":
        needs = "from: json_lines or from: pattern"
        yield path, "rarms_together", {"key": "stream", "needs": needs, "missing": False}
