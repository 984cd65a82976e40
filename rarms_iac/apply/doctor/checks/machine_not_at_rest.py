"""A saved machine keeps its settings until it runs again; a critical one has lost its storage (FACTS 3, 5)."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination, address_of, called
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.state import RunState

FINDING = Finding(code="RARMS245", severity=Severity.WARNING, summary="A machine is saved or in a critical state")


def check(host: Examination) -> Iterator[Diagnostic]:
    """Tells of machines that rarms could not change, or that will ask for their reserve when they come back."""
    for machine, _ in host.machines():
        where = f"{called(machine)} on {host.state.facts.name}"
        if machine.state is RunState.SAVED:
            yield FINDING.at(
                host.place,
                f"{where} is saved: its processors and memory cannot change, and unless it starts by itself its "
                "reserve is not counted until it runs again.",
                "Start it and shut it down, or give its saved state up: `Remove-VMSavedState`.",
                address=address_of(machine),
            )
        elif machine.state is RunState.CRITICAL:
            yield FINDING.at(
                host.place,
                f"{where} is in a critical state: its storage cannot be reached. It can only be turned off or removed.",
                "Bring its storage back (a disk that is offline, full or disconnected), then look again.",
                address=address_of(machine),
            )
