"""Desired x observed -> changes, touching nothing that carries no mark of this application (DESIGN section 4)."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

from rarms_iac.diff import findings
from rarms_iac.diff.disruption import (
    Surroundings,
    disruption_of_task,
    disruption_of_update,
    facets,
    is_at_rest,
    stops,
)
from rarms_iac.diff.moves import Ours, ours_of
from rarms_iac.diff.responsiveness_steps import ADDRESS as RESPONSIVENESS
from rarms_iac.model.changes import Address, Change, Create, Delete, Reason, Update
from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.model.names import is_shipped_task
from rarms_iac.model.state import Facet, Partition, Responsiveness, RunState, State, TaskClass
from rarms_iac.model.system import Disruption


def nowhere(_address: Address) -> Place | None:
    """The place of what no manifest line asks for."""
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Wishes:
    """What the manifest says beside the desired state."""

    moved: Mapping[str, str] = field(default_factory=dict)  # old partition name -> new
    protected: frozenset[str] = frozenset()  # partitions that must not be removed
    replaceable: frozenset[str] = frozenset()  # shipped task classes that may be replaced, in lower case
    unused: frozenset[str] = frozenset()  # partitions of ours that the manifest no longer wants: stopped, not removed
    where: Callable[[Address], Place | None] = nowhere  # the manifest line that asks for it


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """What has to change on a host, by address, and what stands in the way."""

    changes: tuple[Change, ...]
    unchanged: int  # resources that are as wanted; unused partitions are not counted
    unused: tuple[str, ...]  # partitions that are only listed: stopped already, automatic start off
    findings: tuple[Diagnostic, ...]


def compare(
    desired: State, observed: State, application: str, around: Surroundings, wishes: Wishes | None = None
) -> Difference:
    """The changes that make the observed host the desired one.

    What is desired and not there is created; what carries our mark and is not desired is deleted (a partition that
    the manifest merely no longer wants is desired: stopped). Machines and task classes without our mark are never
    part of a change; where one is in the way, a finding says so.
    """
    wishes = wishes or Wishes()
    wanted = {one.settings.name: one for one in desired.partitions}
    ours = ours_of(observed, application, wanted, wishes.moved, wishes.where)
    parts = (
        _partitions(wanted, ours, observed, application, around, wishes),
        _tasks(desired, ours, observed, application, wishes),
        _responsiveness(desired.responsiveness, observed.responsiveness, application, wishes),
    )
    at_rest = tuple(name for part in parts for name in part.unused)
    return Difference(
        changes=tuple(sorted((one for part in parts for one in part.changes), key=lambda one: one.address)),
        unchanged=sum(part.unchanged for part in parts),
        unused=tuple(sorted(at_rest)),
        findings=tuple(one for part in parts for one in part.findings),
    )


@dataclass(slots=True)
class _Found:
    """Gathers while one kind of resource is walked."""

    changes: list[Change] = field(default_factory=list)
    unused: list[str] = field(default_factory=list)
    findings: list[Diagnostic] = field(default_factory=list)
    unchanged: int = 0


def _partitions(
    wanted: Mapping[str, Partition],
    ours: Ours,
    observed: State,
    application: str,
    around: Surroundings,
    wishes: Wishes,
) -> _Found:
    found = _Found()
    in_the_way = list(_in_the_way(wanted, ours, observed, application, wishes))
    found.findings += [*ours.findings, *foreign_marks(observed), *in_the_way]
    blocked = {one.address for one in in_the_way}
    for name in sorted({*wanted, *ours.machines}):
        if f"partition/{name}" not in blocked:
            _one_partition(found, name, wanted.get(name), ours.machines.get(name), around, wishes)
    return found


def _one_partition(
    found: _Found,
    name: str,
    after: Partition | None,
    before: Partition | None,
    around: Surroundings,
    wishes: Wishes,
) -> None:
    address = Address(partition=name, machine=before.id if before else "")
    if before is None:
        assert after is not None
        place = wishes.where(address)
        found.changes.append(Create(address=address, after=after, reason=Reason(says="it is not there", place=place)))
    elif after is None:
        place = wishes.where(address)
        if name in wishes.protected:
            found.findings.append(_protected(name, "it would be removed", place))
            return
        if before.state in {RunState.BUSY, RunState.CRITICAL}:
            found.findings.append(_not_at_rest(address, before.state, place))
            return
        says = "it is not wanted on this host"
        found.changes.append(
            Delete(address=address, before=before, reason=Reason(says=says, place=place), disruption=Disruption.REMOVAL)
        )
    elif _same(before, after):
        if name in wishes.unused:
            found.unused.append(name)
        else:
            found.unchanged += 1
    else:
        _update(found, address, before, after, around, wishes)


def _update(
    found: _Found, address: Address, before: Partition, after: Partition, around: Surroundings, wishes: Wishes
) -> None:
    name, place = address.partition, wishes.where(address)
    disruption = disruption_of_update(before, after.settings, around)
    if disruption is Disruption.REMOVAL and name in wishes.protected:
        found.findings.append(_protected(name, "another generation means to make it again", place))
        return
    if not is_at_rest(before, after.settings, around):
        found.findings.append(_not_at_rest(address, before.state, place))
        return
    says = "the manifest no longer wants it" if name in wishes.unused else _differs(before, after, around)
    found.changes.append(
        Update(
            address=address,
            before=before,
            after=replace(after, id=before.id, other_notes=before.other_notes),
            reason=Reason(says=says, place=place),
            disruption=disruption,
        )
    )


def _same(before: Partition, after: Partition) -> bool:
    """Whether nothing has to be written: settings and mark; what runs by hand may run."""
    return (
        before.settings == after.settings
        and before.mark is not None
        and ((before.mark.name, before.mark.set) == (after.mark.name, after.mark.set) if after.mark else False)
    )


def _differs(before: Partition, after: Partition, around: Surroundings) -> str:
    words = {
        Facet.NAME: "name",
        Facet.PROCESSORS: "processors",
        Facet.CPU: "reserve, limit or weight",
        Facet.MEMORY: "memory",
        Facet.ACTIONS: "start, stop or checkpoint action",
        Facet.GENERATION: "generation",
    }
    changed = facets(before.settings, after.settings)
    differing = [words[facet] for facet in Facet if facet in changed]
    if before.settings.running != after.settings.running:
        differing.append("whether it runs")
    if not differing:
        return "the mark does not say what was last written"
    stop = "; it has to stop for that" if stops(before, after.settings, around) and after.settings.running else ""
    return f"not as wanted: {', '.join(differing)}{stop}"


def foreign_marks(observed: State) -> Iterable[Diagnostic]:
    """Machines with a line that looks like a mark and does not count."""
    for one in observed.partitions:
        if one.foreign_mark:
            yield findings.FOREIGN_MARK.at(
                None,
                f"Machine {one.settings.name!r} ({one.id}) carries a line that looks like a mark of rarms, but "
                f"{one.foreign_mark}. It counts as unmanaged.",
                "Take the line out of its notes, or adopt the right machine with `rarms import`.",
                address=f"machine/{one.id}",
            )


def _in_the_way(
    wanted: Mapping[str, Partition], ours: Ours, observed: State, application: str, wishes: Wishes
) -> Iterable[Diagnostic]:
    """Machines that are called as a partition is to be called and are not ours."""
    for one in observed.partitions:
        name = one.settings.name
        is_ours = one.mark is not None and one.mark.application == application
        if is_ours or name not in wanted:
            continue
        holder = ours.machines.get(name)
        if holder is not None and holder.settings.name == name:
            continue  # ours is called so too: names need not be unique, and nothing has to be renamed
        yield in_the_way(one, wishes.where(Address(partition=name)))


def in_the_way(one: Partition, place: Place | None) -> Diagnostic:
    """A machine that is not ours and is called as a partition is to be called."""
    name = one.settings.name
    owner = f"belongs to application {one.mark.application!r}" if one.mark else "carries no mark of rarms"
    return findings.FOREIGN_AT_NAME.at(
        place,
        f"The host has a machine {name!r} (id {one.id}) that {owner}.",
        f"Run `rarms import {name} --id {one.id}` to take it over, or give the partition another name.",
        address=f"partition/{name}",
    )


def _protected(name: str, says: str, place: Place | None) -> Diagnostic:
    return findings.PROTECTED.at(
        place,
        f"Partition {name!r} says `protect: true`, and {says}.",
        "Take `protect` out first, in a change of its own, or keep the partition.",
        address=f"partition/{name}",
    )


def _not_at_rest(address: Address, state: RunState, place: Place | None) -> Diagnostic:
    advice = {
        RunState.SAVED: "Start it, or discard its saved state, and plan again.",
        RunState.PAUSED: "Resume it or turn it off, and plan again.",
        RunState.CRITICAL: "Give it its storage back, or remove it in Hyper-V itself, and plan again.",
    }.get(state, "Wait until it is off or running, and plan again.")
    return findings.NOT_AT_REST.at(
        place, f"Partition {address.partition!r} is {state.value}; what has to change needs it off or running.", advice,
        address=str(address),
    )  # fmt: skip


def _tasks(desired: State, ours: Ours, observed: State, application: str, wishes: Wishes) -> _Found:
    """Task classes of the host and of the guests that are ours; what lies in other guests is not looked at."""
    found = _Found()
    wanted = {(one.inside, one.name.lower()): one for one in desired.tasks}
    kept = {one.settings.name for one in desired.partitions} - wishes.unused
    machines = {one.id for one in ours.machines.values()}
    there = {
        (ours.new_names.get(one.inside, one.inside), one.name.lower()): one
        for one in observed.tasks
        if not one.inside or (one.inside in ours.new_names and (not one.machine or one.machine in machines))
    }
    for key in sorted({*wanted, *there}):
        # A partition that goes takes its classes along; one that is merely kept is left as it is inside.
        if key[0] and key[0] not in ours.machines and key in wanted and is_shipped_task(key[1]):
            found.findings.append(_guest_first(wanted[key], wishes))
        elif not key[0] or key[0] in kept:
            _one_task(found, there.get(key), wanted.get(key), application, wishes, inside=key[0])
    return found


def _one_task(
    found: _Found,
    before: TaskClass | None,
    after: TaskClass | None,
    application: str,
    wishes: Wishes,
    *,
    inside: str,
) -> None:
    record = before.record if before else None
    is_ours = record is not None and record.application == application
    if after is None:
        if before is not None and is_ours:
            found.changes.append(
                Delete(
                    address=_task_address(inside, before),
                    before=before,
                    reason=Reason(says="no component here names it any more"),
                    disruption=disruption_of_task(inside),
                )
            )
        return
    address = _task_address(inside, after, before)
    place = wishes.where(address)
    if before is None or (not before.values and record is None):
        found.changes.append(
            Create(
                address=address,
                after=after,
                reason=Reason(says="a component names it", place=place),
                disruption=disruption_of_task(inside),
            )
        )
    elif not is_ours and not (record is None and before.name.lower() in wishes.replaceable):
        found.findings.append(_foreign_task(address, before, place))
    elif is_ours and dict(before.values) == dict(after.values) and after.record == record:
        found.unchanged += 1
    else:
        found.changes.append(
            Update(
                address=address,
                before=before,
                after=after,
                reason=Reason(says="its values differ" if is_ours else "the manifest replaces it", place=place),
                disruption=disruption_of_task(inside),
            )
        )


def _responsiveness(
    after: Responsiveness | None, before: Responsiveness | None, application: str, wishes: Wishes
) -> _Found:
    """Unlike a task class of others the value may be taken over: Windows sets it itself, and it is brought back."""
    found = _Found()
    record = before.record if before else None
    is_ours = record is not None and record.application == application
    disruption = disruption_of_task("")
    if after is None:
        if before is not None and is_ours:
            reason = Reason(says=f"the manifest no longer sets it; {_restored(before)}")
            found.changes.append(Delete(address=RESPONSIVENESS, before=before, reason=reason, disruption=disruption))
        return found
    place = wishes.where(RESPONSIVENESS)
    reason = Reason(says="the manifest sets it", place=place)
    if before is None or (record is not None and not is_ours):
        found.findings.append(_undecided(record.application if record else "", place))
    elif before == after:
        found.unchanged += 1
    elif before.value is None and record is None:
        found.changes.append(Create(address=RESPONSIVENESS, after=after, reason=reason, disruption=disruption))
    else:
        found.changes.append(
            Update(address=RESPONSIVENESS, before=before, after=after, reason=reason, disruption=disruption)
        )
    return found


def _restored(before: Responsiveness) -> str:
    kept = before.record.before if before.record else None
    return f"{', '.join(str(one.data) for one in kept.values())} comes back" if kept else "it was not there before"


def _undecided(application: str, place: Place | None) -> Diagnostic:
    if application:
        says = f"application {application!r} set it"
        advice = "Take `system_responsiveness` out of one of the two manifests."
    else:
        says = "what it is now could not be read, so it could not be brought back"
        advice = "Look at the host again with the rights of an administrator."
    return findings.RESPONSIVENESS.at(
        place, f"`system_responsiveness` is wanted, but {says}.", advice, address=str(RESPONSIVENESS)
    )


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
