"""Scripts are made of the cmdlets of the module Hyper-V."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity

FINDING = Finding(code="RARMS233", severity=Severity.ERROR, summary="The Hyper-V module is not installed")


def check(host: Examination) -> Iterator[Diagnostic]:
    """Tells of a Windows without the module."""
    if host.condition.module == ():
        yield FINDING.at(
            host.place,
            f"{host.state.facts.name}: its PowerShell has no module Hyper-V.",
            "Install it: on a server `Install-WindowsFeature Hyper-V-PowerShell` (with the role: `-Name Hyper-V "
            "-IncludeManagementTools`), on a client Windows the feature "
            "`Microsoft-Hyper-V-Management-PowerShell`.",
            address=host.address,
        )
