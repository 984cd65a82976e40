"""Which of our machines stands for which partition of the manifest: `moved` renames instead of replacing."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from rarms_iac.diff import findings
from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.state import Partition, State

BETWEEN = ".moving"
"""Ends the name a mark bears while two partitions change places; a dot cannot occur in a manifest's name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Moves:
    """Our machines by the name they are to have."""

    ours: Mapping[str, Partition]
    findings: tuple[Diagnostic, ...]
    places: Places | None


def names_of(
    observed: State,
    application: str,
    wanted: Collection[str],
    moved: Mapping[str, str],
    places: Places | None,
) -> Moves:
    """Our machines by their wanted names, after the manifest's moves.

    A move happens where the old name is on the host, the new one is wanted, and the new one is free or moves away
    itself. Where both are there to stay, nothing moves, and a finding says so.
    """
    marked = {one.mark.name: one for one in observed.of(application).partitions if one.mark}
    told: list[Diagnostic] = []
    target: dict[str, str] = {}
    for name in marked:
        new = name.removesuffix(BETWEEN) if name.endswith(BETWEEN) else moved.get(name, name)
        target[name] = new if new in wanted else name
    for name in _that_collide(target):
        if name in moved:
            told.append(_both_exist(name, target[name], places))
        target[name] = name
    return Moves(ours={target[name]: one for name, one in sorted(marked.items())}, findings=tuple(told), places=places)


def _that_collide(target: Mapping[str, str]) -> list[str]:
    """Names whose move would end where another machine stays, and those that hang behind them."""
    left = dict(target)
    gone: list[str] = []
    while True:
        holders: dict[str, list[str]] = {}
        for name, new in left.items():
            holders.setdefault(new, []).append(name)
        clash = sorted(name for new, names in holders.items() if len(names) > 1 for name in names if name != new)
        if not clash:
            return gone
        gone += clash
        left.update({name: name for name in clash})


def _both_exist(old: str, new: str, places: Places | None) -> Diagnostic:
    return findings.NOTHING_TO_MOVE.at(
        places.key("moved", old) if places else None,
        f"`moved` calls {old!r} now {new!r}, but the host has a partition of each name.",
        f"Remove one of them (`rarms destroy --target partition/{old}`), or take the line out of `moved`.",
        address=f"partition/{old}",
    )
