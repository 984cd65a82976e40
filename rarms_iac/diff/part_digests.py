"""Whether a host has moved since it was looked at: a digest of every part that a plan rests on (DESIGN section 4).

Nothing that moves by itself is in them: no load, no uptime, no assigned memory.
"""

from collections.abc import Mapping

from rarms_iac.diff.readings import partition_readings, responsiveness_readings, task_readings
from rarms_iac.model.changes import Address
from rarms_iac.model.state import HostFacts, Partition, State, TaskClass
from rarms_iac.storage.digest import digest, short


def part_digests(state: State, application: str) -> Mapping[str, str]:
    """12 hex digits for each part of the state, by what people call it.

    Facts, every setting of what is ours, of other machines what weighs on the host, task classes with types,
    SystemResponsiveness, and the application's serial.
    """
    parts: dict[str, object] = {
        "the host itself": _facts(state.facts),
        "the count of applies": state.serials.get(application, 0),
    }
    for partition in state.partitions:
        if partition.mark is not None and partition.mark.application == application:
            attached = sorted(disk.path for disk in state.disks if disk.machine == partition.id)
            parts[f"partition/{partition.mark.name}"] = {**partition_readings(partition), "disks": attached}
        else:
            parts[f"machine {partition.settings.name} ({partition.id})"] = _weight(partition)
    inside: dict[str, dict[str, object]] = {}
    for task in state.tasks:
        if task.inside:
            # One digest a guest: there are eight classes in each, and hosts with hundreds of guests.
            inside.setdefault(_guest(task), {})[task.name] = dict(task_readings(task))
        else:
            parts[f"task/{task.name}"] = dict(task_readings(task))
    parts.update(inside)
    if state.responsiveness is not None:
        parts[str(Address(responsiveness=True))] = dict(responsiveness_readings(state.responsiveness))
    return {name: short(digest(part)) for name, part in parts.items()}


def what_moved(before: Mapping[str, str], after: Mapping[str, str]) -> tuple[str, ...]:
    """What is new, gone or changed, in words, by name; empty where nothing moved."""
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


def _weight(partition: Partition) -> dict[str, object]:
    settings = partition.settings
    return {
        "claims": partition.claims_resources,
        "processors": settings.processors,
        "reserve": settings.reserve,
        "limit": settings.limit,
        "memory": settings.memory,
    }


def _guest(task: TaskClass) -> str:
    guest = f"the list of task classes inside partition/{task.inside}"
    return f"{guest} (machine {task.machine})" if task.machine else guest
