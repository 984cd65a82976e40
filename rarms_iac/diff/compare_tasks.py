"""Changes of what MMCSS reads on a host and in its guests: task classes, and SystemResponsiveness."""

import re

from rarms_iac.diff.disruption import disruption_of_task
from rarms_iac.diff.step_context import Difference, ManagedMachines, ManifestRules
from rarms_iac.model.changes import RESPONSIVENESS, Address, Create, Delete, Reason, Update
from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.model.names import POWERSHELL_MEMBERS, is_shipped_task
from rarms_iac.model.state import RegistryValue, Responsiveness, State, TaskClass
from rarms_iac.texts.findings import FOREIGN_AT_NAME, NO_RESPONSIVENESS, Finding
from rarms_iac.texts.messages import quoted

GUEST_FIRST = Finding.note("RARMS157", "The next plan replaces a task class of Windows in a new guest")


_PATTERN = re.compile(r"[*?\[\]`]")


def task_changes(desired: State, managed: ManagedMachines, observed: State, rules: ManifestRules) -> Difference:
    """Return the changes of task classes of the host and of managed guests; those of other guests are not looked at.

    Args:
        managed: the machines that carry the application's mark.
        rules: which shipped classes may be replaced, and where the manifest says so.

    Returns:
        Changes and findings, the host's classes first, then by partition and class.
    """
    difference = Difference()
    wanted = {(task.inside, task.name.lower()): task for task in desired.tasks}
    used = {partition.settings.name for partition in desired.partitions} - rules.unused
    machines = {machine.id for machine in managed.machines.values()}
    present = {
        (managed.new_names.get(task.inside, task.inside), task.name.lower()): task
        for task in observed.tasks
        if not task.inside or (task.inside in managed.new_names and (not task.machine or task.machine in machines))
    }
    for key in sorted({*wanted, *present}):
        # A partition that goes takes its classes along; one that is unused is left as it is inside.
        if key[0] and key[0] not in managed.machines and key in wanted and is_shipped_task(key[1]):
            difference.findings.append(_guest_first(wanted[key], rules))
        elif not key[0] or key[0] in used:
            before, after = present.get(key), wanted.get(key)
            if after is not None:
                _compare_wanted(difference, before, after, managed.application, rules)
            elif before is not None and _is_managed(before, managed.application):
                _remove(difference, before, key[0])
    return difference


def _is_managed(resource: TaskClass | Responsiveness, application: str) -> bool:
    return resource.record is not None and resource.record.application == application


def _remove(difference: Difference, before: TaskClass, inside: str) -> None:
    address = _task_address(inside, before)
    if problem := not_restorable(address, before, None):
        difference.findings.append(problem)
        return
    reason = Reason(message="no component of this system uses it now")
    difference.changes.append(
        Delete(address=address, before=before, reason=reason, disruption=disruption_of_task(inside))
    )


def _compare_wanted(
    difference: Difference, before: TaskClass | None, after: TaskClass, application: str, rules: ManifestRules
) -> None:
    address = _task_address(after.inside, after, before)
    place, disruption = rules.locate(address), disruption_of_task(after.inside)
    if before is None or (not before.values and before.record is None):
        reason = Reason(message="a component uses it", place=place)
        difference.changes.append(Create(address=address, after=after, reason=reason, disruption=disruption))
        return
    is_managed = _is_managed(before, application)
    replaced = before.record is None and before.name.lower() in rules.replaceable
    if not is_managed and not replaced:
        difference.findings.append(_foreign_task(address, before, place))
    elif is_managed and dict(before.values) == dict(after.values) and after.record == before.record:
        difference.unchanged += 1
    elif problem := not_restorable(address, before, place):
        difference.findings.append(problem)
    else:
        reason = Reason(message="its values differ" if is_managed else "the manifest replaces it", place=place)
        difference.changes.append(
            Update(address=address, before=before, after=after, reason=reason, disruption=disruption)
        )


def not_restorable(address: Address, before: TaskClass | Responsiveness, place: Place | None) -> Diagnostic | None:
    """Return the finding about values that an undo could not write back, those from before rarms included.

    Args:
        address: the task class, or SystemResponsiveness.
        before: its values as observed, with those that rarms recorded.
        place: the manifest line that asks for the change.

    Returns:
        None where every value is of a type that scripts write, under a name that is not a pattern.
    """
    recorded = before.record.before if before.record else None
    problems = {
        name: why
        for name, value in (*before.values.items(), *(recorded or {}).items())
        if (why := _why_not_restorable(name, value))
    }
    if not problems:
        return None
    names = ", ".join(f"{quoted(name or '(Default)')} ({why})" for name, why in sorted(problems.items()))
    return FOREIGN_AT_NAME.at(
        place,
        (
            "{resource} would be changed, but these values could not be restored: {_names}. MMCSS does not "
            "use such values."
        ),
        "Find out who wrote the value and note it. Remove it by hand, then plan again.",
        address=str(address),
        resource=str(address),
        value_names=tuple(sorted(problems)),
        _names=names,
    )


def _why_not_restorable(name: str, value: RegistryValue) -> str:
    if not value.is_restorable:
        return value.kind.value
    if name.lower() in {"", "(default)"}:
        return "the default value of the key, which no cmdlet can remove"  # they want a name, and match it with none
    if name.lower() in POWERSHELL_MEMBERS:
        return "its name is reserved in PowerShell"  # a record that holds it cannot be read
    # A cmdlet that takes a value away reads its name as a pattern: others could go along.
    return "PowerShell reads its name as a pattern" if _PATTERN.search(name) else ""


def _task_address(inside: str, task: TaskClass, present: TaskClass | None = None) -> Address:
    return Address(partition=inside, task=task.name, machine=(present or task).machine)


def _guest_first(task: TaskClass, rules: ManifestRules) -> Diagnostic:
    # What a guest ships with is kept, to be brought back; a guest that is not made yet cannot be read.
    address = Address(partition=task.inside, task=task.name)
    return GUEST_FIRST.at(
        rules.locate(address),
        "This plan creates {partition}. The values of {task} in it can be read only afterwards.",
        "Apply this plan, then plan again: the next plan replaces the class.",
        address=str(address),
        partition=task.inside,
        task=task.name,
    )


def _foreign_task(address: Address, before: TaskClass, place: Place | None) -> Diagnostic:
    if before.record is not None:
        owner = f"the application {quoted(before.record.application)} wrote it"
        advice = "Use another class in one of the two applications."
    elif is_shipped_task(before.name):
        owner, advice = "it comes with Windows", f"To replace it, write `tasks.{before.name}.replace_shipped: true`."
    else:
        owner = "it already exists and rarms did not write it"
        advice = "Use another class, or remove this one by hand if nothing else uses it."
    return FOREIGN_AT_NAME.at(
        place,
        "rarms cannot write the task class {task:quoted}: {reason}.",
        advice,
        address=str(address),
        task=before.name,
        reason=owner,
    )


def responsiveness_changes(
    after: Responsiveness | None, before: Responsiveness | None, application: str, rules: ManifestRules
) -> Difference:
    """Return the change of SystemResponsiveness.

    Unlike a task class of others the value may be taken over: Windows sets it itself, and it is brought back.

    Args:
        after: what the manifest sets; None: it leaves the value as it is.
        before: what is there; None: it could not be looked at.
        application: the application whose record counts.

    Returns:
        At most one change, or the finding that the value could not be brought back; nothing where it is as wanted.
    """
    difference = Difference()
    record = before.record if before else None
    is_managed = before is not None and _is_managed(before, application)
    disruption = disruption_of_task("")
    if after is None:
        if before is None or not is_managed:
            return difference
        if problem := not_restorable(RESPONSIVENESS, before, None):
            difference.findings.append(problem)
        else:
            reason = Reason(message=f"the manifest no longer sets it; {_describe_restored(before)}")
            difference.changes.append(
                Delete(address=RESPONSIVENESS, before=before, reason=reason, disruption=disruption)
            )
        return difference
    place = rules.locate(RESPONSIVENESS)
    reason = Reason(message="the manifest sets it", place=place)
    if before is None or (record is not None and not is_managed):
        difference.findings.append(_undecided(record.application if record else "", place))
    elif before == after:
        difference.unchanged += 1
    elif problem := not_restorable(RESPONSIVENESS, before, place):
        difference.findings.append(problem)
    elif before.value is None and record is None:
        difference.changes.append(Create(address=RESPONSIVENESS, after=after, reason=reason, disruption=disruption))
    else:
        difference.changes.append(
            Update(address=RESPONSIVENESS, before=before, after=after, reason=reason, disruption=disruption)
        )
    return difference


def _describe_restored(before: Responsiveness) -> str:
    recorded = before.record.before if before.record else None
    if not recorded:
        return "it did not exist before"
    return f"{', '.join(str(value.data) for value in recorded.values())} is restored"


def _undecided(application: str, place: Place | None) -> Diagnostic:
    if application:
        why = f"application {quoted(application)} set it"
        advice = "Remove `system_responsiveness` from one of the two manifests."
    else:
        why = "its present value could not be read, so it could not be restored"
        advice = "Plan again with the rights of an administrator."
    return NO_RESPONSIVENESS.at(
        place,
        "rarms cannot set `system_responsiveness`: {_why}.",
        advice,
        address=str(RESPONSIVENESS),
        application=application,
        _why=why,
    )
