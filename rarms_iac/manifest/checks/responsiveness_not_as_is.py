"""`system_responsiveness` says what MMCSS will do."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.responsiveness import OFF, is_taken_as_is, taken_for
from rarms_iac.model.system import Host, ProviderKind, System

FINDING = Finding(code="RARMS227", severity=Severity.ERROR, summary="A host cannot have this system_responsiveness")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of values that Windows takes for another one or as the end of MMCSS, and of hosts without MMCSS."""
    for host in system.hosts.values():
        if host.system_responsiveness is None:
            continue
        told = _told(host, host.system_responsiveness)
        if told is not None:
            says, advice = told
            yield FINDING.at(
                places.value("hosts", host.name, "system_responsiveness"), says, advice, address=f"host/{host.name}"
            )


def _told(host: Host, wanted: int) -> tuple[str, str] | None:
    if host.provider is ProviderKind.LINUX:
        return f'"{host.name}" is a Linux host, and MMCSS is of Windows.', "Remove `system_responsiveness`."
    if is_taken_as_is(wanted):
        return None
    advice = "Say 10, 20, ... 90; 20 is what Windows has by itself."
    if wanted == OFF:
        return f"{wanted} switches MMCSS off: no task class would have any effect.", advice
    why = "rounds down to tens" if 10 <= wanted <= OFF else "does so below 10 and above 100"
    return f"Windows would take {wanted} for {taken_for(wanted)}: it {why}.", advice
