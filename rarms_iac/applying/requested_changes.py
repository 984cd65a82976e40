"""Changes that a command asks for by name: `rarms stop`, `start`, `import` and `release`.

Partitions stop and start, and all that they are stays; or a mark comes or goes, and nothing else changes. A partition
that was stopped says so in its mark, so that it is not drift and no plan starts it; `rarms start` does.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import assert_never

from rarms_iac.applying.desired_hosts import criticality_of, graces_of
from rarms_iac.applying.plan_request import PlanRequest
from rarms_iac.applying.preconditions import marks_of_other_robots, unproven_rights
from rarms_iac.applying.review.changes import review_tied_machines
from rarms_iac.applying.review.host_effects import review_memory_left, review_script_placement
from rarms_iac.diff.compare import not_at_rest
from rarms_iac.diff.order import order
from rarms_iac.diff.step_context import StepContext
from rarms_iac.diff.steps import plan_changes
from rarms_iac.model.changes import Address, Adopt, Change, Delete, Reason, Release, Update
from rarms_iac.model.commands import PLAN, command, prose
from rarms_iac.model.diagnostics import Diagnostic, Place, Places
from rarms_iac.model.plan import HostSteps, Purpose
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.setting import TEST_PARTITIONS
from rarms_iac.model.state import Mark, Partition, RunState, StartAction, State, StoppedBy
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner.sizes import starting_partitions
from rarms_iac.storage.marks import set_of_settings
from rarms_iac.texts.findings import NO_TARGET
from rarms_iac.texts.messages import natural_order, suggestion

Locator = Callable[[Address], Place | None]
_NOTHING_TO_IMPORT = prose("The host has no machine to import. ", PLAN, " shows the partition as new.")


def requested_changes(state: State, request: PlanRequest, locate: Locator) -> Iterator[Change | Diagnostic]:
    """Find the changes that a command other than apply and destroy asks for.

    Args:
        request: the command, whose partitions, and which of them.
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
            yield from stop_changes(_chosen(state, request), StoppedBy.USER, "rarms stop", locate)
        case Purpose.START:
            yield from _left_test_partitions(state, request)
            to_start = (each for each in _chosen(state, request) if _is_to_start(each, request))
            yield from start_changes(to_start, "rarms start", locate)
        case Purpose.APPLY | Purpose.DESTROY:
            raise ValueError(f"{request.purpose} has the changes of a comparison")
        case _:
            assert_never(request.purpose)


def stop_changes(
    partitions: Iterable[Partition], stopped_by: StoppedBy, why: str, locate: Locator
) -> Iterator[Update | Diagnostic]:
    """Yield changes that stop what runs, with any mark, and that mark what is wanted running but does not run.

    Args:
        partitions: with marks.
        why: the reason of each change, for a person.
    """
    for before in partitions:
        after = stopped_partition(before, stopped_by)
        if before.state in _NOT_AT_REST:
            yield _not_at_rest(before, locate)
        elif before.settings.running or (before.mark != after.mark and _is_wanted_running(before)):
            yield _update(before, after, why, locate)


def _is_wanted_running(partition: Partition) -> bool:
    """Tell whether something starts it: rarms, its host, or the end of the measurement that stopped it."""
    is_measured = partition.mark is not None and partition.mark.stopped_by is StoppedBy.MEASUREMENT
    return is_measured or partition.settings.start_action is not StartAction.NOTHING


def start_changes(partitions: Iterable[Partition], why: str, locate: Locator) -> Iterator[Update | Diagnostic]:
    """Yield changes that start partitions; their marks say no longer who stopped them."""
    for before in partitions:
        if before.state in _NOT_AT_REST:
            yield _not_at_rest(before, locate)
        else:
            yield _update(before, _started(before), why, locate)


def _is_to_start(partition: Partition, request: PlanRequest) -> bool:
    """Tell whether `rarms start` means it: all that rarms stopped, and named ones also if rarms did not stop them."""
    assert partition.mark is not None
    is_named = bool(request.partitions)
    return partition.mark.stopped_by is not StoppedBy.NO_USER or (is_named and not partition.settings.running)


def _left_test_partitions(state: State, request: PlanRequest) -> Iterator[Delete]:
    """Test partitions that a killed measurement left hold what others need: they are removed."""
    for partition in state.of(request.application).partitions:
        if partition.mark is not None and partition.mark.name in TEST_PARTITIONS:
            yield Delete(
                address=Address(partition=partition.mark.name, machine=partition.id),
                before=partition,
                reason=Reason(message="left by a measurement that was killed"),
                disruption=Disruption.PARTITION_STOP,
            )


def _chosen(state: State, request: PlanRequest) -> Iterator[Partition]:
    managed = {vm.mark.name: vm for vm in state.of(request.application).partitions if vm.mark}
    for name, partition in sorted(managed.items()):
        if not request.partitions or name in request.partitions:
            yield partition


def _address(partition: Partition) -> Address:
    assert partition.mark is not None
    return Address(partition=partition.mark.name, machine=partition.id)


_NOT_AT_REST = frozenset({RunState.BUSY, RunState.CRITICAL, RunState.PAUSED})


def _not_at_rest(partition: Partition, locate: Locator) -> Diagnostic:
    address = _address(partition)
    return not_at_rest(address, partition.state, locate(address))


def _update(before: Partition, after: Partition, why: str, locate: Locator) -> Update:
    address = _address(before)
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


def steps_without_plan(
    system: System, places: Places, seen: SeenHost, found: Iterable[Change | Diagnostic]
) -> tuple[HostSteps, tuple[Diagnostic, ...]]:
    """Return the steps of stops or starts on one host, in their order, and the errors that forbid them.

    A plan of the same stops or starts has the same errors.
    """
    found = tuple(found)
    changes = tuple(each for each in found if not isinstance(each, Diagnostic))
    context = StepContext(
        seen=seen,
        graces=graces_of(system, seen),
        criticality=criticality_of(system),
        starting=starting_partitions(system, seen.host),
    )
    ordered = order(plan_changes(changes, context), context)
    steps, stuck = ((), (ordered,)) if isinstance(ordered, Diagnostic) else (ordered, ())
    on = HostSteps(
        host=seen.host,
        facts=seen.facts,
        serial=seen.state.serials.get(seen.application, 0),
        changes=changes,
        steps=steps,
    )
    return on, (
        *unproven_rights([seen.state], places),
        *marks_of_other_robots([seen.state], system.application),
        *review_tied_machines(system, changes),
        *review_script_placement(seen, changes),
        *review_memory_left(seen, changes),
        *(each for each in found if isinstance(each, Diagnostic)),
        *stuck,
    )


def _import_changes(state: State, request: PlanRequest, locate: Locator) -> Iterator[Adopt | Diagnostic]:
    """Yield the change that makes the machine of this id the manifest's partition; its settings stay.

    The mark says what the machine has now, so that the next plan shows what the manifest wants of it.
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
            "{host} does not have the machine {machine}: {_known}.",
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
    """Return the obstacle to adopting the machine: it is another's, or the partition has a machine."""
    if mark := machine.mark:
        problem = (
            "Machine {machine} is already the partition {partition:quoted} of the application {application:quoted}."
        )
        manifest = "" if mark.application == application else f", with the manifest of {mark.application}"
        advice = prose("Release the machine first: ", command("release", mark.name), f"{manifest}.")
        return NO_TARGET.at(
            None, problem, advice, machine=machine.id, partition=mark.name, application=mark.application
        )
    managed = (partition for partition in state.of(application).partitions if partition.mark)
    holder = next((partition for partition in managed if partition.mark and partition.mark.name == name), None)
    if holder is None:
        return None
    problem = "Partition {partition:quoted} is already the machine {machine}."
    advice = prose("Release that machine first: ", command("release", name), ".")
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
            "{host} does not have a partition {partition:quoted} with the mark of {application:quoted}. "
            + ("Partitions with this mark: {managed:each}.{_suggestion}" if managed else "No partition has this mark."),
            "Give one of these names." if managed else "No partition can be released.",
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
