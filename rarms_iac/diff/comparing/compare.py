"""Desired x observed -> changes, touching nothing that carries no mark of this application (DESIGN section 4)."""

from dataclasses import dataclass

from rarms_iac.diff.comparing.partitions import partition_changes
from rarms_iac.diff.comparing.responsiveness import responsiveness_changes
from rarms_iac.diff.comparing.tasks import task_changes
from rarms_iac.diff.comparing.wishes import Wishes
from rarms_iac.diff.disruption import Surroundings
from rarms_iac.diff.ours import ours_of
from rarms_iac.model.changes import Change
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.state import State


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """What has to change on a host, by address, and what stands in the way."""

    changes: tuple[Change, ...]
    unchanged: int  # resources that are as wanted; unused partitions are not counted
    unused: tuple[str, ...]  # partitions that are only listed: stopped already, automatic start off
    findings: tuple[Diagnostic, ...]


def compare(
    desired: State, observed: State, application: str, around: Surroundings, wishes: Wishes | None = None
) -> Difference:
    """The changes that make the observed host the desired one.

    What is desired and not there is created; what carries our mark and is not desired is deleted (a partition that
    the manifest merely no longer wants is desired: stopped). Machines and task classes without our mark are never
    part of a change; where one is in the way, a finding says so.
    """
    wishes = wishes or Wishes()
    wanted = {partition.settings.name: partition for partition in desired.partitions}
    ours = ours_of(observed, application, wanted, wishes.moved, wishes.where)
    parts = (
        partition_changes(wanted, ours, observed, application, around, wishes),
        task_changes(desired, ours, observed, application, wishes),
        responsiveness_changes(desired.responsiveness, observed.responsiveness, application, wishes),
    )
    at_rest = tuple(name for part in parts for name in part.unused)
    return Difference(
        changes=tuple(sorted((change for part in parts for change in part.changes), key=lambda part: part.address)),
        unchanged=sum(part.unchanged for part in parts),
        unused=tuple(sorted(at_rest)),
        findings=tuple(finding for part in parts for finding in part.findings),
    )
