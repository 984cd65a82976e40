"""Which processors of an operating system the threads of a class may use, so that none waits for a less critical one.

Only classes without an APT are kept to some: fewer processors than it was measured with could falsify an APT. What a
class may use lies within what every more critical one may use. So where a thread waits, all its processors run threads
that are as critical or more, and no less critical thread runs anywhere else, because it may use no other processor.
"""

from collections.abc import Mapping, Sequence
from itertools import groupby

from rarms_iac.model.system import Component

ALL = 0
"""The mask that keeps a class to nothing (FACTS 6.1)."""

NAMED_UP_TO = 32
"""A mask has so many bits: of more processors not all can be named."""


def masks_of(users: Sequence[Sequence[Component]], processors: int) -> Mapping[str, int]:
    """The mask of each class, by its name in lower case; `users` name one class each, in any order.

    From the least critical up: a class whose components all say `processors`, and have no APT, is kept to as many, the
    last ones; the first that is not kept so frees all that are more critical.
    """
    if not 1 < processors <= NAMED_UP_TO:
        return {}
    found: dict[str, int] = {}
    width = 0
    by_criticality = sorted(users, key=_criticality)
    for _, level in groupby(by_criticality, key=_criticality):
        classes = list(level)
        width = max([width, *(_wanted(one, processors) for one in classes)])
        if width >= processors:
            break
        for one in classes:
            assert one[0].task is not None, "who uses a class names it"
            found[one[0].task.lower()] = _last(width, processors)
    return found


def _criticality(users: Sequence[Component]) -> int:
    return max(one.criticality for one in users)


def _wanted(users: Sequence[Component], processors: int) -> int:
    """What all components of a class can use at once; everything where one has an APT or does not say."""
    if any(one.apt or one.processors is None for one in users):
        return processors
    return sum(one.processors or 0 for one in users)


def _last(width: int, processors: int) -> int:
    return ((1 << width) - 1) << (processors - width)
