"""Which processors of an operating system the threads of a class may use, so that none waits for a less critical one.

A mask leaves processors to who is more critical, so the most critical class has none. Only classes without an APT are
kept to some: fewer processors than it was measured with could falsify an APT. What a class may use lies within what
every more critical one may use. So where a thread waits, all its processors run threads that are as critical or more,
and no less critical thread runs anywhere else, because it may use no other processor (docs/decisions/0013).
"""

from collections.abc import Mapping, Sequence
from itertools import groupby

from rarms_iac.model.system import Component

ALL = 0
"""The mask that keeps a class to nothing (FACTS 6.1)."""

NAMED_UP_TO = 32
"""A mask has so many bits: of more processors not all can be named."""


def masks_of(users: Sequence[Sequence[Component]], processors: int) -> Mapping[str, int]:
    """The mask of each class that is kept to some, by its name in lower case.

    From the least critical up, each level gets its own processors beside those of the levels below, the last ones
    first. A level that finds no room beside them is not kept, and then none above it is.

    Args:
        users: of each class the components that name it, and each component that names none, in any order; all of
            one operating system.
        processors: how many this has; 0 where nobody knows.
    """
    if not 1 < processors <= NAMED_UP_TO:
        return {}
    found: dict[str, int] = {}
    width = 0
    levels = [list(level) for _, level in groupby(sorted(users, key=_criticality), key=_criticality)]
    for level in levels[:-1]:
        width += sum(_wanted(one, processors) for one in level)
        if width >= processors:
            break
        for one in level:
            assert one[0].task is not None, "who names no class wants all"
            found[one[0].task.lower()] = _last(width, processors)
    return found


def _criticality(users: Sequence[Component]) -> int:
    return max(user.criticality for user in users)


def _wanted(users: Sequence[Component], processors: int) -> int:
    """What all components of a class can use at once; everything where one has an APT, or no class, or does not say."""
    if any(user.apt or user.task is None or user.processors is None for user in users):
        return processors
    return sum(user.processors or 0 for user in users)


def _last(width: int, processors: int) -> int:
    return ((1 << width) - 1) << (processors - width)
