"""Whether a host changed since it was observed: a digest of every part that a plan rests on.

Nothing that moves by itself is in them: no load, no uptime, no assigned memory.
"""

from collections.abc import Mapping

from rarms_iac.diff.readings import partition_readings, task_readings
from rarms_iac.model.changes import RESPONSIVENESS
from rarms_iac.model.state import HostFacts, Partition, State, TaskClass
from rarms_iac.storage.digest import digest, short

NO_PERIOD = ("quota_period_us", 0)
"""The reading that only limited partitions of Linux have: the digests of all others do not tell it."""


def part_digests(state: State, application: str) -> Mapping[str, str]:
    """Digest each part of the state that a plan rests on.

    Args:
        state: the host as observed.
        application: the application that the plan belongs to; machines of others count only with what they claim.

    Returns:
        12 hex digits by what people call the part: facts, every setting of managed partitions, claims of other
        machines, task classes with types, SystemResponsiveness, and the application's serial.
    """
    parts: dict[str, object] = {
        "the host itself": _facts(state.facts),
        "the count of applies": state.serials.get(application, 0),
    }
    for partition in state.partitions:
        if partition.mark is not None and partition.mark.application == application:
            attached = sorted(disk.path for disk in state.disks if disk.machine == partition.id)
            parts[f"partition/{partition.mark.name}"] = {
                **{name: value for name, value in partition_readings(partition).items() if (name, value) != NO_PERIOD},
                "disks": attached,
                "takes": partition.claim.processors,
            }
        else:
            parts[f"machine {partition.settings.name} ({partition.id})"] = _claims_on_host(partition)
    guests: dict[str, dict[str, object]] = {}
    for task in state.tasks:
        if task.inside:
            # One digest a guest: there are eight classes in each, and hosts with hundreds of guests.
            guests.setdefault(_guest_title(task), {})[task.name] = dict(task_readings(task))
        else:
            parts[f"task/{task.name}"] = dict(task_readings(task))
    parts.update(guests)
    if state.responsiveness is not None:
        parts[str(RESPONSIVENESS)] = dict(task_readings(state.responsiveness))
    return {name: short(digest(part)) for name, part in parts.items()}


def moved_parts(before: Mapping[str, str], after: Mapping[str, str]) -> tuple[str, ...]:
    """Compare two digests of a host.

    Args:
        before: by part of the host, as `part_digests` made them when the plan was made.
        after: the same of the host as it is now.

    Returns:
        What is new, gone or changed, in words, by name; empty where the host is as it was.
    """
    gone = (f"{name} is gone" for name in before.keys() - after.keys())
    new = (f"{name} is new" for name in after.keys() - before.keys())
    changed = (f"{name} has changed" for name in before.keys() & after.keys() if before[name] != after[name])
    return tuple(sorted([*gone, *new, *changed]))


def _facts(facts: HostFacts) -> dict[str, object]:
    return {
        "id": facts.id,
        "computer": facts.computer_name,
        "build": facts.os_build,
        "processors": facts.logical_processors,
        "smt": facts.smt,
        "scheduler": facts.scheduler.value,
        "memory": facts.memory,
        "rights": facts.rights.value,
    }


def _claims_on_host(partition: Partition) -> dict[str, object]:
    settings = partition.settings
    return {
        "claims": partition.claims_resources,
        "processors": settings.processors,
        "takes": partition.claim.processors,
        "reserve": settings.reserve,
        "limit": settings.limit,
        "memory": settings.memory,
    }


def _guest_title(task: TaskClass) -> str:
    guest = f"the list of task classes inside partition/{task.inside}"
    return f"{guest} (machine {task.machine})" if task.machine else guest
