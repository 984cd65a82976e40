"""A 32-bit process is shown another registry (FACTS 6.6)."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity

FINDING = Finding(code="RARMS242", severity=Severity.ERROR, summary="The host was looked at by a 32-bit process")


def check(host: Examination) -> Iterator[Diagnostic]:
    """Tells of a PowerShell of less than 64 bits."""
    bits = host.condition.bits
    if bits is not None and bits < 64:
        yield FINDING.at(
            host.place,
            f"{host.state.facts.name} was looked at by a PowerShell of {bits} bits: Windows shows it another part of "
            "the registry, so its task classes are not those that count.",
            "Start the 64-bit one: `%windir%\\System32\\WindowsPowerShell\\v1.0\\powershell.exe`, not the one in "
            "SysWOW64 or of a 32-bit program.",
            address=host.address,
        )
