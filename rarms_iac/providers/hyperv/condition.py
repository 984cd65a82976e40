"""The condition of a host, which an observation shows with the State, and findings about it. Pure."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.seen_host import Condition, PolicyScope
from rarms_iac.model.state import Rights
from rarms_iac.providers.hyperv.observation import HostObservation, ObservedMachine, Unread, is_unread, or_else
from rarms_iac.providers.hyperv.parse import (
    JOURNAL,
    UnusableJournal,
    last_run_of,
    processor_settings,
    responsiveness_of,
    rights_of,
)
from rarms_iac.providers.interface import HostFailed
from rarms_iac.texts.findings import DAMAGED, ROUNDED
from rarms_iac.texts.messages import quoted

NO_NAMESPACE, NO_CLASS = "0x8004100e", "0x80041010"


def condition_of(observation: HostObservation) -> Condition:
    """Return the condition of the host, as far as it could be looked at."""
    powershell, windows = or_else(observation.powershell, None), or_else(observation.windows, None)
    sockets, nodes = or_else(observation.processors, None), or_else(observation.numa, None)
    visible, counters = observation.host_visible, observation.counters
    responsiveness = responsiveness_of(observation)
    return Condition(
        powershell=powershell.version if powershell else None,
        bits=windows.bits if windows else None,
        policies={
            PolicyScope(policy.scope): policy.policy
            for policy in or_else(observation.execution_policy, ())
            if policy.scope in {*PolicyScope}
        },
        module=or_else(observation.module, None),
        # Without the role Windows has no such namespace (windows.md 5).
        role=False if _lacks(visible, NO_NAMESPACE) else None if isinstance(visible, Unread) else True,
        hypervisor_running=or_else(observation.hypervisor_running, None),
        counters=False if _lacks(counters, NO_CLASS) else or_else(counters, None),
        elevated=or_else(observation.elevated, None),
        hyperv_administrator=or_else(observation.hyperv_administrator, None),
        script_running=or_else(observation.script_running, None),
        seen_processors=sum(socket.logical for socket in sockets) if sockets else None,
        numa_nodes=len(nodes) if nodes else None,
        responsiveness=responsiveness.value if responsiveness else None,
        unread=dict(_unread(observation)),
    )


def _lacks(probe: object, error: str) -> bool:
    return isinstance(probe, Unread) and error in probe.error.lower()


_LOOKED_AT = {
    "the version of PowerShell": "powershell",
    "the version of Windows": "windows",
    "the number of processors in Windows": "processors",
    "the NUMA nodes": "numa",
    "the CPU groups": "cpu_groups",
    "the multimedia task classes": "tasks",
    "the execution policy": "execution_policy",
}
"""Probes that a check or a plan uses; whose absence is reported elsewhere (rights, module, scheduler), or is normal
(journal, records), is not here."""


def _unread(observation: HostObservation) -> Iterator[tuple[str, str]]:
    for title, name in _LOOKED_AT.items():
        probe = getattr(observation, name)
        if isinstance(probe, Unread) and not _lacks(probe, NO_NAMESPACE):  # that is a finding of its own
            yield title, f"{probe.status} ({probe.error})" if probe.error else probe.status
    yield from _unread_machines(observation)


def _unread_machines(observation: HostObservation) -> Iterator[tuple[str, str]]:
    for machine in or_else(observation.unread_machines, ()):
        yield f"machine {quoted(machine.name)} ({machine.id})", f"{quoted(machine.message)} ({machine.error})"


_REGISTRY = {"its task classes": "tasks", r"its records in HKLM\SOFTWARE\rarms": "records"}
_OF_HOST = {"its machines": "machines", r"%ProgramData%\rarms\journal.jsonl": "journal", **_REGISTRY}


def unread_error(observation: HostObservation, host: str, *, guest: bool = False) -> HostFailed | None:
    """Make the error of an observation in which something was not read that a plan uses: that is not empty.

    Args:
        observation: of a host, or of the Windows inside a guest.

    Returns:
        None where all was read; also where the caller has no right to see machines, which is a finding of its own.
    """
    probes = {title: getattr(observation, name) for title, name in (_REGISTRY if guest else _OF_HOST).items()}
    unread = {title: f"{quoted(probe.message)} ({probe.error})" for title, probe in probes.items() if is_unread(probe)}
    if not guest:
        unread |= dict(_unread_machines(observation))
    if not unread or (not guest and rights_of(observation) is Rights.MISSING):
        return None
    message = "some values could not be read: " + "; ".join(f"{title}: {why}" for title, why in unread.items())
    return HostFailed(
        host, message, "Check the cause as an administrator of that Windows, then run the same command again."
    )


THOUSANDTHS = 1000
"""Of these a per cent has so many in WMI, while cmdlets show whole ones (windows.md 1.3)."""


def findings_of(observation: HostObservation, host: str) -> tuple[Diagnostic, ...]:
    """Return the findings about the host that the manifest calls so."""
    return (*_journal_findings(observation, host), *_reserve_findings(observation, host))


def _reserve_findings(observation: HostObservation, host: str) -> Iterator[Diagnostic]:
    thousandths = {machine: setting.reservation for machine, setting in processor_settings(observation)}
    for machine in sorted(or_else(observation.machines, ()), key=lambda machine: (machine.name, machine.id)):
        reserve = thousandths.get(machine.id, 0)
        if reserve % THOUSANDTHS:
            yield _not_whole(machine, reserve, host)


def _not_whole(machine: ObservedMachine, reserve: int, host: str) -> Diagnostic:
    exact = f"{reserve / THOUSANDTHS:.3f}".rstrip("0")
    return ROUNDED.at(
        None,
        (
            "WMI has a reserve of {exact} % for machine {name:quoted} ({machine}), but the cmdlets show "
            "{cmdlets_percent} %. Another tool wrote a value that the cmdlets cannot write."
        ),
        "Set a whole per cent with Set-VMProcessor -Reserve. Until then, plans use the value of the cmdlets.",
        address=f"machine/{machine.id}",
        host=host,
        machine=machine.id,
        name=machine.name,
        reserve_percent=reserve / THOUSANDTHS,
        cmdlets_percent=machine.reserve,
        exact=exact,
    )


def _journal_findings(observation: HostObservation, host: str) -> Iterator[Diagnostic]:
    run = last_run_of(observation)
    if isinstance(run, UnusableJournal):
        yield DAMAGED.of_host(host, JOURNAL + " of {host} {problem}.", run.advice, problem=run.problem)
