"""Removing a machine keeps its disks: nobody's data goes, and the space stays taken."""

from collections.abc import Iterator

from rarms_iac.apply.review.reviewed import Reviewed
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.operations import RemovePartition
from rarms_iac.model.system import ProviderKind

FINDING = Finding(code="RARMS224", severity=Severity.NOTE, summary="A removed machine leaves its disks behind")


def review(part: Reviewed) -> Iterator[Diagnostic]:
    """Tells of machines that are removed where machines have disks."""
    if part.observed.facts.provider is not ProviderKind.HYPERV:
        return
    for step in part.plan.steps:
        if isinstance(step.operation, RemovePartition):
            yield FINDING.at(
                step.place,
                f'"{step.address.partition}" is removed from {part.plan.host.name}: Hyper-V merges its checkpoints '
                "and keeps its virtual disks, and no script of rarms deletes a disk.",
                "Look at where they lie before it is removed (`Get-VMHardDiskDrive`), and delete by hand what nobody "
                "needs.",
                address=str(step.address),
            )
