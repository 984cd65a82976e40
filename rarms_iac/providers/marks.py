"""Our mark in a machine's notes: one line, `rarms/1 robot/vision vm=0a1b2c3d set=0123456789ab`.

A partition that rarms stopped has a word more: `stopped` or `measuring` (`StoppedBy`), then follows the name of
its robot where the manifest has overlays, `robot=robot-7`, and one that the manifest protects ends with `protected`.

The other lines are the user's and stay as they are. A mark counts only where it names the machine that it stands on,
and no other machine carries a mark of the same partition; a machine whose mark does not count is unmanaged.
"""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache

from rarms_iac.model.names import NAME_PATTERN
from rarms_iac.model.renaming import BETWEEN
from rarms_iac.model.state import ID_DIGITS, PROTECTED, Mark, Partition, StoppedBy

_NAME = NAME_PATTERN.removeprefix("^").removesuffix("$")
_BETWEEN = re.escape(BETWEEN)
_STOPPED = "|".join(word.value for word in StoppedBy if word.value)
_LINE = re.compile(
    rf"rarms/1 (?P<application>{_NAME})/(?P<name>{_NAME}(?:{_BETWEEN})?) "
    rf"vm=(?P<machine>[0-9a-f]{{8}}) set=(?P<set>[0-9a-f]{{12}})"
    rf"(?P<stopped_by>(?: (?:{_STOPPED}))?)(?: robot=(?P<robot>{_NAME}))?(?P<protected>(?: {PROTECTED})?)"
)
_LOOKS_LIKE_ONE = re.compile(r"\s*rarms/[0-9]")


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
        why = f"the mark of {own.application}/{own.name} stands on {count} machines"
        return replace(partition, other_notes=others, foreign_mark=why)
    return replace(partition, mark=own, other_notes=others)


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
