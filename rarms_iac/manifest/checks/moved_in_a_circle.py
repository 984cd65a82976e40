"""Moves lead somewhere."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS080", severity=Severity.ERROR, summary="A move that goes round in a circle")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of entries of `moved` that lead back to where they start."""
    for old in system.moved:
        seen = [old]
        while (following := system.moved.get(seen[-1])) is not None and following not in seen:
            seen.append(following)
        if following == old:
            path = " -> ".join([*seen, old])
            yield FINDING.at(
                places.key("moved", old),
                f"{path}: the partition ends where it began.",
                "Write one line a partition, from the name it has on the host to the name it is to have.",
                address=f"partition/{old}",
            )
