"""SystemResponsiveness says how much of a processor MMCSS leaves to everybody else (FACTS 6.1)."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.mmcss import OFF, USUAL, taken_for
from rarms_iac.model.state import RegistryValue, ValueKind

FINDING = Finding(
    code="RARMS230",
    severity=Severity.WARNING,
    summary="SystemResponsiveness is not a value that Windows takes as it is",
)


def effective(value: RegistryValue | None) -> int:
    """What Windows makes of the value; of one that is missing or of another type, the usual one."""
    if value is None or value.kind is not ValueKind.DWORD or not isinstance(value.data, int):
        return USUAL
    return taken_for(value.data)


def check(host: Examination) -> Iterator[Diagnostic]:
    """Tells of a value that Windows reads as another one, and of the one that switches task classes off."""
    value = host.condition.responsiveness
    if value is None:
        return
    means = effective(value)
    name = host.state.facts.name
    if means == OFF:
        says = f"{name}: SystemResponsiveness is {value.data}, which switches the multimedia class scheduler off"
    elif value.kind is not ValueKind.DWORD:
        says = f"{name}: SystemResponsiveness is {value.data!r}, of the type {value.kind.value} and not dword"
    elif value.data != means:
        says = f"{name}: SystemResponsiveness is {value.data}, which Windows takes for {means}"
    else:
        return
    yield FINDING.at(
        host.place,
        f"{says}. Task classes of components with `runs_on: host` rest on it.",
        "Set a DWORD of 10, 20, ... 90 and restart the host: 20 leaves a fifth of a processor to everybody else.",
        address=host.address,
    )
