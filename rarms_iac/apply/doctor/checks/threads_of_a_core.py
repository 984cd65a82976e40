"""With SMT, the core scheduler never shares a core between machines (FACTS 2)."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.system import SchedulerType

FINDING = Finding(
    code="RARMS234",
    severity=Severity.WARNING,
    summary="Under the core scheduler a virtual processor may take two logical ones",
)


def check(host: Examination) -> Iterator[Diagnostic]:
    """Tells of SMT under the core scheduler."""
    facts = host.state.facts
    if facts.smt and facts.scheduler is SchedulerType.CORE:
        yield FINDING.at(
            host.place,
            f"{facts.name} has SMT and the core scheduler: a core is never shared between machines, and the virtual "
            "processor of a machine without SMT of its own takes both its threads.",
            "Give partitions even numbers of processors, and let them see SMT (HwThreadCountPerCore 0 or 2); where "
            "they do not, count each of their processors twice against the host.",
            address=host.address,
        )
