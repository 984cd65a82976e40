"""What an operation does, in a few words for a person: an undo is told by what it does, not by what it takes back."""

from typing import assert_never

from rarms_iac.model.operations import (
    CreatePartition,
    EraseMark,
    EraseResponsiveness,
    EraseResponsivenessRecord,
    EraseTaskRecord,
    Operation,
    PartitionOperation,
    RemoveDisk,
    RemovePartition,
    RemoveTaskClass,
    RenamePartition,
    ResponsivenessOperation,
    SetActions,
    SetCpu,
    SetMemory,
    SetProcessors,
    StartPartition,
    StopPartition,
    TaskOperation,
    WriteMark,
    WriteResponsiveness,
    WriteResponsivenessRecord,
    WriteTaskClass,
    WriteTaskRecord,
)
from rarms_iac.model.quantities import show_bytes


def describe_operation(operation: Operation) -> str:
    """`stop it`, `reserve 64 %, limit 100 %, weight 300`; without its address, which stands before it."""
    match operation:
        case RemoveDisk(path=path):
            return f"delete its disk {path}"
        case WriteTaskClass() | RemoveTaskClass() | WriteTaskRecord() | EraseTaskRecord():
            return _of_a_task(operation)
        case WriteResponsiveness() | EraseResponsiveness() | WriteResponsivenessRecord() | EraseResponsivenessRecord():
            return _of_responsiveness(operation)
        case _:
            return _of_a_partition(operation)


def _of_a_partition(operation: PartitionOperation) -> str:
    match operation:
        case CreatePartition(memory=memory):
            return f"make the machine with {show_bytes(memory)}"
        case RemovePartition():
            return "remove the machine that was made, with all that was set on it"
        case RenamePartition(name=name):
            return f"give it its name {name}"
        case WriteMark(application=application, name=name):
            return f"mark it as {application}/{name}"
        case EraseMark():
            return "erase the mark"
        case SetProcessors(processors=processors):
            return f"processors {processors}"
        case SetCpu(reserve=reserve, limit=limit, weight=weight):
            return f"reserve {reserve} %, limit {limit} %, weight {weight}"
        case SetMemory(memory=memory, dynamic=dynamic):
            return f"memory {show_bytes(memory)}{', dynamic' if dynamic else ''}"
        case SetActions():
            return "what happens when the host starts and stops, and its checkpoints, as before"
        case StartPartition():
            return "start it"
        case StopPartition():
            return "stop it"
        case _:
            assert_never(operation)


def _of_a_task(operation: TaskOperation) -> str:
    match operation:
        case WriteTaskClass(values=values):
            return f"set {', '.join(sorted(values))} as before"
        case RemoveTaskClass():
            return "remove the class"
        case WriteTaskRecord():
            return "record that it is ours, and what was there"
        case EraseTaskRecord():
            return "forget it: it is no longer ours"
        case _:
            assert_never(operation)


def _of_responsiveness(operation: ResponsivenessOperation) -> str:
    match operation:
        case WriteResponsiveness():
            return "set it as before"
        case EraseResponsiveness():
            return "take the value away"
        case WriteResponsivenessRecord():
            return "record that it is ours, and what was there"
        case EraseResponsivenessRecord():
            return "forget it: it is no longer ours"
        case _:
            assert_never(operation)
