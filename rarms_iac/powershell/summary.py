"""What a script does in two lines of its head: what is at stake, and the calls that change something. Pure."""

from collections import Counter
from collections.abc import Iterable, Sequence

from rarms_iac.model.changes import SLASH
from rarms_iac.model.wording import counted
from rarms_iac.powershell.pieces import ScriptPiece

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
    calls = [(piece.address, _name(call)) for piece in pieces for call in piece.calls]
    machines = {name: _machines(calls, name) for name in (_MADE, _REMOVED, _STOPPED)}
    touched = {address.split("/")[1] for address, _ in calls if address.startswith(_PARTITION)}
    changed = touched - machines[_MADE] - machines[_REMOVED]
    deleted = sum(name == _DELETED for _, name in calls)
    risk = (
        f"{counted(len(machines[_MADE]), 'machine')} added, {len(changed)} changed, {len(machines[_STOPPED])} stopped, "
        f"{len(machines[_REMOVED])} removed; {counted(deleted, 'disk') if deleted else 'nothing'} deleted."
    )
    names = Counter(name for _, name in calls)
    call_counts = ", ".join(f"{name} {number}" for name, number in sorted(names.items()))
    return risk, f"Calls that change something: {call_counts}."


def _machines(calls: Iterable[tuple[str, str]], name: str) -> set[str]:
    return {address.split("/")[1] for address, called in calls if called == name}


def _name(call: str) -> str:
    """The call's cmdlet or function, without its module."""
    return call.split(" ", 1)[0].rpartition(SLASH)[2]
