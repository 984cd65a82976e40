"""`rarms import` and `rarms release`: a mark comes or goes, and nothing else changes."""

from dataclasses import replace

from rarms_iac.model.changes import Address, Adopt, Reason, Release
from rarms_iac.model.diagnostics import Diagnostic, Finding, Place
from rarms_iac.model.state import Mark, Partition, State
from rarms_iac.model.wording import quoted, suggestion
from rarms_iac.storage.digest import set_of_settings

NO_SUCH_MACHINE = Finding.error("RARMS195", "No machine on the host has this id")
TAKEN = Finding.error("RARMS196", "The machine or the partition is taken already")
NOT_MANAGED = Finding.error("RARMS197", "This partition is not managed by this application")


def adoption(state: State, application: str, name: str, machine: str, place: Place | None) -> Adopt | Diagnostic | None:
    """The change that makes the machine of this id the manifest's partition; its settings stay. None: it is that.

    The mark says what the machine has now, so that the next plan tells what the manifest wants of it.
    """
    address = f"partition/{name}"
    before = next((partition for partition in state.partitions if partition.id.lower() == machine.lower()), None)
    if before is None:
        known = (
            ", ".join(f"{partition.settings.name} {partition.id}" for partition in state.partitions)
            or "it has no machines"
        )
        return NO_SUCH_MACHINE.at(
            place, f"{state.facts.name} has no machine {machine}: {known}.", "Give one of these ids.", address=address
        )
    if before.mark is not None and (before.mark.application, before.mark.name) == (application, name):
        return None  # also where a run was killed after its last step, and its user gives the command again
    if before.mark is not None:
        mark = before.mark
        problem = f"Machine {machine} is partition {quoted(mark.name)} of application {quoted(mark.application)}."
        manifest = "" if mark.application == application else f", with the manifest of {mark.application}"
        return TAKEN.at(place, problem, f"Release it first: `rarms release {mark.name}`{manifest}.", address=address)
    holder = next(
        (partition for partition in state.of(application).partitions if partition.mark and partition.mark.name == name),
        None,
    )
    if holder is not None:
        problem = f"Partition {quoted(name)} is machine {holder.id} already."
        return TAKEN.at(place, problem, f"Release that one first: `rarms release {name}`.", address=address)
    mark = Mark(
        application=application,
        name=name,
        machine=before.id[:8],
        set=set_of_settings(replace(before.settings, secure_boot=None)),
    )
    return Adopt(
        address=Address(partition=name, machine=before.id),
        before=before,
        after=replace(before, mark=mark),
        reason=Reason(message="rarms import", place=place),
    )


def releasing(state: State, application: str, name: str, place: Place | None) -> Release | Diagnostic | None:
    """The change that takes our mark off this partition; the machine and its settings stay. None: it has no mark."""
    managed: dict[str, Partition] = {
        partition.mark.name: partition for partition in state.of(application).partitions if partition.mark
    }
    before = managed.get(name)
    unmarked = {partition.settings.name for partition in state.partitions if partition.mark is None}
    if before is None and name in unmarked:
        return None  # also where a run was killed after its last step, and its user gives the command again
    if before is None:
        known = ", ".join(sorted(managed)) or "none"
        return NOT_MANAGED.at(
            place,
            f"On {state.facts.name} no partition {quoted(name)} carries a mark of {quoted(application)}; "
            f"these do: {known}.{suggestion(name, managed)}",
            "Give one of these names.",
            address=f"partition/{name}",
        )
    return Release(
        address=Address(partition=name, machine=before.id),
        before=before,
        after=replace(before, mark=None),
        reason=Reason(message="rarms release", place=place),
    )
