"""A machine in a CPU group draws only on the group's logical processors and cap (FACTS 2)."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination, address_of, called
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity

FINDING = Finding(code="RARMS235", severity=Severity.WARNING, summary="A machine is in a CPU group")


def check(host: Examination) -> Iterator[Diagnostic]:
    """Tells of every machine with a group."""
    for machine, odd in host.machines():
        if odd.group:
            yield FINDING.at(
                host.place,
                f"{called(machine)} on {host.state.facts.name} is in the CPU group {odd.group}: it draws only on the "
                "logical processors and the cap of its group, while rarms counts it against the whole host.",
                "Take it out of the group (`CpuGroups.exe SetVmGroup /VmName:NAME /GroupId:"
                "00000000-0000-0000-0000-000000000000`), or check by hand that its group has room for its reserve.",
                address=address_of(machine),
            )
