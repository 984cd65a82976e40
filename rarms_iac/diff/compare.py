"""Desired and observed state to changes, touching nothing without a mark of this application."""

from dataclasses import dataclass

from rarms_iac.diff.compare_partitions import partition_changes
from rarms_iac.diff.compare_tasks import responsiveness_changes, task_changes
from rarms_iac.diff.step_context import HostContext, ManifestRules, managed_machines
from rarms_iac.model.changes import Change
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.state import State


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """The changes of a host, by address, and the findings that stand in the way."""

    changes: tuple[Change, ...]
    unchanged: int  # resources that are as wanted; unused partitions are not counted
    unused: tuple[str, ...]  # partitions that are only listed: stopped already, automatic start off
    findings: tuple[Diagnostic, ...]


def compare(
    desired: State, observed: State, application: str, context: HostContext, rules: ManifestRules | None = None
) -> Difference:
    """Find the changes that make the observed host the desired one.

    What is desired and not there is created; what carries the application's mark and is not desired is deleted (a
    partition that the manifest merely no longer wants is desired: stopped). Machines and task classes without that
    mark are never part of a change; where one is in the way, a finding says so.

    Args:
        application: the application whose marks count.
        rules: moves, protection and places of the manifest; without them nothing is moved or protected.

    Returns:
        The changes sorted by address. A state compared with itself has none.
    """
    rules = rules or ManifestRules()
    wanted = {partition.settings.name: partition for partition in desired.partitions}
    managed = managed_machines(observed, application, wanted, rules)
    parts = (
        partition_changes(wanted, managed, observed, context, rules),
        task_changes(desired, managed, observed, rules),
        responsiveness_changes(desired.responsiveness, observed.responsiveness, application, rules),
    )
    changes = [change for part in parts for change in part.changes]
    return Difference(
        changes=tuple(sorted(changes, key=lambda change: change.address)),
        unchanged=sum(part.unchanged for part in parts),
        unused=tuple(sorted(name for part in parts for name in part.unused)),
        findings=tuple(finding for part in parts for finding in part.findings),
    )
