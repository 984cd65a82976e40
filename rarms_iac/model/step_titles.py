"""What a step does in a few words, from what was found to what is set; and the step that takes one back."""

from collections.abc import Mapping
from fractions import Fraction

from rarms_iac.model.changes import Address, Change, Update
from rarms_iac.model.operations import (
    Operation,
    RenamePartition,
    SetCpu,
    SetMemory,
    SetProcessors,
    SetSecureBoot,
    WriteMark,
    forced_after_ms,
)
from rarms_iac.model.plan import Step
from rarms_iac.model.quantities import plain, show_lp_percent, show_period, write_bytes
from rarms_iac.model.state import Partition, PartitionSettings


def describe_stop(grace: int, *, forces: bool) -> str:
    """Describe how a guest is stopped.

    Args:
        grace: milliseconds that it has to shut down; 0: it is turned off without being asked.
        forces: whether its host can force it to shut down.

    Returns:
        Words for the title of a step, with the times in seconds after it was asked.
    """
    if not grace:
        return "turned off, not asked"
    forced = f"after {_seconds(forced_after_ms(grace))} s forced, " if forces else ""
    return f"asked, {forced}after {_seconds(grace)} s turned off"


def _seconds(milliseconds: int) -> str:
    return plain(Fraction(milliseconds, 1000))


def new_title(operation: Operation, to: PartitionSettings) -> str:
    """Say what a new machine gets, its reserve in both units."""
    if not isinstance(operation, SetCpu):
        return str(operation)
    reserve = f"reserve {_lp(to)} ({to.reserve} % of {_each(to)})"
    period = f", counted every {show_period(to.quota_period_us)}" if to.quota_period_us else ""
    return f"{reserve}, limit {to.limit} % of {_each(to)}{period}, weight {to.weight}"


def change_title(operation: Operation, old: PartitionSettings, to: PartitionSettings) -> str:
    """Say from what to what an operation changes a machine that was there.

    Args:
        old: its settings before the change, of all steps that belong together.
        to: its settings after it.

    Returns:
        Only what differs, the reserve in both units; what the operation says where it sets nothing of the kind.
    """
    match operation:
        case SetProcessors():
            return f"processors {old.processors} -> {to.processors}"
        case SetCpu():
            return ", ".join(_cpu_changes(old, to)) or str(operation)
        case SetMemory():
            kind = ("dynamic" if to.dynamic_memory else "static") if old.dynamic_memory != to.dynamic_memory else ""
            return f"memory {write_bytes(old.memory)} -> {write_bytes(to.memory)}{kind and f', {kind}'}"
        case SetSecureBoot(secure_boot=secure_boot):
            return f"secure boot {old.secure_boot} -> {secure_boot}"
        case RenamePartition(name=name):
            return f"name {old.name} -> {name}"
        case WriteMark():
            return f"{operation}, set {operation.mark('').written}"
        case _:
            return str(operation)


def reversal(step: Step, changes: Mapping[Address, Change]) -> Step:
    """Return the step that takes one back, titled from what is found then to what was there before.

    Args:
        step: of a plan; it has an undo with an operation.
        changes: those of its host, by address.
    """
    assert step.undo.operation is not None, "a step without an undo is not taken back"
    operation, change = step.undo.operation, changes.get(step.address)
    if isinstance(change, Update) and isinstance(change.before, Partition) and isinstance(change.after, Partition):
        return step.reversed(change_title(operation, change.after.settings, change.before.settings))
    return step.reversed(str(operation))


def _cpu_changes(old: PartitionSettings, to: PartitionSettings) -> list[str]:
    changes = [_reserve_change(old, to)] if old.reserve != to.reserve else []
    changes += [f"limit {old.limit} -> {to.limit} % of {_each(to)}"] if old.limit != to.limit else []
    changes += [f"weight {old.weight} -> {to.weight}"] if old.weight != to.weight else []
    if old.quota_period_us != to.quota_period_us:
        changes.append(f"period {show_period(old.quota_period_us)} -> {show_period(to.quota_period_us)}")
    return changes


def _reserve_change(old: PartitionSettings, to: PartitionSettings) -> str:
    """From what to what in logical processors, and in per cent of the machine's own."""
    percents = f"{old.reserve} -> {to.reserve} % of {_each(to)}"
    if old.processors != to.processors:
        percents = f"{old.reserve} % of {_each(old)} -> {to.reserve} % of {_each(to)}"
    return f"reserve {plain(Fraction(old.reserve * old.processors, 100))} -> {_lp(to)} ({percents})"


def _lp(settings: PartitionSettings) -> str:
    return show_lp_percent(settings.reserve * settings.processors)


def _each(settings: PartitionSettings) -> str:
    return "its processor" if settings.processors == 1 else f"each of {settings.processors} processors"
