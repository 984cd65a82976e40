"""An observation as the condition of a host: what only `rarms doctor` asks for. Pure."""

import re
from collections.abc import Iterator, Mapping
from typing import TypeVar

from rarms_iac.model.condition import HostCondition, MachineCondition, PolicyScope
from rarms_iac.model.state import RegistryValue
from rarms_iac.providers.hyperv.observation import (
    HostObservation,
    ObservedMachine,
    Probe,
    ReadProbe,
    UnreadProbe,
    or_else,
)
from rarms_iac.providers.hyperv.parse import responsiveness_of

T = TypeVar("T")

NO_GROUP = "00000000-0000-0000-0000-000000000000"
_INSTANCE = re.compile(r"Microsoft:(?P<id>[0-9a-fA-F-]{36})\\")


def condition_of(seen: HostObservation) -> HostCondition:
    """How the host is, as far as it could be looked at."""
    powershell = seen.powershell.value if isinstance(seen.powershell, ReadProbe) else None
    windows = seen.windows.value if isinstance(seen.windows, ReadProbe) else None
    sockets = _value(seen.processors)
    nodes = _value(seen.numa)
    groups = _groups(seen)
    return HostCondition(
        powershell=powershell.version if powershell else None,
        bits=windows.bits if windows else None,
        policies={
            PolicyScope(policy.scope): policy.policy
            for policy in or_else(seen.execution_policy, ())
            if _known(policy.scope)
        },
        module=_value(seen.module),
        power_plans=_value(seen.power_plan),
        pending_restart=_value(seen.pending_restart),
        seen_processors=sum(socket.logical for socket in sockets) if sockets else None,
        numa_nodes=len(nodes) if nodes else None,
        machines=tuple(_machine(machine, groups.get(machine.id, "")) for machine in or_else(seen.machines, ())),
        responsiveness=_responsiveness(seen),
        unread=dict(_unread(seen)),
    )


def _machine(machine: ObservedMachine, group: str) -> MachineCondition:
    return MachineCondition(
        id=machine.id,
        automatic_checkpoints=machine.automatic_checkpoints == "True",
        clustered=machine.clustered == "True",
        group=group,
    )


def _groups(seen: HostObservation) -> Mapping[str, str]:
    """By id of a machine: its CPU group, where it is in one. Settings of checkpoints carry other ids."""
    found = {}
    for setting in or_else(seen.cpu_groups, ()):
        instance = _INSTANCE.match(setting.instance)
        group = setting.group.strip("{}").lower()
        if instance and group and group != NO_GROUP:
            found[instance["id"].lower()] = group
    return found


def _responsiveness(seen: HostObservation) -> RegistryValue | None:
    there = responsiveness_of(seen)
    return there.value if there else None


def _known(scope: str) -> bool:
    return scope in {one.value for one in PolicyScope}


_LOOKED_AT = {
    "the version of PowerShell": "powershell",
    "the version of Windows": "windows",
    "the number of processors that Windows sees": "processors",
    "the NUMA nodes": "numa",
    "the CPU groups": "cpu_groups",
    "the multimedia task classes": "tasks",
    "the power plan": "power_plan",
    "a pending restart": "pending_restart",
    "the execution policy": "execution_policy",
}
"""What a check or a plan rests on; whose absence is told elsewhere (rights, module, scheduler), or is normal
(journal, records), is not here."""


def _unread(seen: HostObservation) -> Iterator[tuple[str, str]]:
    for what, name in _LOOKED_AT.items():
        probe = getattr(seen, name)
        if isinstance(probe, UnreadProbe):
            why = "denied" if probe.denied else "absent"
            yield what, f"{why} ({probe.error})" if probe.error else why


def _value(probe: Probe[T]) -> T | None:
    return probe.value if isinstance(probe, ReadProbe) else None
