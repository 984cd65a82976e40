"""Machines as providers keep them: settings and notes, and our mark in the notes.

A mark is one line, `rarms/1 robot/vision vm=0a1b2c3d set=0123456789ab`.

A partition that rarms stopped has a word more: `stopped` or `measuring` (`StoppedBy`), then follows the name of
its robot where the manifest has overlays, `robot=robot-7`, and one that the manifest protects ends with `protected`.

The other lines are the user's and stay as they are. A mark counts only where it names the machine that it stands on,
and no other machine carries a mark of the same partition; a machine whose mark does not count is unmanaged.
"""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeVar

from rarms_iac.model.names import BETWEEN, NAME_PATTERN
from rarms_iac.model.operation_effects import applied
from rarms_iac.model.operations import EraseMark, MachineOperation, RestorePartition, WriteMark
from rarms_iac.model.state import (
    ID_DIGITS,
    NO_GENERATION,
    PROTECTED,
    Checkpoints,
    Mark,
    Partition,
    PartitionSettings,
    StartAction,
    StopAction,
    StoppedBy,
)
from rarms_iac.texts.quantities import show_bytes

_NAME = NAME_PATTERN.removeprefix("^").removesuffix("$")
_BETWEEN = re.escape(BETWEEN)
_STOPPED = "|".join(word.value for word in StoppedBy if word.value)
_LINE = re.compile(
    rf"rarms/1 (?P<application>{_NAME})/(?P<name>{_NAME}(?:{_BETWEEN})?) "
    rf"vm=(?P<machine>[0-9a-f]{{8}}) set=(?P<set>[0-9a-f]{{12}})"
    rf"(?P<stopped_by>(?: (?:{_STOPPED}))?)(?: robot=(?P<robot>{_NAME}))?(?P<protected>(?: {PROTECTED})?)"
)
_LOOKS_LIKE_ONE = re.compile(r"\s*rarms/[0-9]")


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptMachine:
    """A machine that its provider keeps in a file."""

    id: str
    settings: PartitionSettings
    notes: str = ""


K = TypeVar("K", bound=KeptMachine)


def changed(machine: K, operation: MachineOperation) -> K:
    """Return the machine after an operation on its settings or its mark."""
    match operation:
        case WriteMark():
            return replace(machine, notes=write_mark(machine.notes, operation.mark(machine.id)))
        case EraseMark():
            return replace(machine, notes=erase_mark(machine.notes))
        case _:
            return replace(machine, settings=applied(machine.settings, operation))


def new_settings(name: str, memory: int) -> PartitionSettings:
    """Return the settings of a partition that is off and reserves nothing, without a choice of the host."""
    return PartitionSettings(
        name=name,
        generation=NO_GENERATION,
        processors=1,
        reserve=0,
        limit=100,
        weight=100,
        memory=memory,
        dynamic_memory=False,
        start_action=StartAction.NOTHING,
        stop_action=StopAction.SHUT_DOWN,
        checkpoints=Checkpoints.DISABLED,
        running=False,
    )


def notes_of(operation: RestorePartition) -> str:
    """Return the notes of a machine that is made again, with its mark."""
    return write_mark(operation.other_notes, operation.mark) if operation.mark else operation.other_notes


def cpu_out_of_range(settings: PartitionSettings) -> str:
    """Describe the first setting of its processors that no machine can have; empty where all are possible."""
    if not 0 <= settings.reserve <= 100 or not 0 <= settings.limit <= 100:
        return f"reserve and limit are 0 to 100 %, not {settings.reserve} % and {settings.limit} %"
    if not 1 <= settings.weight <= 10_000:
        return f"a weight is 1 to 10000, not {settings.weight}"
    return ""


def lack_of_memory(wanted: PartitionSettings, others: Iterable[PartitionSettings], memory: int) -> str:
    """Describe the memory that a machine lacks while others have theirs, of so many bytes; empty: it has room."""
    taken = sum(other.memory for other in others)
    if taken + wanted.memory <= memory:
        return ""
    free = max(0, memory - taken)
    needed, room = show_bytes(wanted.memory, free), show_bytes(free, wanted.memory)
    return f"{wanted.name} needs {needed}; {room} of {show_bytes(memory)} are free"


def lack_of_processors(wanted: PartitionSettings, available: int, *, fits: bool) -> str:
    """Describe why a reserve has no room on so many logical processors, where what runs leaves it none."""
    if wanted.processors > available:
        return f"{wanted.name} has {wanted.processors} processors with a reserve; the host has {available}"
    reserve = f"the reserve of {wanted.name}, {wanted.reserve} % of each of {wanted.processors} processors,"
    return "" if fits else f"{reserve} does not fit on {available} logical processors with the running machines"


def write_mark(notes: str, mark: Mark) -> str:
    """Return the notes with this mark, in place of any other; the user's lines stay."""
    line = f"rarms/1 {mark.application}/{mark.name} vm={mark.machine} set={mark.written}"
    others = erase_mark(notes)
    return f"{others}\n{line}" if others else line


def erase_mark(notes: str) -> str:
    """Return the notes without marks."""
    return _split_notes(notes)[1]


def read_mark(notes: str) -> Mark | None:
    """Return the mark in the notes, None where there is none or more than one."""
    marks, _ = _split_notes(notes)
    return marks[0] if len(marks) == 1 else None


def with_marks(machines: Iterable[tuple[Partition, str]]) -> tuple[Partition, ...]:
    """Return a host's machines by name and then id, each with its mark if that counts, or why it does not.

    Args:
        machines: every machine of the host, with its notes.
    """
    known = sorted(machines, key=lambda each: (each[0].settings.name, each[0].id))
    own = [(partition, notes, _own_mark(partition, notes)) for partition, notes in known]
    carriers = Counter((mark.application, mark.name) for _, _, mark in own if mark)
    return tuple(_judged(partition, notes, mark, carriers) for partition, notes, mark in own)


def _own_mark(partition: Partition, notes: str) -> Mark | None:
    mark = read_mark(notes)
    return mark if mark and mark.machine == partition.id[:ID_DIGITS].lower() else None


def _judged(partition: Partition, notes: str, own: Mark | None, carriers: Counter[tuple[str, str]]) -> Partition:
    others = erase_mark(notes)
    if own is None:
        return replace(partition, other_notes=others, foreign_mark=_why_foreign(notes))
    if (count := carriers[own.application, own.name]) > 1:
        why = f"{count} machines have the mark of {own.application}/{own.name}"
        return replace(partition, other_notes=others, foreign_mark=why)
    return replace(partition, mark=own, other_notes=others)


def _why_foreign(notes: str) -> str:
    marks, others = _split_notes(notes)
    if len(marks) > 1:
        return f"its notes have {len(marks)} marks"
    if marks:
        return f"its mark names another machine ({marks[0].machine}): the machine was copied or imported"
    if any(_LOOKS_LIKE_ONE.match(line) for line in others.split("\n")):
        return "a line of its notes begins like a mark but is not valid"
    return ""


@lru_cache(maxsize=10_000)  # a host is looked at several times a step, and its notes hardly ever change
def _split_notes(notes: str) -> tuple[tuple[Mark, ...], str]:
    """Return the marks in the notes, and the other lines."""
    lines = [(line, _LINE.fullmatch(line.rstrip("\r"))) for line in notes.split("\n")]
    marks = tuple(_mark_of(found) for _, found in lines if found)
    return marks, "\n".join(line for line, found in lines if not found)


def _mark_of(line: re.Match[str]) -> Mark:
    return Mark(
        application=line["application"],
        name=line["name"],
        machine=line["machine"],
        set=line["set"],
        stopped_by=StoppedBy(line["stopped_by"].strip()),
        robot=line["robot"] or "",
        protected=bool(line["protected"]),
    )
