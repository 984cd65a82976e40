"""Client hosts may take a checkpoint whenever a machine starts (FACTS 4)."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination, address_of, called
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity

FINDING = Finding(code="RARMS238", severity=Severity.WARNING, summary="A machine takes checkpoints by itself")


def check(host: Examination) -> Iterator[Diagnostic]:
    """Tells of machines with automatic checkpoints."""
    for machine, odd in host.machines():
        if odd.automatic_checkpoints:
            yield FINDING.at(
                host.place,
                f"{called(machine)} on {host.state.facts.name} takes a checkpoint whenever it starts: its disk grows "
                "beside its parent, and going back to one brings old settings back.",
                "Turn it off: `Set-VM -AutomaticCheckpointsEnabled $false`. Partitions of rarms have checkpoints "
                "disabled.",
                address=address_of(machine),
            )
