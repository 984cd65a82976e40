"""Memory that is taken from a partition may be in use there."""

from collections.abc import Iterator

from rarms_iac.apply.review.reviewed import Reviewed
from rarms_iac.model.changes import Update
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.quantities import show_bytes
from rarms_iac.model.state import Partition

FINDING = Finding(code="RARMS220", severity=Severity.WARNING, summary="A change takes memory from a partition")


def review(part: Reviewed) -> Iterator[Diagnostic]:
    """Tells of partitions that get less memory than they have."""
    for change in part.plan.changes:
        match change:
            case Update(before=Partition(settings=old), after=Partition(settings=new)) if new.memory < old.memory:
                yield FINDING.at(
                    change.reason.place,
                    f'"{old.name}" has {show_bytes(old.memory)} and gets {show_bytes(new.memory)}: what its guest and '
                    "its components use beyond that is swapped out, or they fail to start.",
                    "Look at what its guest uses at most, and measure its components again with the new size.",
                    address=str(change.address),
                )
