"""Removing a machine keeps its disks: nobody's data goes, and the space stays taken."""

from collections.abc import Iterator

from rarms_iac.apply.review.reviewed import Reviewed
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.operations import RemovePartition

FINDING = Finding(code="RARMS224", severity=Severity.NOTE, summary="A removed machine leaves its disks behind")


def review(part: Reviewed) -> Iterator[Diagnostic]:
    """Tells of machines that are removed and have disks, where their removal was not asked for."""
    if part.remove_disks:
        return
    for step in part.plan.steps:
        disks = [disk.path for disk in part.observed.disks if disk.machine and disk.machine == step.address.machine]
        if isinstance(step.operation, RemovePartition) and disks:
            yield FINDING.at(
                step.place,
                f'"{step.address.partition}" is removed from {part.plan.host.name}, and its virtual disks stay: '
                f"{', '.join(disks)}.",
                "Delete by hand what nobody needs, or let `rarms destroy --remove-disks` delete what rarms made.",
                address=str(step.address),
            )
