"""A limit that is widened lets a partition take what others had."""

from collections.abc import Iterator

from rarms_iac.apply.review.reviewed import Reviewed
from rarms_iac.model.changes import Update
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.state import Partition

FINDING = Finding(code="RARMS222", severity=Severity.NOTE, summary="A change widens a limit")


def review(part: Reviewed) -> Iterator[Diagnostic]:
    """Tells of partitions that may take more than before."""
    for change in part.plan.changes:
        match change:
            case Update(before=Partition(settings=old), after=Partition(settings=new)) if new.limit > old.limit:
                yield FINDING.at(
                    change.reason.place,
                    f'"{old.name}" may take {new.limit} % of each of its {new.processors} virtual processors, not '
                    f"{old.limit} %: what nobody reserves may go to it.",
                    "Nothing, if it is meant. Reserves of others stay; what they got beyond may shrink.",
                    address=str(change.address),
                )
