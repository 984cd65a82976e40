"""What could not be read is said, so that silence means something."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity

FINDING = Finding(code="RARMS249", severity=Severity.NOTE, summary="Something of the host could not be looked at")


def check(host: Examination) -> Iterator[Diagnostic]:
    """Tells of every probe without an answer."""
    for what, why in sorted(host.condition.unread.items()):
        yield FINDING.at(
            host.place,
            f"{host.state.facts.name}: {what} could not be read: {why}.",
            "Look again as a member of Administrators in an elevated PowerShell; what the host does not have is no "
            "problem.",
            address=host.address,
        )
