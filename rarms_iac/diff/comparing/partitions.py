"""The changes of partitions, and the machines that stand in their way."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

from rarms_iac.diff import findings
from rarms_iac.diff.comparing.wishes import Found, Wishes
from rarms_iac.diff.disruption import Surroundings, disruption_of_update, facets, is_at_rest, stops
from rarms_iac.diff.ours import Ours
from rarms_iac.model.changes import Address, Create, Delete, Reason, Update
from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.model.state import Facet, Partition, RunState, State
from rarms_iac.model.system import Disruption


def partition_changes(
    wanted: Mapping[str, Partition],
    ours: Ours,
    observed: State,
    application: str,
    around: Surroundings,
    wishes: Wishes,
) -> Found:
    """What has to change of ours; machines of others and marks that do not count are told, never changed."""
    found = Found()
    in_the_way = list(_in_the_way(wanted, ours, observed, application, wishes))
    found.findings += [*ours.findings, *foreign_marks(observed), *in_the_way]
    blocked = {diagnostic.address for diagnostic in in_the_way}
    for name in sorted({*wanted, *ours.machines}):
        if f"partition/{name}" not in blocked:
            _one_partition(found, name, wanted.get(name), ours.machines.get(name), around, wishes)
    return found


def _one_partition(
    found: Found,
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
    found: Found, address: Address, before: Partition, after: Partition, around: Surroundings, wishes: Wishes
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
    for partition in observed.partitions:
        if partition.foreign_mark:
            yield findings.FOREIGN_MARK.at(
                None,
                f"Machine {partition.settings.name!r} ({partition.id}) carries a line that looks "
                "like a mark of rarms, but "
                f"{partition.foreign_mark}. It counts as unmanaged.",
                "Take the line out of its notes, or adopt the right machine with `rarms import`.",
                address=f"machine/{partition.id}",
            )


def _in_the_way(
    wanted: Mapping[str, Partition], ours: Ours, observed: State, application: str, wishes: Wishes
) -> Iterable[Diagnostic]:
    """Machines that are called as a partition is to be called and are not ours."""
    for partition in observed.partitions:
        name = partition.settings.name
        is_ours = partition.mark is not None and partition.mark.application == application
        if is_ours or name not in wanted:
            continue
        holder = ours.machines.get(name)
        if holder is not None and holder.settings.name == name:
            continue  # ours is called so too: names need not be unique, and nothing has to be renamed
        yield in_the_way(partition, wishes.where(Address(partition=name)))


def in_the_way(partition: Partition, place: Place | None) -> Diagnostic:
    """A machine that is not ours and is called as a partition is to be called."""
    name = partition.settings.name
    owner = f"belongs to application {partition.mark.application!r}" if partition.mark else "carries no mark of rarms"
    return findings.FOREIGN_AT_NAME.at(
        place,
        f"The host has a machine {name!r} (id {partition.id}) that {owner}.",
        f"Run `rarms import {name} --id {partition.id}` to take it over, or give the partition another name.",
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
