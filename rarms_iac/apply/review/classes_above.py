"""Task classes of Windows or of a computer's maker may run above robotic ones; they stay as they are (PAPER.md)."""

from collections.abc import Iterator

from rarms_iac.apply.review.reviewed import Reviewed
from rarms_iac.apply.threads import above
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity

FINDING = Finding(code="RARMS226", severity=Severity.NOTE, summary="Other task classes run above a robotic one")


def review(part: Reviewed) -> Iterator[Diagnostic]:
    """Tells of them once a host, where the plan writes task classes."""
    if not any(change.address.task for change in part.plan.changes):
        return
    found: dict[str, list[str]] = {}
    for inside, task, runs_at in above(part.plan.threads, part.observed, part.application):
        found.setdefault(f"{task.name} ({runs_at})", []).append(inside or "the host itself")
    if found:
        systems = sorted({place for places in found.values() for place in places})
        yield FINDING.at(
            None,
            f"On {part.plan.host.name}, threads of {', '.join(sorted(found))} run above robotic ones in "
            f"{', '.join(systems)}, when a program joins these classes.",
            "Keep programs that play or record sound and video out of these systems. The classes themselves stay as "
            "they are.",
            address=f"host/{part.plan.host.name}",
        )
