"""What a comparison is told beside the two states, and what each part of it finds."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from rarms_iac.model.changes import Address, Change
from rarms_iac.model.diagnostics import Diagnostic, Place


def nowhere(_address: Address) -> Place | None:
    """The place of what no manifest line asks for."""
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Wishes:
    """What the manifest says beside the desired state."""

    moved: Mapping[str, str] = field(default_factory=dict)  # old partition name -> new
    protected: frozenset[str] = frozenset()  # partitions that must not be removed
    replaceable: frozenset[str] = frozenset()  # shipped task classes that may be replaced, in lower case
    unused: frozenset[str] = frozenset()  # partitions of ours that the manifest no longer wants: stopped, not removed
    where: Callable[[Address], Place | None] = nowhere  # the manifest line that asks for it


@dataclass(slots=True)
class Found:
    """Gathers while one kind of resource is walked."""

    changes: list[Change] = field(default_factory=list)
    unused: list[str] = field(default_factory=list)
    findings: list[Diagnostic] = field(default_factory=list)
    unchanged: int = 0
