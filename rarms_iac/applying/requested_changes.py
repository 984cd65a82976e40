"""Changes that a command asks for by name: `rarms stop`, `start`, `import` and `release`.

Partitions stop and start, and all that they are stays; or a mark comes or goes, and nothing else changes. A partition
that was stopped says so in its mark, so that it is no drift and no plan starts it; `rarms start` does.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import assert_never

from rarms_iac.applying.plan_request import PlanRequest
from rarms_iac.diff.compare import not_at_rest
from rarms_iac.model.changes import Address, Adopt, Change, Delete, Reason, Release, Update
from rarms_iac.model.commands import PLAN, command, prose
from rarms_iac.model.diagnostics import NO_TARGET, Diagnostic, Place
from rarms_iac.model.plan import Purpose
from rarms_iac.model.setting import TEST_PARTITIONS
from rarms_iac.model.state import Mark, Partition, RunState, StartAction, State, StoppedBy
from rarms_iac.model.system import Disruption
from rarms_iac.model.wording import natural_order, suggestion
from rarms_iac.storage.marks import set_of_settings

Locator = Callable[[Address], Place | None]
_NOTHING_TO_IMPORT = prose("There is nothing to import. ", PLAN, " shows the partition that it adds.")


def requested_changes(state: State, request: PlanRequest, locate: Locator) -> Iterator[Change | Diagnostic]:
    """Find the changes that a command other than apply and destroy asks for.

    Args:
        request: the command, whose partitions, which of them, and who stops them.
        locate: the manifest line of a partition.

    Yields:
        The changes in the order of their partitions, and a finding for each that cannot be; nothing for a partition
        that is as the command wants it.
    """
    match request.purpose:
        case Purpose.IMPORT:
            yield from _import_changes(state, request, locate)
        case Purpose.RELEASE:
            yield from _release_changes(state, request, locate)
        case Purpose.STOP:
            yield from _stop_changes(state, request, locate)
        case Purpose.START:
            yield from _left_test_partitions(state, request)
            yield from _start_changes(state, request, locate)
        case Purpose.APPLY | Purpose.DESTROY:
            raise ValueError(f"{request.purpose} has the changes of a comparison")
        case _:
            assert_never(request.purpose)


def _stop_changes(state: State, request: PlanRequest, locate: Locator) -> Iterator[Update | Diagnostic]:
    """Yield changes that stop what runs, with any mark, and that mark what is wanted running but does not run."""
    for address, before in _partitions(state, request):
        after = stopped_partition(before, request.stopped_by)
        if before.state in {RunState.PAUSED, RunState.BUSY, RunState.CRITICAL}:
            yield not_at_rest(address, before.state, locate(address))
        elif before.settings.running or (before.mark != after.mark and _is_wanted_running(before)):
            yield _update(address, before, after, "rarms stop", locate)


def _is_wanted_running(partition: Partition) -> bool:
    """Tell whether something starts it: rarms, its host, or the end of the measurement that stopped it."""
    is_measured = partition.mark is not None and partition.mark.stopped_by is StoppedBy.MEASUREMENT
    return is_measured or partition.settings.start_action is not StartAction.NOTHING


def _start_changes(state: State, request: PlanRequest, locate: Locator) -> Iterator[Update | Diagnostic]:
    """Start the partitions that rarms stopped; named ones also if rarms did not stop them."""
    for address, before in _partitions(state, request):
        assert before.mark is not None
        stopped_by = before.mark.stopped_by
        if request.stopped_by is StoppedBy.MEASUREMENT:
            is_meant = stopped_by is StoppedBy.MEASUREMENT
        else:
            is_meant = stopped_by is not StoppedBy.NO_USER or (bool(request.partitions) and not before.settings.running)
        if not is_meant:
            continue
        if before.state in {RunState.BUSY, RunState.CRITICAL, RunState.PAUSED}:
            yield not_at_rest(address, before.state, locate(address))
        else:
            yield _update(address, before, _started(before), "rarms start", locate)


def _left_test_partitions(state: State, request: PlanRequest) -> Iterator[Delete]:
    """Test partitions that a killed measurement left hold what others need: they are removed."""
    for partition in state.of(request.application).partitions:
        if partition.mark is not None and partition.mark.name in TEST_PARTITIONS:
            yield Delete(
                address=Address(partition=partition.mark.name, machine=partition.id),
                before=partition,
                reason=Reason(message="a measurement that was killed left it"),
                disruption=Disruption.PARTITION_STOP,
            )


def _partitions(state: State, request: PlanRequest) -> Iterator[tuple[Address, Partition]]:
    managed = {vm.mark.name: vm for vm in state.of(request.application).partitions if vm.mark}
    for name, partition in sorted(managed.items()):
        if not request.partitions or name in request.partitions:
            yield Address(partition=name, machine=partition.id), partition


def _update(address: Address, before: Partition, after: Partition, why: str, locate: Locator) -> Update:
    stops = before.settings.running and not after.settings.running
    return Update(
        address=address,
        before=before,
        after=after,
        reason=Reason(message=why, place=locate(address)),
        disruption=Disruption.PARTITION_STOP if stops else Disruption.LIVE,
    )


def stopped_partition(partition: Partition, stopped_by: StoppedBy) -> Partition:
    """Return the managed partition once it is stopped, with the mark that says by whom."""
    assert partition.mark is not None
    return replace(
        partition,
        settings=replace(partition.settings, running=False),
        state=RunState.OFF,
        mark=replace(partition.mark, stopped_by=stopped_by),
    )


def _started(partition: Partition) -> Partition:
    assert partition.mark is not None
    return replace(
        partition,
        settings=replace(partition.settings, running=True),
        state=RunState.RUNNING,
        mark=replace(partition.mark, stopped_by=StoppedBy.NO_USER),
    )


def _import_changes(state: State, request: PlanRequest, locate: Locator) -> Iterator[Adopt | Diagnostic]:
    """Yield the change that makes the machine of this id the manifest's partition; its settings stay.

    The mark says what the machine has now, so that the next plan tells what the manifest wants of it.
    """
    (name,), application, machine = request.partitions, request.application, request.machine
    address, place = f"partition/{name}", locate(Address(partition=name))
    before = next((partition for partition in state.partitions if partition.id.lower() == machine.lower()), None)
    if before is None:
        known = (
            ", ".join(f"{partition.settings.name} {partition.id}" for partition in state.partitions)
            or "it has no machines"
        )
        yield NO_TARGET.at(
            place,
            "{host} has no machine {machine}: {_known}.",
            "Give one of these ids." if state.partitions else _NOTHING_TO_IMPORT,
            address=address,
            host=state.facts.name,
            machine=machine,
            _known=known,
        )
        return
    if before.mark is not None and (before.mark.application, before.mark.name) == (application, name):
        return  # also where a run was killed after its last step, and its user gives the command again
    if taken := _taken(state, application, name, before):
        yield replace(taken, place=place, address=address)
        return
    mark = Mark(
        application=application,
        robot=request.system.application.robot,
        name=name,
        machine=before.id[:8],
        set=set_of_settings(replace(before.settings, secure_boot="")),
    )
    yield Adopt(
        address=Address(partition=name, machine=before.id),
        before=before,
        after=replace(before, mark=mark),
        reason=Reason(message="rarms import", place=place),
    )


def _taken(state: State, application: str, name: str, machine: Partition) -> Diagnostic | None:
    """Return why the machine cannot be adopted: it is another's, or the partition has a machine."""
    if mark := machine.mark:
        problem = "Machine {machine} is partition {partition:quoted} of application {application:quoted}."
        manifest = "" if mark.application == application else f", with the manifest of {mark.application}"
        advice = prose("Release it first: ", command("release", mark.name), f"{manifest}.")
        return NO_TARGET.at(
            None, problem, advice, machine=machine.id, partition=mark.name, application=mark.application
        )
    managed = (partition for partition in state.of(application).partitions if partition.mark)
    holder = next((partition for partition in managed if partition.mark and partition.mark.name == name), None)
    if holder is None:
        return None
    problem = "Partition {partition:quoted} is machine {machine} already."
    advice = prose("Release that one first: ", command("release", name), ".")
    return NO_TARGET.at(None, problem, advice, partition=name, machine=holder.id)


def _release_changes(state: State, request: PlanRequest, locate: Locator) -> Iterator[Release | Diagnostic]:
    """Yield the change that takes our mark off this partition; the machine and its settings stay."""
    (name,), application = request.partitions, request.application
    place = locate(Address(partition=name))
    managed: dict[str, Partition] = {
        partition.mark.name: partition for partition in state.of(application).partitions if partition.mark
    }
    before = managed.get(name)
    unmarked = {partition.settings.name for partition in state.partitions if partition.mark is None}
    if before is None and name in unmarked:
        return  # also where a run was killed after its last step, and its user gives the command again
    if before is None:
        yield NO_TARGET.at(
            place,
            "On {host} no partition {partition:quoted} carries a mark of {application:quoted}; "
            + ("these do: {managed:each}.{_suggestion}" if managed else "no partition does."),
            "Give one of these names." if managed else "There is nothing to release.",
            address=f"partition/{name}",
            host=state.facts.name,
            partition=name,
            application=application,
            managed=tuple(sorted(managed, key=natural_order)),
            _suggestion=suggestion(name, managed),
        )
        return
    yield Release(
        address=Address(partition=name, machine=before.id),
        before=before,
        after=replace(before, mark=None),
        reason=Reason(message="rarms release", place=place),
    )
