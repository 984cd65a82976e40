"""Scripts run on Windows PowerShell 5.1 and on PowerShell 7."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity

FINDING = Finding(code="RARMS240", severity=Severity.ERROR, summary="The host's PowerShell is too old")


NEEDED = (5, 1)


def check(host: Examination) -> Iterator[Diagnostic]:
    """Tells of a PowerShell below 5.1; a version that is no number is none."""
    version = host.condition.powershell
    if version is not None and _numbers(version) < NEEDED:
        yield FINDING.at(
            host.place,
            f"{host.state.facts.name} runs PowerShell {version}; the scripts of rarms need 5.1 or 7.",
            "Install Windows Management Framework 5.1 or PowerShell 7 there; Windows 10 and Server 2016 bring 5.1.",
            address=host.address,
        )


def _numbers(version: str) -> tuple[int, ...]:
    major, _, rest = version.partition(".")
    minor = rest.partition(".")[0]
    return int(major) if major.isdecimal() else 0, int(minor) if minor.isdecimal() else 0
