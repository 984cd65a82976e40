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
            why = "it would stay where it is" if len(seen) == 1 else "every plan would move them on again"
            yield FINDING.at(
                places.key("moved", old),
                f"{path}: {why}.",
                "Let each line lead from a name that is no longer wanted to one that is.",
                address=f"partition/{old}",
            )
