"""Our mark in a machine's notes: one line, `rarms/1 robot/vision vm=0a1b2c3d set=0123456789ab`.

A partition that rarms stopped has a word more: `stopped` or `measuring` (`StoppedBy`), then follows the name of
its robot where the manifest has overlays, `robot=robot-7`, and one that the manifest protects ends with `protected`.

The other lines are the user's and stay as they are. A mark counts only where it names the machine that it stands on,
and no other machine carries a mark of the same partition; a machine whose mark does not count is unmanaged.
"""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

from rarms_iac.model.names import NAME_PATTERN
from rarms_iac.model.renaming import BETWEEN
from rarms_iac.model.state import ID_DIGITS, PROTECTED, Mark, StoppedBy

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
class MarkReading:
    """A machine's notes as read: a mark that counts, or why what looks like one does not, and the user's lines."""

    mark: Mark | None
    foreign: str  # empty: nothing that looks like a mark is left over
    other_notes: str


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


def read_marks(notes_by_id: Mapping[str, str]) -> dict[str, MarkReading]:
    """Find which machines of a host carry a mark that counts.

    Args:
        notes_by_id: the notes of every machine of the host, by its id.

    Returns:
        By id: the mark where it counts, or why it does not, and the user's own lines.
    """
    own = {
        machine: mark
        for machine, notes in notes_by_id.items()
        if (mark := read_mark(notes)) and mark.machine == machine[:ID_DIGITS].lower()
    }
    carriers = Counter((mark.application, mark.name) for mark in own.values())
    return {machine: _judge(notes, own.get(machine), carriers) for machine, notes in notes_by_id.items()}


def _judge(notes: str, own: Mark | None, carriers: Counter[tuple[str, str]]) -> MarkReading:
    others = erase_mark(notes)
    if own is None:
        return MarkReading(mark=None, foreign=_why_foreign(notes), other_notes=others)
    count = carriers[own.application, own.name]
    if count > 1:
        why = f"the mark of {own.application}/{own.name} stands on {count} machines"
        return MarkReading(mark=None, foreign=why, other_notes=others)
    return MarkReading(mark=own, foreign="", other_notes=others)


def _why_foreign(notes: str) -> str:
    marks, others = _split_notes(notes)
    if len(marks) > 1:
        return f"its notes hold {len(marks)} marks"
    if marks:
        return f"its mark names another machine ({marks[0].machine}): the machine was copied or imported"
    if any(_LOOKS_LIKE_ONE.match(line) for line in others.split("\n")):
        return "a line of its notes begins like a mark and is none"
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
