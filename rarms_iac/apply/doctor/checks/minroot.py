"""Under minroot the root partition has only some of the logical processors (FACTS 2)."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity

FINDING = Finding(
    code="RARMS243", severity=Severity.NOTE, summary="The host's own Windows has fewer processors than the hypervisor"
)


def check(host: Examination) -> Iterator[Diagnostic]:
    """Tells of numbers that differ; reservations rest on the hypervisor's."""
    facts, seen = host.state.facts, host.condition.seen_processors
    if seen is not None and seen != facts.logical_processors:
        yield FINDING.at(
            host.place,
            f"{facts.name}: its own Windows sees {seen} logical processors, the hypervisor has "
            f"{facts.logical_processors}. Machines may still run on those of the host.",
            "Nothing, if `bcdedit /set hypervisorrootproc` is meant; components with `runs_on: host` have only these.",
            address=host.address,
        )
