"""A limit that is below what its reserve needs is raised, and that is said."""

from collections.abc import Iterator

from rarms_iac.apply.review.reviewed import Reviewed
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.where import partition_place
from rarms_iac.planner.groups import groups_of
from rarms_iac.planner.headroom import said_limit

FINDING = Finding(code="RARMS221", severity=Severity.WARNING, summary="A limit is below what the reserve needs")


def review(part: Reviewed) -> Iterator[Diagnostic]:
    """Tells of partitions whose reserve, together and rounded up, is above the limit that was asked for."""
    if part.layout is None:
        return
    host = part.plan.host
    # A limit that was raised equals the reserve; only then the whole system is worth grouping again.
    raised = [
        partition
        for partition in part.layout.partitions
        if partition.host == host.name and partition.limit == partition.reserve
    ]
    groups = {group.name: group for group in groups_of(part.system)} if raised else {}
    for placed in raised:
        asked = said_limit(groups[placed.name].asking, host, placed.processors)
        if asked is not None and asked < placed.reserve:
            yield FINDING.at(
                partition_place(part.system, part.places, placed.name),
                f'"{placed.name}" is limited to {asked} % of each of its virtual processors, and its reserve needs '
                f"{placed.reserve} %: the plan raises the limit to that, and the partition never gets more.",
                "Raise the limit, or remove it: what was measured without one holds without one.",
                address=f"partition/{placed.name}",
            )
