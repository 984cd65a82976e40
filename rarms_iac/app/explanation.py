"""The values behind `rarms explain COMPONENT`: all that leads from the APT to the per cent of its partition."""

from dataclasses import dataclass
from typing import Literal

from rarms_iac.model.commands import Prose, RecommendedCommand, Wording
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import Host, SchedulerType
from rarms_iac.model.layout import PlacedPartition, Placement
from rarms_iac.model.quantities import LogicalProcessors
from rarms_iac.model.system import Component, Threshold
from rarms_iac.model.totals import HostTotals
from rarms_iac.planner.alternatives import Elsewhere
from rarms_iac.planner.groups import Group
from rarms_iac.statistics.curves import Curve, LeastReserve


@dataclass(frozen=True, slots=True, kw_only=True)
class DataLogSummary:
    """The data log that a reservation rests on."""

    path: str
    first: str  # when its first setting was measured; empty: it has none
    last: str
    reserves: tuple[int, ...]  # the CRs that it has, ascending
    interference: str
    processors: int  # of P1: a CR is per cent of these
    provider: str
    processor: str
    logical_processors: int
    smt: bool
    scheduler: SchedulerType
    os_build: int
    again: RecommendedCommand  # what measures it


@dataclass(frozen=True, slots=True, kw_only=True)
class MemberCurve:
    """One index of the APT of one member, with its curve."""

    member: str
    index: str
    threshold: Threshold
    curve: Curve


@dataclass(frozen=True, slots=True, kw_only=True)
class HostPromises:
    """What the partition's host has promised in the layout."""

    totals: HostTotals
    beside: tuple[tuple[str, LogicalProcessors], ...]  # other partitions there, by name
    placement: Placement | None = None  # how good the choice of hosts is, where there was one


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """All that leads from a component's APT to what its partition gets, or why it cannot be told what it gets."""

    component: Component
    group: Group
    host: Host
    placed: PlacedPartition  # without a reserve, where that cannot be told
    no_host_because: str  # why no host can have it, even alone; empty: one can
    wanted: LogicalProcessors | None  # before rounding; None: nothing says how much
    fixed_by: str  # who fixes the reserve in the manifest; empty: it rests on the data log, or there is none
    measured: DataLogSummary | None
    curves: tuple[MemberCurve, ...]
    least: LeastReserve | None
    beside_fixed: DataLogSummary | None  # measured, though the manifest fixes the reserve
    least_beside_fixed: LeastReserve | None  # by that log; None: no setting in it is enough
    remarks: tuple[str, ...]
    why_together: tuple[str, ...]
    apart: str  # what its members would need in partitions of their own; empty: it cannot be told, or is alone
    shared: tuple[str, ...]  # compounds that were measured and not taken, or why there are none
    partners: tuple[Wording, ...]  # with whom it would probably save something; predicted
    on_host: HostPromises | None  # None: there is no layout
    current_host: str  # that it runs already, and what that means; empty: it does not, as far as was seen
    not_observed: tuple[str, ...]  # hosts that could not be looked at
    elsewhere: tuple[Elsewhere, ...]
    infeasibility: tuple[str, ...]  # why there is no layout; empty: there is one


@dataclass(frozen=True, slots=True, kw_only=True)
class HostExplanation:
    """The same for a component that runs on the host itself: there is little to lead anywhere."""

    component: Component
    hosts: tuple[Host, ...]  # that it may run on, by name


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplanationStep:
    """A step of an explanation: what it is about, and its sentences."""

    topic: str
    sentences: tuple[Prose, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentExplanation:
    """How a component comes to what it gets; one that runs on the host itself has steps only."""

    kind: Literal["walk"] = "walk"
    component: str
    criticality: int
    partition: str | None = None
    host: str | None = None  # where it runs; without a layout the first by name that could have it
    fits: bool = True  # false: there is no layout
    data_log: str | None = None
    least: LeastReserve | None = None  # CR, of P1's virtual processors; None: nothing was looked up
    wanted_lp: LogicalProcessors | None = None  # before rounding to the provider's grain; None: nothing says how much
    reserved_lp: LogicalProcessors | None = None  # after it
    reserve: int | None = None  # whole per cent of each virtual processor
    processors: int | None = None
    limit: int | None = None
    weight: int | None = None
    steps: tuple[ExplanationStep, ...]
    errors: tuple[Diagnostic, ...] = ()  # why nothing can be said of how much it needs
