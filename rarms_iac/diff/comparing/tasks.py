"""The changes of task classes, and the classes of others that stand in their way."""

import re

from rarms_iac.diff import findings
from rarms_iac.diff.comparing.wishes import Found, Wishes
from rarms_iac.diff.disruption import disruption_of_task
from rarms_iac.diff.ours import Ours
from rarms_iac.model.changes import Address, Create, Delete, Reason, Update
from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.model.names import is_shipped_task
from rarms_iac.model.state import RegistryValue, Responsiveness, State, TaskClass

_PATTERN = re.compile(r"[*?\[\]`]")


def task_changes(desired: State, ours: Ours, observed: State, application: str, wishes: Wishes) -> Found:
    """Task classes of the host and of the guests that are ours; what lies in other guests is not looked at."""
    found = Found()
    wanted = {(task.inside, task.name.lower()): task for task in desired.tasks}
    kept = {partition.settings.name for partition in desired.partitions} - wishes.unused
    machines = {machine.id for machine in ours.machines.values()}
    there = {
        (ours.new_names.get(task.inside, task.inside), task.name.lower()): task
        for task in observed.tasks
        if not task.inside or (task.inside in ours.new_names and (not task.machine or task.machine in machines))
    }
    for key in sorted({*wanted, *there}):
        # A partition that goes takes its classes along; one that is merely kept is left as it is inside.
        if key[0] and key[0] not in ours.machines and key in wanted and is_shipped_task(key[1]):
            found.findings.append(_guest_first(wanted[key], wishes))
        elif not key[0] or key[0] in kept:
            before, after = there.get(key), wanted.get(key)
            if after is not None:
                _wanted(found, before, after, application, wishes)
            elif before is not None and _is_ours(before, application):
                _no_longer_wanted(found, before, key[0])
    return found


def _is_ours(task: TaskClass, application: str) -> bool:
    return task.record is not None and task.record.application == application


def _no_longer_wanted(found: Found, before: TaskClass, inside: str) -> None:
    address = _task_address(inside, before)
    if lost := not_restorable(address, before, None):
        found.findings.append(lost)
        return
    found.changes.append(
        Delete(
            address=address,
            before=before,
            reason=Reason(says="no component here names it any more"),
            disruption=disruption_of_task(inside),
        )
    )


def _wanted(found: Found, before: TaskClass | None, after: TaskClass, application: str, wishes: Wishes) -> None:
    address = _task_address(after.inside, after, before)
    place, disruption = wishes.where(address), disruption_of_task(after.inside)
    if before is None or (not before.values and before.record is None):
        reason = Reason(says="a component names it", place=place)
        found.changes.append(Create(address=address, after=after, reason=reason, disruption=disruption))
        return
    is_ours = _is_ours(before, application)
    replaced = before.record is None and before.name.lower() in wishes.replaceable
    if not is_ours and not replaced:
        found.findings.append(_foreign_task(address, before, place))
    elif is_ours and dict(before.values) == dict(after.values) and after.record == before.record:
        found.unchanged += 1
    elif lost := not_restorable(address, before, place):
        found.findings.append(lost)
    else:
        reason = Reason(says="its values differ" if is_ours else "the manifest replaces it", place=place)
        found.changes.append(Update(address=address, before=before, after=after, reason=reason, disruption=disruption))


def not_restorable(address: Address, before: TaskClass | Responsiveness, place: Place | None) -> Diagnostic | None:
    """What is there, or was there before rarms, and could not be brought back as it is; None: all of it could."""
    kept = before.record.before if before.record else None
    odd = {
        name: why
        for name, registry_value in (*before.values.items(), *(kept or {}).items())
        if (why := _odd(name, registry_value))
    }
    if not odd:
        return None
    names = ", ".join(f"{name!r} ({why})" for name, why in sorted(odd.items()))
    return findings.NOT_RESTORABLE.at(
        place,
        f"{address} would be changed, and what it holds could not be brought back: {names}. MMCSS knows nothing such.",
        "Find out who wrote that, note it down, and take the value away by hand; then plan again.",
        address=str(address),
    )


def _odd(name: str, value: RegistryValue) -> str:
    """Why a value could not be brought back; empty where it could."""
    if not value.is_restorable:
        return value.kind.value
    # A cmdlet that takes a value away reads its name as a pattern: others could go along.
    return "its name is a pattern" if _PATTERN.search(name) else ""


def _task_address(inside: str, task: TaskClass, there: TaskClass | None = None) -> Address:
    return Address(partition=inside, task=task.name, machine=(there or task).machine)


def _guest_first(task: TaskClass, wishes: Wishes) -> Diagnostic:
    # What a guest ships with is kept, to be brought back; a guest that is not made yet cannot be read.
    address = Address(partition=task.inside, task=task.name)
    return findings.GUEST_FIRST.at(
        wishes.where(address),
        f"{task.inside} is made by this plan, and what {task.name} is there can only be read afterwards.",
        "Apply this plan, then plan again: the next plan replaces the class.",
        address=str(address),
    )


def _foreign_task(address: Address, before: TaskClass, place: Place | None) -> Diagnostic:
    if before.record is not None:
        says, advice = f"application {before.record.application!r} wrote it", "Name another class in one of the two."
    elif is_shipped_task(before.name):
        says, advice = "Windows ships it", f"Say `tasks.{before.name}.replace_shipped: true` if that is meant."
    else:
        says = "it was there before and carries no record of rarms"
        advice = "Name another class, or remove this one by hand if nothing else uses it."
    return findings.FOREIGN_TASK.at(
        place, f"Task class {before.name!r} is wanted, but {says}.", advice, address=str(address)
    )
