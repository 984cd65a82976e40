"""The part of a manifest that is right beside its structural errors, so that one round shows both kinds of errors.

A component, host or other named entry with an error is left out as a whole. Of what the checks find in the rest, only
what cannot come from the gap is shown: errors that name no entry that was left out.
"""

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from rarms_iac.manifest.checks.common import Path
from rarms_iac.model.diagnostics import Diagnostic, Severity

_NAMED = frozenset({"hosts", "components", "partitions", "interference", "tasks", "moved"})
_NEUTRAL = {"schema": "rarms/v1", "application": {"name": "unnamed"}}
"""What stands for a required block with an error; no check looks at either."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9-]*")
_HOSTS = re.compile(r"\bhosts?\b|\bplatforms?\b", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """What was left out of a document."""

    names: frozenset[str]  # of entries, and of the partitions that list one of them
    words: frozenset[str]  # of sections, as messages name what is in them
    lacks_hosts: bool

    def explains(self, finding: Diagnostic) -> bool:
        """Whether a finding about the rest may be due to what was left out."""
        text = f"{finding.summary} {finding.detail} {finding.address} {finding.place.path if finding.place else ''}"
        return (
            finding.severity is not Severity.ERROR
            or not self.names.isdisjoint(_NAME.findall(text))
            or any(word in text for word in self.words)
            or (self.lacks_hosts and _HOSTS.search(text) is not None)
        )


def without_errors(document: Any, paths: Iterable[Path]) -> tuple[dict[str, Any], Gap] | None:
    """Leave out of a document what has structural errors.

    Args:
        document: the plain values of a manifest.
        paths: of the errors; an error of a key has the key in its path.

    Returns:
        The remaining document and what it lacks; None where nothing remains that could be checked. The document may
        still have errors: those of the whole, such as a section that is missing.
    """
    if not isinstance(document, dict):
        return None
    dropped = {path[:2] if path[0] in _NAMED else path[:1] for path in paths if path}
    remaining = {key: _without(value, key, dropped) for key, value in document.items() if (key,) not in dropped}
    names = {str(path[1]) for path in dropped if len(path) == 2}
    incomplete = {name for name, entry in _entries(remaining, "partitions") if names & _listed(entry)}
    gap = Gap(
        names=frozenset(names | incomplete),
        words=frozenset(str(path[0]).removesuffix("s") for path in dropped if len(path) == 1),
        lacks_hosts=any(path[0] == "hosts" for path in dropped),
    )
    return {**_NEUTRAL, **remaining}, gap


def _without(value: Any, key: str, dropped: Collection[Path]) -> Any:
    if key not in _NAMED or not isinstance(value, dict):
        return value
    return {name: entry for name, entry in value.items() if (key, name) not in dropped}


def _entries(document: Mapping[str, Any], section: str) -> Iterable[tuple[str, Any]]:
    entries = document.get(section)
    return entries.items() if isinstance(entries, dict) else ()


def _listed(partition: Any) -> set[str]:
    listed = partition.get("components") if isinstance(partition, dict) else None
    return {name for name in listed if isinstance(name, str)} if isinstance(listed, list) else set()
