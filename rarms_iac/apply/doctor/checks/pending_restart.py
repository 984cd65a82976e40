"""What was installed last takes effect when the host starts again, and it may do so at any time."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity

FINDING = Finding(code="RARMS239", severity=Severity.WARNING, summary="The host waits for a restart")


def check(host: Examination) -> Iterator[Diagnostic]:
    """Tells of a restart that Windows waits for."""
    if host.condition.pending_restart:
        yield FINDING.at(
            host.place,
            f"{host.state.facts.name}: Windows waits for a restart to finish installing something. A restart in the "
            "middle of an apply stops its machines, and what is measured now may not hold afterwards.",
            "Restart it at a time of your choice, then look again.",
            address=host.address,
        )
