"""What a script does, in a few lines of its head: what is at stake, the machines, the time, and the calls. Pure."""

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from itertools import groupby
from math import ceil

from rarms_iac.model.changes import SLASH, Change, Create
from rarms_iac.model.operations import (
    CreatePartition,
    RemovePartition,
    RestorePartition,
    StartPartition,
    StopPartition,
    WriteMark,
)
from rarms_iac.model.plan import Step, UndoLevel, owner_of
from rarms_iac.model.state import Partition, PartitionSettings
from rarms_iac.powershell.pieces import NewFiles, ScriptPiece
from rarms_iac.storage.marks import ForeignValue
from rarms_iac.texts.messages import counted, natural_order, remark
from rarms_iac.texts.quantities import show_bytes, show_lp_percent

_MADE, _REMOVED, _STOPPED, _DELETED = "New-VM", "Remove-VM", "Stop-Partition", "Remove-Item"
_REMOVED_CLASS, _WAITS = "Remove-TaskClass", "Wait-Start"
_PARTITION, _TASK = "partition/", "/task/"

NOT_MADE_AGAIN = "the partition cannot be created again"  # by a script: a simulated host makes it again
NOT_UNDONE = "Not undone"
"""Begins the lines of a head that say what cannot be undone."""
FOREIGN = "Not set by rarms"
"""Begins the lines of a head that list values of others, which the undo sets again."""

_LAST_LOOK_S = 300  # of the module's Assert-Host
_TOLD_BY_A_WORD = (CreatePartition, RemovePartition, StartPartition, StopPartition, WriteMark)


def summary_lines(pieces: Sequence[ScriptPiece]) -> tuple[str, str]:
    """Sum up the steps of a script.

    Args:
        pieces: all of them; at least one.

    Returns:
        A line that counts machines that are added, changed, stopped and removed, disks that are deleted, and task
        classes; and a line with how often each call stands in the steps that change something: no other changes
        anything.
    """
    calls = [(piece.address, call.split(" ", 1)[0].rpartition(SLASH)[2]) for piece in pieces for call in piece.calls]
    machines = {
        name: {address.split("/")[1] for address, called in calls if called == name}
        for name in (_MADE, _REMOVED, _STOPPED)
    }
    of_machines = {address for address, _ in calls if address.startswith(_PARTITION) and _TASK not in address}
    touched = {address.split("/")[1] for address in of_machines}
    changed = touched - machines[_MADE] - machines[_REMOVED]
    deleted = sum(name == _DELETED for _, name in calls)
    classes = {address for address, _ in calls} - of_machines
    gone = {address for address, name in calls if name == _REMOVED_CLASS}
    parts = [
        f"{counted(len(machines[_MADE]), 'machine')} added, {len(changed)} changed, {len(machines[_STOPPED])} stopped, "
        f"{len(machines[_REMOVED])} removed",
        f"{counted(deleted, 'disk')} deleted",
        *([f"task classes: {len(classes - gone)} changed, {len(gone)} removed"] if classes else []),
    ]
    names = Counter(name for _, name in calls if name != _WAITS)
    call_counts = ", ".join(f"{name} {number}" for name, number in sorted(names.items()))
    risk = "; ".join(parts if of_machines else [*parts[2:], "no machine is stopped or changed"])
    return f"{risk}.", f"Only these calls change something, with their numbers: {call_counts}."


def duration_line(steps: Sequence[Step]) -> str:
    """Say how long a script may take: what its calls take is the host's affair, what it waits for is not."""
    graces = [step.operation.grace_ms for step in steps if isinstance(step.operation, StopPartition)]
    waits = [f"at most {_seconds(sum(graces))} s while guests stop, one after another"] if any(graces) else []
    if started := sum(step.wait_ms or 0 for step in steps):
        waits.append(f"{_seconds(started)} s while machines start, one after another")
    if any(step.address.partition and not step.address.task for step in steps):
        waits.append(f"at most {_LAST_LOOK_S} s at the end, if a guest is just restarting")
    return f"Time: a few seconds for each call. The script waits {'; '.join(waits) or 'for no guest'}."


def not_undone_lines(steps: Iterable[Step]) -> tuple[str, ...]:
    """Say what cannot be brought back of what these steps change, and of which partition or task class."""
    steps = tuple(steps)
    gone = {owner_of(step) for step in steps if isinstance(step.operation, RemovePartition)}
    owners: dict[str, dict[str, None]] = {}
    for step in steps:
        if isinstance(step.undo.operation, RestorePartition):
            owners.setdefault(NOT_MADE_AGAIN, {})[owner_of(step)] = None
        elif step.undo.level is UndoLevel.NONE or (step.undo.level is UndoLevel.PARTIAL and owner_of(step) not in gone):
            owners.setdefault(step.undo.message, {})[owner_of(step)] = None
    return tuple(f"{NOT_UNDONE}: {', '.join(names)}: {message}" for message, names in owners.items())


def foreign_lines(values: Iterable[ForeignValue]) -> tuple[str, ...]:
    """List the values that an undo sets again and that rarms had not set."""
    return tuple(
        f"{FOREIGN}: {value.address}: {value.name} {value.foreign}; the plan sets {value.applied}" for value in values
    )


def change_table(steps: Iterable[Step], lost: Collection[str] = ()) -> tuple[str, ...]:
    """Tell what is done to the machines that a script does not make, and to task classes.

    Args:
        steps: of one script, in their order.
        lost: of an undo, the partitions that are there only where the run ended before it had removed them.

    Returns:
        A line of titles and one for each partition or task class, by name; nothing where there is none. Where one
        stops, the last column says for how long. One row of two columns needs no titles.
    """
    in_order = sorted(steps, key=lambda step: natural_order(_row_name(step)))
    rows = [_change_row(name, tuple(own), lost=name in lost) for name, own in groupby(in_order, key=_row_name)]
    columns = 3 if any(off for _, _, off in rows) else 2
    titles = [("name", "the running step", "off")] if len(rows) > 1 or columns > 2 else []
    return _table([row[:columns] for row in (*titles, *rows)]) if rows else ()


def _row_name(step: Step) -> str:
    return step.address.in_short if step.address.task else owner_of(step)


def _change_row(name: str, steps: Sequence[Step], *, lost: bool) -> tuple[str, str, str]:
    kinds = {type(step.operation) for step in steps}
    stops = [step.operation for step in steps if isinstance(step.operation, StopPartition)]
    words = ["stopped"] if stops else []
    words += ["removed"] if RemovePartition in kinds else []
    changes = [step.title for step in steps if not isinstance(step.operation, _TOLD_BY_A_WORD)]
    started = ["started"] if StartPartition in kinds else []
    done = "; ".join([*words, *changes, *started] or [step.title for step in steps])
    done += ", if the run ended before the machine was removed" if lost else ""
    return name, done, _off(stops[0].grace_ms, starts=bool(started)) if stops else ""


def _off(grace_ms: int, *, starts: bool) -> str:
    """Return the time from stop to start; how long the guest needs to start is not known here."""
    if starts:
        return "until it has started" + (f", at most {_seconds(grace_ms)} s to stop" if grace_ms else "")
    return "for good, " + (f"after at most {_seconds(grace_ms)} s" if grace_ms else "at once")


def _seconds(milliseconds: int) -> int:
    return ceil(milliseconds / 1000)


_COLUMNS = ("machine", "processors", "reserve", "weight", "memory", "disk", "switch", "secure boot", "start")


def machine_table(steps: Sequence[Step], changes: Iterable[Change], files: NewFiles) -> tuple[str, ...]:
    """Tell what the machines are that a script makes.

    Returns:
        A line of titles and one for each machine, in the order in which they are made; nothing where none is.
    """
    wanted = {change.address.partition: change.after for change in changes if isinstance(change, Create)}
    made: dict[str, CreatePartition] = {}
    for step in steps:
        if isinstance(step.operation, CreatePartition):
            made.setdefault(step.operation.partition, step.operation)
    machines = ((creation, wanted.get(name)) for name, creation in made.items())
    rows = [_row(creation, machine.settings, files) for creation, machine in machines if isinstance(machine, Partition)]
    return _table([_COLUMNS, *rows]) if rows else ()


def _table(rows: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    """Write rows as lines, each column as wide as it needs."""
    cells = [tuple(map(remark, row)) for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return tuple(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in cells
    )


def _row(creation: CreatePartition, settings: PartitionSettings, files: NewFiles) -> tuple[str, ...]:
    disk = f"{files.disk(creation)} from {creation.image}" if creation.image else "none"
    return (
        creation.partition,
        str(settings.processors),
        f"{show_lp_percent(settings.reserve * settings.processors)} ({settings.reserve} % of each)",
        str(settings.weight),
        show_bytes(settings.memory),
        disk,
        creation.switch or "none",
        creation.secure_boot or "default",
        settings.start_action.value.replace("_", " "),
    )
