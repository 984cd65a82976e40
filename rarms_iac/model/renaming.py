"""Which name each of our partitions is to bear after `moved`."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

BETWEEN = ".moving"
"""Ends the name a mark bears while two partitions change places; a dot cannot occur in a manifest's name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Renaming:
    """The new name of every name that is there; the same where nothing moves."""

    new: Mapping[str, str]
    impossible: tuple[str, ...] = ()  # names that `moved` would give a name that another keeps


def renaming(there: Collection[str], wanted: Collection[str], moved: Mapping[str, str]) -> Renaming:
    """Return what the partitions that are there are to be called.

    A move happens where the old name is on the host, the new one is wanted, and the new one is free or moves away
    itself. A name that stepped aside for an exchange goes on to where it was going.
    """
    new = {}
    for name in there:
        goal = name.removesuffix(BETWEEN) if name.endswith(BETWEEN) else moved.get(name, name)
        new[name] = goal if goal in wanted else name
    impossible: list[str] = []
    while clash := _clash(new):
        impossible += clash
        new.update({name: name for name in clash})
    return Renaming(new=new, impossible=tuple(impossible))


def _clash(new: Mapping[str, str]) -> list[str]:
    """Names that would move onto a name that another one takes or keeps."""
    takers: dict[str, list[str]] = {}
    for name, goal in new.items():
        takers.setdefault(goal, []).append(name)
    return sorted(name for goal, names in takers.items() if len(names) > 1 for name in names if name != goal)
