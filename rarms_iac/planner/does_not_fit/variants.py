"""A manifest with something changed: what is changed, how a person is told, and whether it fits then."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import reduce

from rarms_iac.model.indexes import find_index, show_threshold, show_value
from rarms_iac.model.quantities import CpuAmount, LogicalProcessors, Percent, ProcessorTime, ShareOfHost, show_amount
from rarms_iac.model.system import Component, Host, Measured, System, Threshold
from rarms_iac.planner.problem import HostView
from rarms_iac.planner.reservations import MeasuredReservations, NotMeasured, ReservationSource

Apt = tuple[str, str]
"""Component and index."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """A manifest, what was seen of its hosts, and what data logs say of it."""

    system: System
    views: Mapping[str, HostView]
    reservations: ReservationSource
    may_move: bool  # whether partitions may leave their hosts


Works = Callable[[Variant], bool]
"""Whether everything fits."""


@dataclass(frozen=True, slots=True)
class Edit:
    """One change of a manifest, as a person would make it."""

    says: str
    of: Callable[[Variant], Variant]


Edits = tuple[Edit, ...]
"""Changes that are made together."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """What is varied, and how a variation is tried."""

    start: Variant
    works: Works  # plans it
    may_work: Works  # a short search of whether there is room

    def fits(self, edits: Iterable[Edit]) -> bool:
        """Whether everything seems to fit with all of these."""
        return self.may_work(edited(self.start, edits))

    def is_planned(self, edits: Iterable[Edit]) -> bool:
        """Whether a plan of it has a layout: asked of what is told."""
        return self.works(edited(self.start, edits))

    def after(self, edits: Iterable[Edit]) -> "Trial":
        """The same, from where these are made."""
        return replace(self, start=edited(self.start, edits))


@dataclass(slots=True)
class Counted:
    """The same answers, until so many were given: from then on nothing fits. A count, so equal inputs end alike."""

    works: Works
    left: int

    def __call__(self, variant: Variant) -> bool:
        """As `Works` says."""
        self.left -= 1
        return self.left >= 0 and self.works(variant)


def edited(variant: Variant, edits: Iterable[Edit]) -> Variant:
    """With all of these changes."""
    return reduce(lambda one, edit: edit.of(one), edits, variant)


def told(edits: Sequence[Edit]) -> str:
    """One change as it is, several as a list."""
    if len(edits) == 1:
        return edits[0].says
    return "\n  - ".join(["all of these:", *(one.says for one in edits)])


def component_reserves(component: Component, amount: CpuAmount) -> Edit:
    """`arm reserves 20 % instead of 30 %`."""

    def of(variant: Variant) -> Variant:
        before = variant.system.components[component.name]
        after = replace(before, cpu=replace(before.cpu, reserve=amount))
        return _with(variant, replace(variant.system, components={**variant.system.components, after.name: after}))

    return Edit(f"{component.name} reserves {_instead(amount, component.cpu.reserve)}", of)


def partition_reserves(name: str, before: CpuAmount, amount: CpuAmount) -> Edit:
    """The same of a partition that fixes what it reserves, whatever its components say."""

    def of(variant: Variant) -> Variant:
        wish = variant.system.partitions[name]
        after = replace(wish, cpu=replace(wish.cpu, reserve=amount))
        return _with(variant, replace(variant.system, partitions={**variant.system.partitions, name: after}))

    return Edit(f"partition {name} reserves {_instead(amount, before)}", of)


def _instead(amount: CpuAmount, before: CpuAmount | Measured | None) -> str:
    assert isinstance(before, CpuAmount), "only what is fixed is lowered"
    return f"{show_amount(amount)} instead of {show_amount(before)}"


def relaxed(system: System, apt: Apt, threshold: Threshold) -> Edit:
    """`vision: mean_response_time at most 131 ms instead of 100 ms`, in the manifest's words."""
    name, index = apt
    found = find_index(index)
    assert found is not None, "an APT names indexes that there are"
    before = show_value(found, system.components[name].apt[index].value)

    def of(variant: Variant) -> Variant:
        component = variant.system.components[name]
        after = replace(component, apt={**component.apt, index: threshold})
        return _with(variant, replace(variant.system, components={**variant.system.components, name: after}))

    return Edit(f"{name}: {index} {show_threshold(found, threshold)} instead of {before}", of)


def hosts_become(hosts: Mapping[str, Host], views: Mapping[str, HostView], says: str) -> Edit:
    """Hosts that are other than they were, in the manifest and, where they were seen, in fact."""

    def of(variant: Variant) -> Variant:
        system = replace(variant.system, hosts={**variant.system.hosts, **hosts})
        return replace(variant, system=system, views={**variant.views, **views})

    return Edit(says, of)


def processors_given(names: Iterable[str], processors: int) -> Callable[[Variant], Variant]:
    """These components want so many virtual processors, however many their host has."""

    def of(variant: Variant) -> Variant:
        changed = {name: replace(variant.system.components[name], processors=processors) for name in names}
        return _with(variant, replace(variant.system, components={**variant.system.components, **changed}))

    return of


def without_logs(variant: Variant, hosts: Iterable[str]) -> Variant:
    """What was measured on these hosts holds no longer: they are not what they were."""
    source = variant.reservations
    if not isinstance(source, MeasuredReservations):
        return variant
    kinds = {**source.kinds, **dict.fromkeys(hosts, NotMeasured)}
    return replace(variant, reservations=replace(source, kinds=kinds))


def amount_like(before: CpuAmount, steps: int) -> CpuAmount:
    """So many steps of an amount that is written like this one: whole per cent, or hundredths of an LP."""
    if isinstance(before, ShareOfHost):
        return ShareOfHost(Percent(Fraction(steps)))
    return ProcessorTime(LogicalProcessors(Fraction(steps, 100)))


def _with(variant: Variant, system: System) -> Variant:
    return replace(variant, system=system)


def flat(chosen: Sequence[Edits]) -> Edits:
    """All changes of these as one."""
    return tuple(edit for edits in chosen for edit in edits)
