"""Disks whose removal was asked for: which ones go, for ever, and which stay all the same."""

from collections.abc import Iterator

from rarms_iac.apply.review.reviewed import Reviewed
from rarms_iac.apply.wanted import judged_disks
from rarms_iac.model.changes import Delete
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.operations import RemoveDisk
from rarms_iac.model.state import Partition

GOES = Finding(code="RARMS253", severity=Severity.WARNING, summary="A virtual disk is deleted")
STAYS = Finding(
    code="RARMS254", severity=Severity.WARNING, summary="A virtual disk stays although its removal was asked for"
)


def review(part: Reviewed) -> Iterator[Diagnostic]:
    """Tells of each disk of the machines that are removed with their disks."""
    for step in part.plan.steps:
        if isinstance(step.operation, RemoveDisk):
            yield GOES.at(
                step.place,
                f"{step.operation.path} of {step.address.partition} on {part.plan.host.name} is deleted after its "
                f"machine was removed: whatever was written since it was made from {step.operation.parent} is lost.",
                "Copy what is still needed out of it first; nothing brings it back, `rarms undo` neither. To keep it, "
                "leave out --remove-disks.",
                address=f"partition/{step.address.partition}",
            )
    if part.remove_disks:
        yield from _kept(part)


def _kept(part: Reviewed) -> Iterator[Diagnostic]:
    for change in part.plan.changes:
        if not isinstance(change, Delete) or not isinstance(change.before, Partition):
            continue
        for disk in judged_disks(part.system, part.observed, change.before):
            if disk.stays:
                yield STAYS.at(
                    change.reason.place,
                    f"{disk.disk.path} of {change.address.partition} on {part.plan.host.name} is kept: {disk.stays}.",
                    "Look at what is on it, and delete it by hand when nobody needs it.",
                    address=str(change.address),
                )
