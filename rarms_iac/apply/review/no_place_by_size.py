"""A script asks for room by a simpler rule than the planner: a plan that it would stop half-way is refused before."""

from collections.abc import Iterator

from rarms_iac.apply.review.reviewed import Reviewed
from rarms_iac.model.capacity import claim_of_settings, foreign_claims, packs_by_size
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.system import ProviderKind

FINDING = Finding(code="RARMS259", severity=Severity.ERROR, summary="A script would find no place for its promises")


def review(part: Reviewed) -> Iterator[Diagnostic]:
    """Tells once a Hyper-V host whose wanted machines, largest reserve first, do not all find a logical processor."""
    if part.plan.host.provider is not ProviderKind.HYPERV or not part.plan.changes:
        return
    ours = [claim_of_settings(settings) for settings in part.settings_after() if settings.running]
    claims = (*foreign_claims(part.observed, part.application), *ours)
    if ours and not packs_by_size(claims, part.observed.facts.logical_processors):
        yield FINDING.at(
            None,
            f"On {part.plan.host.name} the virtual processors fit only if they are placed cleverly. A script places "
            "the largest reserve first, finds no place for one of them, and would stop half-way.",
            "Lower a reserve, give a partition other `processors`, or move a component to another host.",
            address=f"host/{part.plan.host.name}",
        )
