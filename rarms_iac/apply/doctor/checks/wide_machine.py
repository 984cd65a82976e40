"""A reserve is not guaranteed to a machine with more virtual processors than there are logical ones (FACTS 1.2)."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination, address_of, called
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity

FINDING = Finding(code="RARMS246", severity=Severity.WARNING, summary="A machine has more processors than the host")


def check(host: Examination) -> Iterator[Diagnostic]:
    """Tells of machines that are wider than their host."""
    facts = host.state.facts
    for machine, _ in host.machines():
        count = machine.settings.processors
        if count > facts.logical_processors:
            lost = " and may set it to zero" if machine.settings.reserve else ""
            yield FINDING.at(
                host.place,
                f"{called(machine)} has {count} virtual processors, {facts.name} {facts.logical_processors} logical "
                f"ones: the hypervisor does not guarantee its reserve{lost}.",
                f"Give it at most {facts.logical_processors} processors while it is off.",
                address=address_of(machine),
            )
