"""Settings, operations, steps and the choice of hosts as text, for plans, scripts, journals and the terminal alike."""

from collections.abc import Iterable, Mapping
from enum import Enum
from fractions import Fraction
from typing import assert_never

from rarms_iac.model.changes import Address, Change, Update
from rarms_iac.model.facets import LABELS, NO_LIMIT
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.layout import Placement
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.operations import (
    CreatePartition,
    EraseMark,
    EraseTaskRecord,
    Operation,
    RemoveDisk,
    RemovePartition,
    RemoveTaskClass,
    RenamePartition,
    RestorePartition,
    Set,
    StartPartition,
    StopPartition,
    TaskOperation,
    WriteMark,
    WriteTaskClass,
    WriteTaskRecord,
    forced_after_ms,
)
from rarms_iac.model.plan import Step
from rarms_iac.model.quantities import guaranteed
from rarms_iac.model.state import NO_GENERATION, Partition, PartitionSettings, StartAction
from rarms_iac.texts.quantities import plain, show_lp_percent, show_processors, write_bytes

_AUTOMATIC_START = {
    StartAction.NOTHING: "no",
    StartAction.START_IF_RUNNING: "if it ran",
    StartAction.START: "yes",
}


def setting_text(field: str, settings: PartitionSettings) -> str:
    """Write a field of the settings: `0.6 LP`, `512 MiB`, `yes`.

    Args:
        settings: reserve and limit are of all virtual processors together.
    """
    value = getattr(settings, field)
    match field:
        case "limit" if value == NO_LIMIT:
            return "none"
        case "reserve" | "limit":
            return show_processors(guaranteed(value, settings.processors))
        case "memory":
            return write_bytes(value) if value else "no limit"
        case "quota_period_us":
            return f"{plain(Fraction(value, 1000))} ms" if value else "none"
        case "start_action":
            return _AUTOMATIC_START[value]
        case _ if isinstance(value, bool):
            return "yes" if value else "no"
        case _ if isinstance(value, Enum):
            return str(value.value).replace("_", " ")
        case _:
            return str(value)


def change_text(names: Iterable[str], old: PartitionSettings | None, to: PartitionSettings) -> str:
    """Say from what to what these settings change, the reserve in both units.

    Args:
        old: before the change, of all steps that belong together; None: the machine is new.

    Returns:
        Only what differs.
    """
    if old is None:
        return ", ".join(_new_text(name, to) for name in names if setting_text(name, to))
    return ", ".join(_change_text(name, old, to) for name in names if getattr(old, name) != getattr(to, name))


def _new_text(name: str, to: PartitionSettings) -> str:
    if name == "reserve":
        return f"reserve {_lp(to)} ({to.reserve} % of {_each(to)})"
    return f"limit {to.limit} % of {_each(to)}" if name == "limit" else f"{LABELS[name]} {setting_text(name, to)}"


def _change_text(name: str, old: PartitionSettings, to: PartitionSettings) -> str:
    if name == "reserve":
        return _reserve_change(old, to)
    if name == "limit":
        return f"limit {old.limit} -> {to.limit} % of {_each(to)}"
    return f"{LABELS[name]} {setting_text(name, old) or 'none'} -> {setting_text(name, to) or 'none'}"


def _reserve_change(old: PartitionSettings, to: PartitionSettings) -> str:
    """Write a reserve's change in logical processors, and in per cent of the machine's own."""
    percents = f"{old.reserve} -> {to.reserve} % of {_each(to)}"
    if old.processors != to.processors:
        percents = f"{old.reserve} % of {_each(old)} -> {to.reserve} % of {_each(to)}"
    return f"reserve {plain(Fraction(old.reserve * old.processors, 100))} -> {_lp(to)} ({percents})"


def _lp(settings: PartitionSettings) -> str:
    return show_lp_percent(settings.reserve * settings.processors)


def _each(settings: PartitionSettings) -> str:
    return "its processor" if settings.processors == 1 else f"each of {settings.processors} processors"


def operation_text(operation: Operation) -> str:
    """Say what an operation does, without the address that stands before it: `start it`."""
    match operation:
        case CreatePartition(generation=generation, memory=memory):
            made = "control group" if generation == NO_GENERATION else f"machine of generation {generation}"
            return f"make a {made} with {write_bytes(memory)}"
        case RemovePartition():
            return "remove it"
        case RestorePartition():
            return "create it again with its earlier settings"
        case RemoveDisk(path=path):
            return f"delete its disk {path}"
        case RenamePartition(name=name):
            return f"give it its name {name}"
        case WriteMark(application=application, name=name):
            return f"mark it as {application}/{name}"
        case EraseMark():
            return "erase the mark"
        case Set(after=after):
            return "set " + ", ".join(f"{LABELS[name]} {value}" for name, value in after.items())
        case StartPartition():
            return "start it"
        case StopPartition():
            return "stop it"
        case _:
            return _task_text(operation)


def _task_text(operation: TaskOperation) -> str:
    match operation:
        case WriteTaskClass(values=values):
            return "set " + ", ".join(f"{name} {value.data}" for name, value in sorted(values.items()))
        case RemoveTaskClass(task=task):
            return "remove the value" if task == SYSTEM_RESPONSIVENESS else "remove the class"
        case WriteTaskRecord():
            return "record it as managed, with its earlier values"
        case EraseTaskRecord():
            return "delete its record: rarms no longer manages it"
        case _:
            assert_never(operation)


def describe_stop(grace: int, provider: ProviderKind) -> str:
    """Describe how a partition is stopped, with the times in seconds after it was asked.

    Args:
        grace: milliseconds that it has to shut down, or to end its processes; 0: it is stopped without being asked.
        provider: of its host; Linux cannot force a shutdown.
    """
    if provider is ProviderKind.LINUX:
        return f"its processes have {_seconds(grace)} s to end" if grace else "its processes are killed"
    if not grace:
        return "turned off without a shutdown"
    return f"shut down, after {_seconds(forced_after_ms(grace))} s forced, turned off after {_seconds(grace)} s"


def _seconds(milliseconds: int) -> str:
    return plain(Fraction(milliseconds, 1000))


def change_title(operation: Operation, old: PartitionSettings, to: PartitionSettings) -> str:
    """Say from what to what an operation changes a machine.

    Args:
        old: its settings before the change, of all steps that belong together.
    """
    match operation:
        case Set(after=after):
            return change_text(after, old, to) or operation_text(operation)
        case RenamePartition(name=name):
            return f"name {old.name} -> {name}"
        case WriteMark():
            return f"{operation_text(operation)}, set {operation.mark('').written}"
        case _:
            return operation_text(operation)


def reversal_title(step: Step, changes: Mapping[Address, Change]) -> str:
    """Say what the undo of a step does: from what is found then to what was there before.

    Args:
        step: of a plan; it has an undo with an operation.
        changes: those of its host, by address.
    """
    assert step.undo.operation is not None, "a step without an undo is not undone"
    operation, change = step.undo.operation, changes.get(step.address)
    if isinstance(change, Update) and isinstance(change.before, Partition) and isinstance(change.after, Partition):
        return change_title(operation, change.after.settings, change.before.settings)
    return operation_text(operation)


def describe_placement(placement: Placement) -> str:
    """Say how good the choice of hosts is.

    Returns:
        A sentence.
    """
    if placement.verdict == "optimal":
        return (
            "The placement is optimal: no other placement reserves less, or moves fewer partitions with the same "
            "reservation."
        )
    gap = show_processors(Fraction(placement.reserved - placement.reserved_bound, 100))
    return f"The placement is within {gap} and {placement.moves - placement.moves_bound} moves of the optimum."
