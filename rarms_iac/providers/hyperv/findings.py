"""What an observation shows beside the State, and a plan's reader should know."""

import re
from collections.abc import Iterator, Mapping

from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.providers.hyperv.journal import JournalDamaged, JournalPlanted
from rarms_iac.providers.hyperv.observation import HostObservation, ObservedMachine, or_else
from rarms_iac.providers.hyperv.parse import last_run_of

NOT_WHOLE = Finding(code="RARMS161", severity=Severity.WARNING, summary="A reserve is no whole per cent")
JOURNAL = Finding(code="RARMS163", severity=Severity.ERROR, summary="The journal of a Hyper-V host cannot be believed")

THOUSANDTHS = 1000
"""Of these a per cent has so many in WMI, while cmdlets show whole ones (FACTS 1.3)."""

_INSTANCE = re.compile(r"Microsoft:(?P<id>[0-9a-fA-F-]{36})\\")


def findings_of(seen: HostObservation, host: str) -> tuple[Diagnostic, ...]:
    """What is told of the host that the manifest calls so."""
    return (*_journal(seen, host), *_reserves(seen))


def fine_reserves(seen: HostObservation) -> Mapping[str, int]:
    """By id of a machine: its reserve in thousandths of a per cent, as WMI has it. Checkpoints are left out."""
    ids = {one.id for one in or_else(seen.machines, ())}
    found: dict[str, int] = {}
    for setting in or_else(seen.cpu_groups, ()):
        machine = _INSTANCE.match(setting.instance)
        if machine and machine["id"].lower() in ids:
            found[machine["id"].lower()] = setting.reservation
    return found


def _reserves(seen: HostObservation) -> Iterator[Diagnostic]:
    fine = fine_reserves(seen)
    for machine in sorted(or_else(seen.machines, ()), key=lambda one: (one.name, one.id)):
        reserve = fine.get(machine.id, 0)
        if reserve % THOUSANDTHS:
            yield _not_whole(machine, reserve)


def _not_whole(machine: ObservedMachine, reserve: int) -> Diagnostic:
    exact = f"{reserve / THOUSANDTHS:.3f}".rstrip("0")
    return NOT_WHOLE.at(
        None,
        f"WMI has a reserve of {exact} % for machine {machine.name!r} ({machine.id}), the cmdlets show "
        f"{machine.reserve} %: another tool wrote it, and no cmdlet can.",
        "Set a whole per cent with Set-VMProcessor -Reserve; until then plans count what the cmdlets show.",
        address=f"machine/{machine.id}",
    )


def _journal(seen: HostObservation, host: str) -> Iterator[Diagnostic]:
    match last_run_of(seen):
        case JournalPlanted(owner=owner):
            yield JOURNAL.at(
                None,
                f"%ProgramData%\\rarms\\journal.jsonl of {host} belongs to {owner}, not to Administrators or SYSTEM.",
                "Find out who put it there, then remove it. A script refuses to run beside it.",
                address=f"host/{host}",
            )
        case JournalDamaged(says=says):
            yield JOURNAL.at(
                None,
                f"%ProgramData%\\rarms\\journal.jsonl of {host} is damaged: {says}.",
                "Look at the host to see what the last run did, then remove the file.",
                address=f"host/{host}",
            )
        case _:
            return
