"""A partition that is wider than its host waits for itself, and no reserve is guaranteed to it (FACTS 1.2)."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.checks.wide_machine import FINDING
from rarms_iac.apply.review.reviewed import Reviewed, made_of
from rarms_iac.model.diagnostics import Diagnostic


def review(part: Reviewed) -> Iterator[Diagnostic]:
    """Tells of partitions that get or have more virtual processors than the host has logical ones."""
    available = part.observed.facts.logical_processors
    for change in part.plan.changes:
        after = made_of(change)
        if after is not None and after.processors > available:
            yield FINDING.at(
                change.reason.place,
                f'"{after.name}" is to have {after.processors} virtual processors, and {part.plan.host.name} has '
                f"{available} logical ones: it can never run on all of them at once.",
                f"Give it at most {available}: `processors: {available}`.",
                address=str(change.address),
            )
