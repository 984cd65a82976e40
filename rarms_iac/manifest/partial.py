"""The part of a manifest that is right beside its structural errors, so that one round shows both kinds of errors.

A component, host or other named entry with an error is left out as a whole. Of what the checks find in the rest, only
what cannot come from the gap is shown: errors that name no entry that was left out. In the entry itself those errors
are shown that hold whatever its wrong keys were meant to say (`HOLD_ANYWAY`): they are looked for in a document that
lacks these keys only.
"""

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from rarms_iac.manifest.checks import measurement, names, partitions, secrets, tasks
from rarms_iac.manifest.checks.common import Path
from rarms_iac.model.diagnostics import Diagnostic, Severity

_NAMED = frozenset({"hosts", "components", "partitions", "interference", "tasks", "moved"})
_NEUTRAL = {"schema": "rarms/v1", "application": {"name": "unnamed"}}
"""What stands for a required block with an error; no check looks at either."""

HOLD_ANYWAY = frozenset(
    finding.code
    for finding in (
        names.UNKNOWN_NAME,
        tasks.UNKNOWN_TASK,
        partitions.TOGETHER_AND_APART,
        partitions.DEDICATED_SHARES,
        partitions.APART_IN_ONE_PARTITION,
        partitions.NO_COMMON_HOST,
        measurement.PATTERN_IS_NOT_RE2,
        measurement.PATTERN_WITHOUT_GROUP,
        measurement.NO_SAMPLE_IN_TIME,
        secrets.SECRET_IN_CLEAR,
    )
)
"""Errors of one key, or of demands that contradict each other: nothing that the entry says beside them mends them."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9-]*")
_HOSTS = re.compile(r"\bhosts?\b|\bplatforms?\b", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """What was left out of a document."""

    names: frozenset[str]  # of entries, and of the partitions that list one of them
    words: frozenset[str]  # of sections, as messages name what is in them
    addresses: frozenset[str]  # of entries that lack a key, as findings have them
    lacks_hosts: bool

    def admits(self, finding: Diagnostic) -> bool:
        """Whether a finding about an entry that lacks a key is right whatever the key was meant to say."""
        return finding.code in HOLD_ANYWAY and finding.address in self.addresses and not self.explains(finding)

    def explains(self, finding: Diagnostic) -> bool:
        """Whether a finding about the rest may be due to what was left out."""
        text = f"{finding.summary} {finding.detail} {finding.address} {finding.place.path if finding.place else ''}"
        return (
            finding.severity is not Severity.ERROR
            or not self.names.isdisjoint(_NAME.findall(text))
            or any(word in text for word in self.words)
            or (self.lacks_hosts and _HOSTS.search(text) is not None)
        )


def without_errors(document: Any, paths: Iterable[Path], depth: int = 2) -> tuple[dict[str, Any], Gap] | None:
    """Leave out of a document what has structural errors.

    Args:
        document: the plain values of a manifest.
        paths: of the errors; an error of a key has the key in its path.
        depth: of what is left out of a section with named entries: 2 an entry, 3 a key of it.

    Returns:
        The remaining document and what it lacks; None where nothing remains that could be checked. The document may
        still have errors: those of the whole, such as a section that is missing, and entries without a key they need.
    """
    if not isinstance(document, dict):
        return None
    dropped = {path[: depth if path[0] in _NAMED else 1] for path in paths if path}
    remaining = _without(document, (), dropped)
    names = {str(path[1]) for path in dropped if len(path) == 2}
    incomplete = {name for name, entry in _entries(remaining, "partitions") if names & _listed(entry)}
    gap = Gap(
        names=frozenset(names | incomplete),
        words=frozenset(str(path[0]).removesuffix("s") for path in dropped if len(path) == 1),
        addresses=frozenset(f"{str(path[0]).removesuffix('s')}/{path[1]}" for path in dropped if len(path) == 3),
        lacks_hosts=any(path[0] == "hosts" for path in dropped if len(path) < 3),
    )
    lacking_keys = {path[1] for path in dropped if len(path) == 3 and path[0] == "components"}
    for name, component in _entries(remaining, "components"):
        if name in lacking_keys:
            component.setdefault("criticality", 0)  # the only key that it needs; no error of `HOLD_ANYWAY` asks for it
    return {**_NEUTRAL, **remaining}, gap


def _without(value: Any, path: Path, dropped: Collection[Path]) -> Any:
    if not isinstance(value, dict) or len(path) == 3:
        return value
    return {key: _without(entry, (*path, key), dropped) for key, entry in value.items() if (*path, key) not in dropped}


def _entries(document: Mapping[str, Any], section: str) -> Iterable[tuple[str, Any]]:
    entries = document.get(section)
    return entries.items() if isinstance(entries, dict) else ()


def _listed(partition: Any) -> set[str]:
    listed = partition.get("components") if isinstance(partition, dict) else None
    return {name for name in listed if isinstance(name, str)} if isinstance(listed, list) else set()
