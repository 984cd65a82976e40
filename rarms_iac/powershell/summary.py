"""What a script does, in a few lines of its head: what is at stake, the machines, and the calls. Pure."""

from collections import Counter
from collections.abc import Iterable, Sequence

from rarms_iac.model.changes import SLASH, Change, Create
from rarms_iac.model.operations import CreatePartition
from rarms_iac.model.plan import Step
from rarms_iac.model.quantities import show_bytes, show_lp_percent
from rarms_iac.model.state import Partition, PartitionSettings
from rarms_iac.model.wording import counted, remark
from rarms_iac.powershell.pieces import NewFiles, ScriptPiece

_MADE, _REMOVED, _STOPPED, _DELETED = "New-VM", "Remove-VM", "Stop-Partition", "Remove-DiskFile"
_PARTITION = "partition/"


def summary_lines(pieces: Sequence[ScriptPiece]) -> tuple[str, str]:
    """Sum up the steps of a script.

    Args:
        pieces: all of them; at least one.

    Returns:
        A line that counts machines that are added, changed, stopped and removed, and disks that are deleted; and a line
        with how often each call stands in the steps that change something: no other changes anything.
    """
    calls = [(piece.address, call.split(" ", 1)[0].rpartition(SLASH)[2]) for piece in pieces for call in piece.calls]
    machines = {
        name: {address.split("/")[1] for address, called in calls if called == name}
        for name in (_MADE, _REMOVED, _STOPPED)
    }
    touched = {address.split("/")[1] for address, _ in calls if address.startswith(_PARTITION)}
    changed = touched - machines[_MADE] - machines[_REMOVED]
    deleted = sum(name == _DELETED for _, name in calls)
    risk = (
        f"{counted(len(machines[_MADE]), 'machine')} added, {len(changed)} changed, {len(machines[_STOPPED])} stopped, "
        f"{len(machines[_REMOVED])} removed; {counted(deleted, 'disk') if deleted else 'nothing'} deleted."
    )
    names = Counter(name for _, name in calls)
    call_counts = ", ".join(f"{name} {number}" for name, number in sorted(names.items()))
    return risk, f"Only these calls change something (and how often): {call_counts}."


_COLUMNS = ("machine", "processors", "reserve", "memory", "disk", "switch", "secure boot", "start")


def machine_table(steps: Sequence[Step], changes: Iterable[Change], files: NewFiles) -> tuple[str, ...]:
    """Tell what the machines are that a script makes.

    Args:
        steps: the plan's, of one script.
        changes: of the host.
        files: where their disks lie.

    Returns:
        A line of titles and one for each machine, in the order in which they are made; nothing where none is.
    """
    wanted = {change.address.partition: change.after for change in changes if isinstance(change, Create)}
    made: dict[str, CreatePartition] = {}
    for step in steps:
        if isinstance(step.operation, CreatePartition):
            made.setdefault(step.operation.partition, step.operation)
    machines = ((creation, wanted.get(name)) for name, creation in made.items())
    rows = [
        tuple(map(remark, _row(creation, machine.settings, files)))
        for creation, machine in machines
        if isinstance(machine, Partition)
    ]
    if not rows:
        return ()
    widths = [max(map(len, column)) for column in zip(_COLUMNS, *rows, strict=True)]
    return tuple(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in (_COLUMNS, *rows)
    )


def _row(creation: CreatePartition, settings: PartitionSettings, files: NewFiles) -> tuple[str, ...]:
    disk = f"{files.disk(creation)} from {creation.image}" if creation.image else "none"
    return (
        creation.partition,
        str(settings.processors),
        f"{show_lp_percent(settings.reserve * settings.processors)} ({settings.reserve} % of each)",
        show_bytes(settings.memory),
        disk,
        creation.switch or "none",
        creation.secure_boot or "as made",
        settings.start_action.value.replace("_", " "),
    )
