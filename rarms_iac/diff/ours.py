"""Our machines by the name they are to have."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from rarms_iac.diff import findings
from rarms_iac.model.changes import Address
from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.model.moves import renaming
from rarms_iac.model.state import Partition, State


@dataclass(frozen=True, slots=True, kw_only=True)
class Ours:
    """Our machines by the name they are to have, the new names by the old, and moves that cannot be."""

    machines: Mapping[str, Partition]
    new_names: Mapping[str, str]
    findings: tuple[Diagnostic, ...]


def ours_of(
    observed: State,
    application: str,
    wanted: Collection[str],
    moved: Mapping[str, str],
    where: Callable[[Address], Place | None],
) -> Ours:
    """What carries our mark, after the manifest's moves."""
    marked = {partition.mark.name: partition for partition in observed.of(application).partitions if partition.mark}
    names = renaming(marked, wanted, moved)
    told = [
        _both_exist(name, moved[name], where(Address(partition=name))) for name in names.impossible if name in moved
    ]
    return Ours(
        machines={names.new[name]: partition for name, partition in sorted(marked.items())},
        new_names=names.new,
        findings=tuple(told),
    )


def _both_exist(old: str, new: str, place: Place | None) -> Diagnostic:
    return findings.NOTHING_TO_MOVE.at(
        place,
        f"`moved` calls {old!r} now {new!r}, but the host has a partition of each name.",
        f"Remove one of them (`rarms destroy --target partition/{old}`), or take the line out of `moved`.",
        address=f"partition/{old}",
    )
