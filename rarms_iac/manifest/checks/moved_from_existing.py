"""A name that was moved away is free."""

from collections.abc import Iterator, Mapping

from rarms_iac.manifest.checks.common import partition_names
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS081", severity=Severity.ERROR, summary="A partition was moved and is still wanted")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of entries of `moved` whose old name a partition of the manifest still bears."""
    names = partition_names(system) if system.moved else set()
    for old, new in system.moved.items():
        if old in names and not _returns(system.moved, old):
            yield FINDING.at(
                places.key("moved", old),
                f'"{old}" is to become "{new}", and the manifest still wants a partition "{old}".',
                "Remove the entry, or rename the partition.",
                address=f"partition/{old}",
            )


def _returns(moved: Mapping[str, str], old: str) -> bool:
    """Whether the moves lead back to it: that is RARMS080's to tell."""
    seen = [old]
    while (following := moved.get(seen[-1])) is not None and following not in seen:
        seen.append(following)
    return following == old
