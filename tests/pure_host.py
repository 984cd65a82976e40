"""A host of values only: it takes steps as apply does, and is strict about what Hyper-V changes only while off."""

from dataclasses import dataclass, field, replace

from rarms_iac.diff.readings import readings
from rarms_iac.model.capacity import core_sharing
from rarms_iac.model.facets import Readings, with_values
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.operation_effects import partition_after
from rarms_iac.model.operations import (
    CreatePartition,
    EraseTaskRecord,
    MachineOperation,
    Operation,
    RemoveDisk,
    RemovePartition,
    RemoveTaskClass,
    RestorePartition,
    Set,
    TaskOperation,
    WriteTaskClass,
    WriteTaskRecord,
)
from rarms_iac.model.plan import Scope, Step
from rarms_iac.model.state import Partition, Responsiveness, StartAction, State, TaskClass
from tests.strategies import some_settings


@dataclass(slots=True)
class PureHost:
    """Walks steps over a state as apply does: read, compare, set, read again."""

    state: State
    scope: Scope = field(default_factory=lambda: Scope(application="robot", plan="abcdefabcdef"))
    made: int = 0

    def walk(self, steps: tuple[Step, ...]) -> list[State]:
        """The state after each step; a step whose guard does not hold is a failed assertion."""
        passed = []
        for step in steps:
            self.take(step.operation, step, step.before, step.after)
            passed.append(self.state)
        return passed

    def take(self, operation: Operation, step: Step, before: Readings, after: Readings) -> None:
        live = readings(self.state, step.address, self.scope)
        assert {**live, **before} == dict(live), f"{step.address} {step.title}: {live} is not {before}"
        self.perform(operation)
        live = readings(self.state, step.address, self.scope)
        assert {**live, **after} == dict(live), f"{step.address} {step.title}: {live} did not become {after}"

    def perform(self, operation: Operation) -> None:
        match operation:
            case CreatePartition():
                self._create(operation)
            case WriteTaskClass() | RemoveTaskClass() | WriteTaskRecord() | EraseTaskRecord():
                if operation.task == SYSTEM_RESPONSIVENESS:
                    now = self.state.responsiveness or Responsiveness()
                    self.state = replace(self.state, responsiveness=_set(now, operation))
                else:
                    self._task(operation)
            case RemovePartition():
                gone = self._find(operation.partition, operation.machine)
                self.state = replace(
                    self.state,
                    partitions=tuple(partition for partition in self.state.partitions if partition.id != gone.id),
                    tasks=tuple(task for task in self.state.tasks if task.machine != gone.id),
                    disks=tuple(
                        replace(disk, machine="") if disk.machine == gone.id else disk for disk in self.state.disks
                    ),
                )
            case RestorePartition():
                mark = operation.mark and replace(operation.mark, machine=operation.machine[:8])
                again = Partition(
                    settings=operation.settings,
                    id=operation.machine,
                    mark=mark,
                    other_notes=operation.other_notes,
                    sharing=core_sharing(self.state.facts),
                )
                self.state = replace(
                    self.state,
                    partitions=(*self.state.partitions, again),
                    tasks=(*self.state.tasks, *operation.tasks),
                )
            case RemoveDisk(path=path):
                self.state = replace(self.state, disks=tuple(disk for disk in self.state.disks if disk.path != path))
            case _:
                old = self._find(operation.partition, operation.machine)
                self._put(_changed(old, operation))

    def _find(self, name: str, machine: str) -> Partition:
        pending = f"{name}.rarms-{self.scope.plan}"
        found = [
            partition
            for partition in self.state.partitions
            if (
                partition.id == machine
                if machine
                else (
                    partition.mark
                    and partition.mark.name == name
                    and partition.mark.application == self.scope.application
                )
                or partition.settings.name == pending
            )
        ]
        assert len(found) == 1, f"{name!r} stands for {len(found)} machines"
        return found[0]

    def _create(self, operation: CreatePartition) -> None:
        self.made += 1
        settings = replace(
            some_settings(f"{operation.partition}.rarms-{self.scope.plan}"),
            generation=operation.generation,
            memory=operation.memory,
            start_action=StartAction.START_IF_RUNNING,
            secure_boot=operation.secure_boot or "MicrosoftWindows",
        )
        machine = Partition(settings=settings, id=f"{self.made:08x}-made", sharing=core_sharing(self.state.facts))
        self.state = replace(self.state, partitions=(*self.state.partitions, machine))

    def _put(self, changed: Partition) -> None:
        marks = [
            partition.mark.name for partition in self.state.partitions if partition.mark and partition.id != changed.id
        ]
        assert changed.mark is None or changed.mark.name not in marks, "a mark stands on two machines"
        self.state = replace(
            self.state,
            partitions=tuple(
                changed if partition.id == changed.id else partition for partition in self.state.partitions
            ),
            tasks=tuple(
                replace(task, inside=changed.mark.name) if changed.mark and task.machine == changed.id else task
                for task in self.state.tasks
            ),
        )

    def _task(self, operation: TaskOperation) -> None:
        machine = self._find(operation.inside, "").id if operation.inside else ""
        key = (machine, operation.task.lower())
        others = tuple(task for task in self.state.tasks if (task.machine, task.name.lower()) != key)
        now = next(
            (task for task in self.state.tasks if (task.machine, task.name.lower()) == key),
            TaskClass(name=operation.task, inside=operation.inside, machine=machine),
        )
        match operation:
            case WriteTaskClass(values=values):
                now = replace(now, values=values)
            case RemoveTaskClass():
                now = replace(now, values={})
            case WriteTaskRecord(record=record):
                now = replace(now, record=record)
            case EraseTaskRecord():
                now = replace(now, record=None)
        self.state = replace(self.state, tasks=(*others, now) if now.values or now.record else others)


def _set(now: Responsiveness, operation: TaskOperation) -> Responsiveness:
    match operation:
        case WriteTaskClass(values=values):
            return replace(now, value=values[SYSTEM_RESPONSIVENESS])
        case RemoveTaskClass():
            return replace(now, value=None)
        case WriteTaskRecord(record=record):
            return replace(now, record=record)
        case EraseTaskRecord():
            return replace(now, record=None)


def _changed(old: Partition, operation: MachineOperation) -> Partition:
    settings = old.settings
    match operation:
        case Set(after=after):
            new = with_values(settings, after)
            off = {"processors", "stop_action", "secure_boot"}.intersection(after)
            if new.dynamic_memory != settings.dynamic_memory:
                off.add("dynamic_memory")
            assert not (off and settings.running), f"{off} change only while it is off"
            assert new.reserve <= new.limit
        case RemovePartition():
            raise AssertionError(f"{operation} is of no machine that is there")
        case _:
            pass
    return partition_after(old, operation)
