"""Each move has a target of its own."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Related, Severity
from rarms_iac.model.system import System

FINDING = Finding(code="RARMS082", severity=Severity.ERROR, summary="Two partitions are moved onto one")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of the later of two entries of `moved` with one new name."""
    first: dict[str, str] = {}
    for old, new in system.moved.items():
        before = first.setdefault(new, old)
        if before != old:
            yield FINDING.at(
                places.value("moved", old),
                f'"{before}" and "{old}" cannot both become "{new}": a partition has one name and one disk.',
                "Keep the entry of the one that goes on; the other is then stopped and listed as unused.",
                address=f"partition/{old}",
                related=(Related(place=places.value("moved", before), says="the other one"),),
            )
