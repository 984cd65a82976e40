"""Changes of a manifest, as a person would make them, and whether everything fits with them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Any

from rarms_iac.model.indexes import find_index, show_threshold, show_value
from rarms_iac.model.quantities import CpuAmount, show_amount
from rarms_iac.model.system import Component, Host, System, Threshold
from rarms_iac.planner.problem import HostView, has_layout, problem_of
from rarms_iac.planner.reservations import MeasuredReservations, NotMeasured, ReservationSource

TRIALS = 250
"""Manifests that are planned in all, before nothing more is offered."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """A manifest, what was seen of its hosts, and what data logs say of it."""

    system: System
    views: Mapping[str, HostView]
    reservations: ReservationSource
    may_move: bool  # whether partitions may leave their hosts


@dataclass(frozen=True, slots=True)
class Edit:
    """One change."""

    message: str
    apply: Callable[[Variant], Variant]


Edits = tuple[Edit, ...]
"""Changes that are made together."""


@dataclass(slots=True, kw_only=True)
class Trial:
    """Plans changed manifests, `TRIALS` of them; from then on nothing fits."""

    start: Variant
    made: list[int] = field(default_factory=lambda: [0])  # shared with trials that go on from here

    def fits(self, edits: Iterable[Edit], *, by_first_fit: bool = True) -> bool:
        """Say whether a layout with all of these changes is found, by first fit or also by the solver."""
        if self.made[0] >= TRIALS:
            return False
        self.made[0] += 1
        after = edited(self.start, edits)
        problem = problem_of(after.system, after.reservations, after.views, may_move=after.may_move)
        return has_layout(problem, by_first_fit=by_first_fit) is True

    def after(self, edits: Iterable[Edit]) -> "Trial":
        """The same, from where these changes are made."""
        return Trial(start=edited(self.start, edits), made=self.made)


def edited(variant: Variant, edits: Iterable[Edit]) -> Variant:
    """The variant with all of these changes."""
    return reduce(lambda before, edit: edit.apply(before), edits, variant)


TOGETHER = "all of these:"
"""What stands above changes that are needed together."""


def describe(edits: Sequence[Edit]) -> str:
    """One change as it is, several as a list."""
    if len(edits) == 1:
        return edits[0].message
    return "\n  - ".join([TOGETHER, *(edit.message for edit in edits)])


def component_reserves(component: Component, before: CpuAmount, amount: CpuAmount) -> Edit:
    """As in: arm reserves 20 % instead of 30 %."""

    def change(variant: Variant) -> Variant:
        there = variant.system.components[component.name]
        return with_components(variant, {there.name: replace(there, cpu=replace(there.cpu, reserve=amount))})

    return Edit(f"{component.name} reserves {show_amount(amount)} instead of {show_amount(before)}", change)


def partition_reserves(name: str, before: CpuAmount, amount: CpuAmount) -> Edit:
    """The same of a partition that fixes what it reserves, whatever its components say."""

    def change(variant: Variant) -> Variant:
        there = variant.system.partitions[name]
        after = replace(there, cpu=replace(there.cpu, reserve=amount))
        return _in_system(variant, partitions={**variant.system.partitions, name: after})

    return Edit(f"partition {name} reserves {show_amount(amount)} instead of {show_amount(before)}", change)


def relaxed_apt(component: Component, index: str, threshold: Threshold) -> Edit:
    """As in: vision: mean_response_time at most 131 ms instead of 100 ms, in the manifest's words."""
    found = find_index(index)
    assert found is not None, "an APT names indexes that there are"

    def change(variant: Variant) -> Variant:
        there = variant.system.components[component.name]
        return with_components(variant, {there.name: replace(there, apt={**there.apt, index: threshold})})

    before = show_value(found, component.apt[index].value)
    return Edit(f"{component.name}: {index} {show_threshold(found, threshold)} instead of {before}", change)


def larger_hosts(message: str, hosts: Mapping[str, Host], views: Mapping[str, HostView], *, logs_hold: bool) -> Edit:
    """Hosts as they would be, in the manifest and, where they were seen, in fact.

    Where the logs do not hold, nothing is known of what was measured on these hosts: they are not what they were.
    """

    def change(variant: Variant) -> Variant:
        source = variant.reservations
        if not logs_hold and isinstance(source, MeasuredReservations):
            source = replace(source, kinds={**source.kinds, **dict.fromkeys(hosts, NotMeasured)})
        after = _in_system(variant, hosts={**variant.system.hosts, **hosts})
        return replace(after, views={**variant.views, **views}, reservations=source)

    return Edit(message, change)


def with_components(variant: Variant, changed: Mapping[str, Component]) -> Variant:
    """The variant with these components instead of those of their names."""
    return _in_system(variant, components={**variant.system.components, **changed})


def _in_system(variant: Variant, **changed: Any) -> Variant:
    return replace(variant, system=replace(variant.system, **changed))
