"""Operations on a simulated host's content. Pure: what is refused was refused before (`refusals.py`)."""

from dataclasses import replace

from rarms_iac.model import operations
from rarms_iac.model.changes import RESPONSIVENESS, Address
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.operation_effects import applied
from rarms_iac.model.plan import Scope
from rarms_iac.model.state import Checkpoints, Disk, DiskKind, PartitionSettings, RunState, StartAction, StopAction
from rarms_iac.providers.marks import erase_mark, write_mark
from rarms_iac.providers.simulated.content import Content, SimulatedMachine, next_id
from rarms_iac.providers.simulated.registry import FRESH


def address_of(operation: operations.Operation) -> Address:
    """Return the address of what the operation changes, as faults name it."""
    match operation:
        case operations.CreatePartition() | operations.RestorePartition():
            return Address(partition=operation.partition)
        case operations.RemoveDisk():
            return Address(partition=operation.partition, disk=operation.path)
        case _ if isinstance(operation, operations.TaskOperation):
            if operation.task == SYSTEM_RESPONSIVENESS:
                return RESPONSIVENESS
            return Address(partition=operation.inside, task=operation.task)
        case _:
            return Address(partition=operation.partition, machine=operation.machine)


def new_settings(operation: operations.CreatePartition, scope: Scope) -> PartitionSettings:
    """Return a new machine, off, without reserve, under its pending name; the rest as Hyper-V makes it."""
    return PartitionSettings(
        name=scope.pending(operation.partition),
        generation=operation.generation,
        processors=1,
        reserve=0,
        limit=100,
        weight=100,
        memory=operation.memory,
        dynamic_memory=False,
        start_action=StartAction.START_IF_RUNNING,
        stop_action=StopAction.SAVE,
        checkpoints=Checkpoints.PRODUCTION,
        running=False,
        secure_boot=(operation.secure_boot or "MicrosoftWindows") if operation.generation == 2 else None,
    )


def with_new_machine(content: Content, settings: PartitionSettings) -> Content:
    """Return the content with one machine more."""
    machine = SimulatedMachine(id=next_id(content, settings.name), settings=settings, state=RunState.OFF)
    return replace(content, made=content.made + 1).with_machine(machine)


def with_restored_machine(content: Content, operation: operations.RestorePartition) -> Content:
    """Return the content with a machine again that was removed: off, and with rarms' task classes in its guest."""
    notes = write_mark(operation.other_notes, operation.mark) if operation.mark else operation.other_notes
    machine = SimulatedMachine(id=operation.machine, settings=operation.settings, state=RunState.OFF, notes=notes)
    if not operation.tasks:
        return content.with_machine(machine)
    registry = replace(
        FRESH,
        tasks={**FRESH.tasks, **{task.name: task.values for task in operation.tasks if task.values}},
        records={task.name.lower(): task.record for task in operation.tasks if task.record},
    )
    return content.with_machine(machine).with_registry(machine.id, registry)


def with_new_disk(
    content: Content, machine: str, operation: operations.CreatePartition, folder: str, scope: Scope
) -> Content:
    """Return the content with one disk more, of a machine, which grows out of an image."""
    path = operations.disk_path(operation, scope.plan, folder)
    disk = Disk(path=path, kind=DiskKind.DIFFERENCING, parent=operation.image, machine=machine)
    return content.with_disk(disk)


def change_machine(content: Content, machine: SimulatedMachine, operation: operations.MachineOperation) -> Content:
    """Return the content after the operation on this machine."""
    match operation:
        case operations.RemovePartition():
            return content.without_machine(machine.id)
        case operations.WriteMark():
            changed = replace(machine, notes=write_mark(machine.notes, operation.mark(machine.id)))
        case operations.EraseMark():
            changed = replace(machine, notes=erase_mark(machine.notes))
        case operations.StartPartition():
            changed = machine.now(RunState.RUNNING)
        case operations.StopPartition():
            changed = machine.now(RunState.OFF)
        case _:
            changed = replace(machine, settings=applied(machine.settings, operation))
    return content.with_machine(changed)
