"""Desired and observed state to changes, touching nothing without a mark of this application.

Those of partitions are made here, with findings on machines in their way; those of task classes in `compare_tasks.py`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

from rarms_iac.diff.compare_tasks import responsiveness_changes, task_changes
from rarms_iac.diff.disruption import can_change_now, disruption_of_update, stops, why_memory_needs_off
from rarms_iac.diff.step_context import Difference, ManagedMachines, ManifestRules, StepContext, managed_machines
from rarms_iac.model.changes import Address, Change, Create, Delete, Reason, Update
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.model.facets import LABELS
from rarms_iac.model.state import Partition, RunState, State, StoppedBy
from rarms_iac.model.system import Disruption
from rarms_iac.texts.findings import FOREIGN_AT_NAME, MAY_NOT_CHANGE, Finding
from rarms_iac.texts.messages import in_a_row, quoted
from rarms_iac.texts.plans import setting_text


def compare(
    desired: State, observed: State, application: str, context: StepContext, rules: ManifestRules | None = None
) -> Difference:
    """Find the changes that make the observed host the desired one.

    What is desired and not there is created; what carries the application's mark and is not desired is deleted (a
    partition that the manifest merely no longer wants is desired: stopped). Machines and task classes without that
    mark are never part of a change; where one is in the way, a finding says so.

    Args:
        application: the application whose marks count.
        rules: moves, protection and places of the manifest; without them nothing is moved or protected.

    Returns:
        The changes sorted by address. A state compared with itself has none.
    """
    rules = rules or ManifestRules()
    wanted = {partition.settings.name: partition for partition in desired.partitions}
    managed = managed_machines(observed, application, wanted, rules)
    parts = (
        partition_changes(wanted, managed, observed, context, rules),
        task_changes(desired, managed, observed, rules),
        responsiveness_changes(desired.responsiveness, observed.responsiveness, application, rules),
    )
    changes = [change for part in parts for change in part.changes]
    return Difference(
        changes=sorted(changes, key=lambda change: change.address),
        unchanged=sum(part.unchanged for part in parts),
        unused=sorted(name for part in parts for name in part.unused),
        findings=[finding for part in parts for finding in part.findings],
    )


FOREIGN_MARK = Finding.warning("RARMS151", "A mark of rarms is not valid")
NOT_AT_REST = Finding.error("RARMS155", "A partition is in a state that does not allow changes")


_WORDS = {
    **LABELS,
    "quota_period_us": "period of the limit",
    "threads": "priorities of threads",
    "running": "whether it runs",
}


def partition_changes(
    wanted: Mapping[str, Partition],
    managed: ManagedMachines,
    observed: State,
    context: StepContext,
    rules: ManifestRules,
) -> Difference:
    """Return the changes of managed partitions; machines of others and marks that do not count are findings.

    Args:
        wanted: the desired partitions by name.
        managed: the machines that carry the application's mark.
        observed: the host, with all its machines.
        rules: what the manifest says apart from the desired partitions.

    Returns:
        Changes in the order of names; findings of moves, marks and machines in the way come before those of changes.
            Nothing is changed at an address with a machine in the way.
    """
    difference = Difference()
    in_the_way = list(_machines_in_the_way(wanted, managed, observed, rules))
    difference.findings += [*managed.findings, *foreign_marks(observed), *in_the_way]
    blocked = {diagnostic.address for diagnostic in in_the_way}
    for name in sorted({*wanted, *managed.machines}):
        if f"partition/{name}" in blocked:
            continue
        found = _partition_change(name, wanted.get(name), managed.machines.get(name), context, rules)
        if isinstance(found, Diagnostic):
            difference.findings.append(found)
        elif found is not None:
            difference.changes.append(found)
        elif name in rules.unused:
            difference.unused.append(name)
        else:
            difference.unchanged += 1
    return difference


def _partition_change(
    name: str, after: Partition | None, before: Partition | None, context: StepContext, rules: ManifestRules
) -> Change | Diagnostic | None:
    """Return the change of a partition, or why it cannot be made; None: nothing has to be changed."""
    address = Address(partition=name, machine=before.id if before else "")
    if before is None:
        assert after is not None
        return Create(
            address=address, after=after, reason=Reason(message="it does not exist", place=rules.locate(address))
        )
    if after is None:
        return _deletion(address, before, context, rules)
    return None if _is_unchanged(before, after) else _update(address, before, after, context, rules)


def _deletion(address: Address, before: Partition, context: StepContext, rules: ManifestRules) -> Delete | Diagnostic:
    place, is_unnamed = rules.locate(address), address.partition in rules.unnamed
    if is_unnamed and before.mark is not None and before.mark.protected:
        return _protected_before(address.partition)
    if address.partition in rules.protected:
        return _protected(address.partition, "it would be removed", place)
    if before.state in {RunState.BUSY, RunState.CRITICAL}:
        return not_at_rest(address, before.state, place)
    why = "it is no longer in the manifest" if is_unnamed else "it is not planned for this host"
    loses_nothing = is_unnamed and before.id in context.restorable
    disruption = Disruption.PARTITION_STOP if loses_nothing else Disruption.REMOVAL
    return Delete(address=address, before=before, reason=Reason(message=why, place=place), disruption=disruption)


def _update(
    address: Address, before: Partition, after: Partition, context: StepContext, rules: ManifestRules
) -> Update | Diagnostic:
    name, place = address.partition, rules.locate(address)
    disruption = disruption_of_update(before, after.settings, context)
    if disruption is Disruption.REMOVAL and name in rules.protected:
        return _protected(name, "a change of its generation removes it and creates it again", place)
    if not can_change_now(before, after.settings, context):
        return not_at_rest(address, before.state, place)
    unused = name in rules.unused
    why = "it is no longer in the manifest" if unused else _describe_difference(before, after, context)
    return Update(
        address=address,
        before=before,
        after=replace(after, id=before.id, other_notes=before.other_notes),
        reason=Reason(message=why, place=place),
        disruption=disruption,
    )


def _is_unchanged(before: Partition, after: Partition) -> bool:
    """Return whether neither settings nor mark need writing."""
    if before.settings != after.settings or before.mark is None or after.mark is None:
        return False
    return (before.mark.name, before.mark.written) == (after.mark.name, after.mark.written)


def _describe_difference(before: Partition, after: Partition, context: StepContext) -> str:
    stopped_by = before.mark.stopped_by if before.mark else StoppedBy.NO_USER
    if stopped_by is not StoppedBy.NO_USER and before.settings.running:
        return "rarms stopped it, and another tool started it"
    if stopped_by is StoppedBy.MEASUREMENT and after.settings.running:
        return "`rarms measure` stopped it and was interrupted"
    old, new = before.settings, after.settings
    differing = [_WORDS[name] for name in LABELS if setting_text(name, old) != setting_text(name, new)]
    if not differing and before.mark and after.mark and before.mark.protected != after.mark.protected:
        return f"its mark is {'protected' if after.mark.protected else 'not protected any more'}, as in the manifest"
    if not differing and before.mark and after.mark and before.mark.robot != after.mark.robot:
        return f"its mark does not name the robot {quoted(after.mark.robot)}"
    if not differing:
        return "its mark does not have the settings that were last written"
    stop = "; it is stopped to change that" if stops(before, after.settings, context) and after.settings.running else ""
    if stop and (why := why_memory_needs_off(before, after.settings, context)):
        stop += f" (memory: {why})"
    return f"the host differs from the manifest in {in_a_row(differing)}{stop}"


def foreign_marks(observed: State) -> Iterator[Diagnostic]:
    """Report each machine with a line that looks like a mark and does not count.

    Yields:
        A finding for each such machine, in the order of the host's partitions.
    """
    for partition in observed.partitions:
        if partition.foreign_mark:
            yield FOREIGN_MARK.at(
                None,
                (
                    "Machine {name:quoted} ({machine}) has a line that looks like a mark of rarms, but "
                    "{foreign_mark}. rarms does not manage this machine."
                ),
                prose(
                    "Remove the line from its notes, or import the correct machine with ",
                    command("import", "PARTITION", id="ID"),
                    ".",
                ),
                address=f"machine/{partition.id}",
                host=observed.facts.name,
                name=partition.settings.name,
                machine=partition.id,
                foreign_mark=partition.foreign_mark,
            )


def _machines_in_the_way(
    wanted: Mapping[str, Partition], managed: ManagedMachines, observed: State, rules: ManifestRules
) -> Iterator[Diagnostic]:
    """Find unmanaged machines that have the name of a wanted partition."""
    for partition in observed.partitions:
        name = partition.settings.name
        is_managed = partition.mark is not None and partition.mark.application == managed.application
        if is_managed or name not in wanted:
            continue
        holder = managed.machines.get(name)
        if holder is not None and holder.settings.name == name:
            continue  # ours has the name too: names need not be unique, and nothing has to be renamed
        yield machine_in_the_way(partition, rules.locate(Address(partition=name)))


def machine_in_the_way(machine: Partition, place: Place | None) -> Diagnostic:
    """Return the finding about a machine of others that has the name of a wanted partition.

    Args:
        place: the manifest line that asks for the partition of its name.

    Returns:
        An error that offers to import the machine or to rename the partition.
    """
    name = machine.settings.name
    owner = (
        f"belongs to application {quoted(machine.mark.application)}"
        if machine.mark
        else "does not have a mark of rarms"
    )
    return FOREIGN_AT_NAME.at(
        place,
        "The host has a machine {partition:quoted} (id {machine}) that {owner}.",
        prose("Run ", command("import", name, id=machine.id), " to import it, or give the partition another name."),
        address=f"partition/{name}",
        partition=name,
        machine=machine.id,
        application=machine.mark.application if machine.mark else "",
        owner=owner,
    )


def _protected(name: str, why: str, place: Place | None) -> Diagnostic:
    return MAY_NOT_CHANGE.at(
        place,
        "Partition {partition:quoted} has `protect: true`, but {reason}.",
        "First remove `protect` in a separate change, or keep the partition.",
        address=f"partition/{name}",
        partition=name,
        reason=why,
    )


def _protected_before(name: str) -> Diagnostic:
    return MAY_NOT_CHANGE.at(
        None,
        (
            "Partition {partition:quoted} had `protect: true` when it was last applied, but it is no longer in the "
            "manifest."
        ),
        prose(
            "Add it again without `protect`, apply, and then remove it. To keep it without rarms: ",
            command("release", name),
            ".",
        ),
        address=f"partition/{name}",
        partition=name,
    )


def not_at_rest(address: Address, state: RunState, place: Place | None) -> Diagnostic:
    """Return the finding about a partition that is neither off nor running.

    Args:
        place: the manifest line that asks for it.

    Returns:
        An error that says how to bring it to rest.
    """
    advice = {
        RunState.SAVED: "Start it, or discard its saved state, and plan again.",
        RunState.PAUSED: "Resume it or turn it off, and plan again.",
        RunState.CRITICAL: "Restore its storage, or remove it in Hyper-V, and plan again.",
    }.get(state, "Wait until it is off or running, and plan again.")
    return NOT_AT_REST.at(
        place,
        "Partition {partition:quoted} is {state}, but the changes need it off or running.",
        advice,
        address=str(address),
        partition=address.partition,
        state=state.value,
    )
