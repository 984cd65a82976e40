"""What a plan stops or restarts of what runs, told before it happens and accepted where that is known."""

from collections.abc import Iterator, Sequence

from rarms_iac.apply.review.reviewed import Reviewed
from rarms_iac.model.changes import Change, Update
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.operations import StopPartition
from rarms_iac.model.plan import Purpose, Step
from rarms_iac.model.state import Partition
from rarms_iac.model.system import Disruption

FINDING = Finding(code="RARMS041", severity=Severity.WARNING, summary="A change restarts or stops a partition")


def review(part: Reviewed) -> Iterator[Diagnostic]:
    """Tells of partitions that are stopped. Who destroys, imports or releases has asked for what happens."""
    if part.purpose is Purpose.APPLY:
        yield from restarts(part.plan.changes)
        yield from stops_for_room(part.plan.changes, part.plan.steps)


def restarts(changes: Sequence[Change]) -> Iterator[Diagnostic]:
    """A warning for each running partition that a change stops, for good or for a while."""
    for change in changes:
        match change:
            case Update(before=Partition() as before, after=Partition()) if change.disruption is not Disruption.LIVE:
                yield FINDING.at(
                    change.reason.place,
                    f'"{before.settings.name}" runs, and it is stopped for this: {change.reason.says}.',
                    "Apply when its components may rest, or hold it back with `--max-disruption live`.",
                    address=str(change.address),
                )


def stops_for_room(changes: Sequence[Change], steps: Sequence[Step]) -> Iterator[Diagnostic]:
    """A warning for each partition whose own change is live, and which is stopped so that others find room."""
    live = {change.address for change in changes if isinstance(change, Update) and change.disruption is Disruption.LIVE}
    for step in steps:
        if isinstance(step.operation, StopPartition) and step.address in live:
            yield FINDING.at(
                step.place,
                f'"{step.address.partition}" runs, and it is stopped for a while: {step.comment}.',
                "Apply when its components may rest, or make room otherwise: a smaller reserve, or fewer changes at "
                "once with `--target`.",
                address=str(step.address),
            )
