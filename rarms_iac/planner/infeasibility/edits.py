"""Changes of a manifest, as a person would make them, by as little as makes everything fit."""

from bisect import bisect_left
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

from rarms_iac.model.layout import RelaxedLevel
from rarms_iac.model.state import State
from rarms_iac.model.system import System
from rarms_iac.planner.infeasibility.conflict import SearchBudget
from rarms_iac.planner.problem import first_fit_finds_layout, problem_of
from rarms_iac.planner.reservations import ReservationSource

MOST_EDITS = 8
"""Changes that are offered together: no reader makes more of them from a list."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """A manifest, what was seen of its hosts, and what data logs say of it."""

    system: System
    states: Mapping[str, State]
    reservations: ReservationSource
    may_move: bool  # whether partitions may leave their hosts

    def with_entries(self, field: str, entries: Mapping[str, Any]) -> "Variant":
        """Return the same with these entries instead of those of their names.

        Args:
            field: `components`, `partitions` or `hosts` of the system.
            entries: values of that mapping, by name; a new name is added.

        Returns:
            A new variant; this one stays as it is.
        """
        changed: dict[str, Any] = {field: {**getattr(self.system, field), **entries}}
        return replace(self, system=replace(self.system, **changed))


@dataclass(frozen=True, slots=True)
class Edit:
    """One change of the manifest, as a person would make it."""

    message: str
    apply: Callable[[Variant], Variant]
    level: RelaxedLevel | None = None  # where it relaxes an APT
    host: str = ""  # on which it has to be measured, if the hosts differ in platform


Edits = tuple[Edit, ...]
"""Changes that are made together."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RelaxationRange:
    """One thing that can be changed by more or by less."""

    partitions: tuple[str, ...] = ()  # whose reservation it changes; none: it changes a host
    amounts: Sequence[int]  # the first changes most: if everything fits with one, it fits with each before it
    edits_at: Callable[[int], Edits]
    to_be_measured: bool = False  # that it fits depends on what partitions will probably need


@dataclass(frozen=True, slots=True, kw_only=True)
class VariantPlanner:
    """Plans changed manifests while the budget lasts; from then on nothing fits."""

    start: Variant
    budget: SearchBudget
    part: str = "changes"  # of the search, as a noun

    def searching(self, part: str) -> "VariantPlanner":
        """Return a planner of this part of the search, with the same budget.

        Args:
            part: A noun, such as `lower reserves`.
        """
        return replace(self, part=part)

    def fits(self, edits: Iterable[Edit]) -> bool:
        """Say whether first fit finds a layout with all of these changes; the solver takes a hundred times as long.

        Args:
            edits: made one after the other on the manifest.

        Returns:
            False also where neither is known, and where nothing is left of the budget.
        """
        if not self.budget.takes(self.part, len(self.start.system.components) * len(self.start.system.hosts)):
            return False
        after = reduce(lambda before, edit: edit.apply(before), edits, self.start)
        problem = problem_of(after.system, after.reservations, after.states, may_move=after.may_move)
        return first_fit_finds_layout(problem)


def smallest_edits(relaxations: Sequence[RelaxationRange], planner: VariantPlanner) -> Edits:
    """Find changes with which everything fits, none without need, and each as small as can be.

    Args:
        relaxations: What may be changed; the first are changed first.

    Returns:
        The changes; none where even all first amounts are not enough, or more are needed than are read.
    """
    relaxations = [relaxation for relaxation in relaxations if relaxation.amounts]
    chosen = [relaxation.edits_at(relaxation.amounts[0]) for relaxation in relaxations]
    if not relaxations or not planner.fits(_flat(chosen)):
        return ()
    needed = bisect_left(range(len(relaxations)), True, lo=1, key=lambda number: planner.fits(_flat(chosen[:number])))
    del chosen[needed:]
    for at in reversed(range(needed)):
        others = _flat(chosen[:at] + chosen[at + 1 :])
        if others and planner.fits(others):
            chosen[at] = ()
            continue
        relaxation = relaxations[at]
        beyond = bisect_left(
            relaxation.amounts,
            True,
            lo=1,
            key=lambda amount: not planner.fits((*others, *relaxation.edits_at(amount))),
        )
        chosen[at] = relaxation.edits_at(relaxation.amounts[beyond - 1])
    edits = _flat(chosen)
    return edits if len(edits) <= MOST_EDITS else ()


def _flat(chosen: Iterable[Edits]) -> Edits:
    return tuple(edit for edits in chosen for edit in edits)
