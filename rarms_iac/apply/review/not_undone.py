"""What an undo cannot bring back is said before it is done."""

from collections.abc import Iterator

from rarms_iac.apply.review.reviewed import Reviewed
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.plan import Purpose, UndoLevel

FINDING = Finding(code="RARMS225", severity=Severity.WARNING, summary="A step cannot be taken back")


def review(part: Reviewed) -> Iterator[Diagnostic]:
    """Tells of steps without an undo; who destroys asked for it. What comes back in part is listed with the plan."""
    if part.purpose is Purpose.DESTROY:
        return
    for step in part.plan.steps:
        if step.undo.level is UndoLevel.NONE:
            yield FINDING.at(
                step.place,
                f"{step.address}, {step.title}: {step.undo.says}.",
                "Save what is needed before it is applied: `rarms undo` and the undo script leave this as it is.",
                address=str(step.address),
            )
