"""The values of `rarms explain COMPONENT`: what a reservation rests on, and the steps from the APT to it."""

from dataclasses import dataclass
from typing import Literal

from rarms_iac.app.explained_partition import ExplainedPartition, ExplainedPlace
from rarms_iac.model.commands import Prose, RecommendedCommand
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import Host, SchedulerType
from rarms_iac.model.output import Internal
from rarms_iac.model.quantities import LogicalProcessors
from rarms_iac.model.system import Component, Threshold
from rarms_iac.statistics.curves import Curve


@dataclass(frozen=True, slots=True, kw_only=True)
class DataLogSummary:
    """The data log that a reservation rests on."""

    path: str
    first: str  # when its first setting was measured; empty: it has none
    last: str
    reserves: tuple[int, ...]  # the CRs that it has, ascending
    interference: str  # the load that asks for most
    other_loads: tuple[str, ...]  # that it stands up to as well
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
class Explanation:
    """What the reservation of a component's partition rests on, and where that partition is."""

    component: Component
    partition: ExplainedPartition
    place: ExplainedPlace
    wanted: LogicalProcessors | None  # before rounding; None: nothing says how much
    fixed_by: str  # who fixes the reserve in the manifest; empty: it rests on the data log, or there is none
    log: DataLogSummary | None  # that holds; beside a fixed reserve, which does not rest on it, too
    least: int | None  # by that log; None: no setting in it is enough
    curves: tuple[MemberCurve, ...] = ()  # that the reservation rests on
    remarks: tuple[str, ...] = ()

    @property
    def measured(self) -> DataLogSummary | None:
        """The data log that the reservation rests on."""
        return None if self.fixed_by else self.log


@dataclass(frozen=True, slots=True, kw_only=True)
class HostExplanation:
    """A component that runs on the host itself, and where it may: it has no reservation to explain."""

    component: Component
    hosts: tuple[Host, ...]  # that it may run on, by name


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplanationStep:
    """A step of an explanation: what it is about, and its sentences."""

    topic: str
    sentences: tuple[Prose, ...]
    repeats_findings: Internal[bool] = False  # says nothing but why there is no layout


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
    least: int | None = None  # CR, of P1's virtual processors; None: nothing was looked up
    wanted_lp: LogicalProcessors | None = None  # before rounding to the provider's grain; None: nothing says how much
    reserved_lp: LogicalProcessors | None = None  # after it
    reserve: int | None = None  # whole per cent of each virtual processor
    processors: int | None = None
    limit: int | None = None
    weight: int | None = None
    steps: tuple[ExplanationStep, ...]
    errors: tuple[Diagnostic, ...] = ()  # why nothing can be said of how much it needs
