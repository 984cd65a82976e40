"""What a plan stops or restarts of what runs, told before it happens and accepted where that is known."""

from collections.abc import Iterator, Sequence

from rarms_iac.model.changes import Change, Update
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.state import Partition
from rarms_iac.model.system import Disruption

FINDING = Finding(code="RARMS041", severity=Severity.WARNING, summary="A change restarts or stops a partition")


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
