"""A report as plain values: the curves that the planner looks up, and what each threshold would reserve.

Nothing is computed from samples here. Rows come from the curve that the planner asks, so page,
terminal, spreadsheet and planner cannot differ.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Literal

from rarms_iac.app.drift import ComparedHost
from rarms_iac.model.commands import APPLY, PLAN, RecommendedCommand
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.indexes import PerformanceIndex, index_named
from rarms_iac.model.outcomes import Achievement, ReservationVerdict, VerdictWord
from rarms_iac.model.output import Internal, OpenBound, output
from rarms_iac.model.quantities import guaranteed
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import Threshold
from rarms_iac.planner.combining.candidates import Node
from rarms_iac.statistics.curves import Curve, least_reserve
from rarms_iac.storage.datalog.decisions import Proven, ProvenIndex, TuningRun


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveRow:
    """The curve at one whole per cent."""

    reserve: int  # CR, per cent of the partition's own processors
    value: OpenBound  # in the index's unit
    low: OpenBound  # the band
    high: OpenBound
    safe: OpenBound  # the side of the band that decides a reservation


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredPoint:
    """The result of one setting for an index."""

    reserve: int
    samples: int
    failed: int
    value: float | None = None  # None: the samples say nothing of it
    low: OpenBound = 0.0
    high: OpenBound = 0.0
    effective: float = 0.0  # samples that count as independent
    verdict: VerdictWord | None = None  # None: no threshold
    error: float | None = None  # how probably the verdict is wrong
    remark: str = ""
    response_ms: Internal[tuple[float, ...]] = ()  # of each job that was successful


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexCurve:
    """An index of a component against the reserve."""

    component: str
    index: PerformanceIndex
    threshold: Threshold | None  # the APT
    curve: Internal[Curve]
    points: tuple[MeasuredPoint, ...]  # by reserve, then as they were measured

    @output
    def unit(self) -> str:
        """Of threshold, points and curve."""
        return self.index.symbol

    @output
    def rows(self) -> tuple[CurveRow, ...]:
        """The curve at every whole per cent where there is one, as everybody looks it up."""
        points = ((reserve, self.curve.value_at(reserve)) for reserve in range(1, 101))
        return tuple(
            CurveRow(
                reserve=reserve,
                value=point.value,
                low=point.lower,
                high=point.upper,
                safe=point.upper if self.index.smaller_is_better else point.lower,
            )
            for reserve, point in points
            if point is not None
        )

    @output
    def least(self) -> int | None:
        """What the APT alone asks for; None: no APT, or none that was measured meets it."""
        return None if self.threshold is None else self.least_for(self.threshold)

    def least_for(self, threshold: Threshold) -> int | None:
        """Return the least CR that meets a threshold; None: none that was measured does."""
        return least_reserve([(self.curve, threshold)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """A data log: the components of one test partition, measured against one interfering load."""

    components: tuple[str, ...]
    partition: str = ""  # of the manifest that has just these; empty: none has
    platform: str
    interference: str
    log: str  # path of the data log, below the manifest's folder
    processors: int  # VPs of the partition
    criticality: int  # the highest of its members'
    decides: bool  # its load asks for most, so that the verdict is of it; otherwise it is there to compare
    verdict: ReservationVerdict = ReservationVerdict(thresholds=())  # on its components there, with all of their loads
    fixed: tuple[str, ...] = ()  # its components, if the manifest says what they reserve
    floor: int = 0  # per cent that the manifest fixes for some of several members: the least that they get
    stale: tuple[str, ...] = ()  # what changed since; a stale log is not used
    indexes: tuple[IndexCurve, ...] = ()
    settings: Internal[tuple[Setting, ...]] = ()  # with every sample, in the order in which they were measured
    facts: Internal[tuple[tuple[str, str], ...]] = ()  # where it comes from, for people: name, value

    @property
    def name(self) -> str:
        """As the data log's folder is called: `path-planning+video-streaming`."""
        return "+".join(self.components)

    @property
    def is_aside(self) -> bool:
        """Whether no reservation follows from it: it is stale, or the verdict is of another load."""
        return bool(self.stale or self.verdict.thresholds) and not self.decides

    @output
    def reserve(self) -> int | None:
        """What the partition gets by the verdict, or what the manifest fixes where it is more; None: not known."""
        least = self.verdict.reserve if self.decides else None
        return None if least is None else max(least, self.floor)

    @output
    def reserved_lp(self) -> Fraction | None:
        """What the partition is guaranteed, in LPs."""
        return None if self.reserve is None else guaranteed(self.reserve, self.processors)


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentVerdict:
    """The verdict on a component on a platform: how its worst threshold stands."""

    component: str
    members: Internal[tuple[str, ...]]  # of its partition, by name
    platform: str
    achievement: Achievement
    indexes: tuple[str, ...] = ()  # that stand so
    not_measured: tuple[str, ...] = ()  # loads that are left, where some are measured


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedReservation:
    """A reserve that the manifest itself says."""

    name: str  # of the partition
    components: tuple[str, ...]
    reserved_lp: Fraction
    thresholds: Internal[tuple[tuple[str, str, Threshold], ...]] = ()  # component, performance index, its threshold


@dataclass(frozen=True, slots=True, kw_only=True)
class PlatformCapacity:
    """The capacity of a platform's hosts, and the sum of all reservations."""

    platform: str
    hosts: tuple[str, ...]
    processors: int
    capacity_lp: Fraction  # without what is kept for the hosts and what machines of others reserve
    fixed: tuple[FixedReservation, ...]  # promised by the manifest itself
    reserved_lp: Fraction  # for all partitions that are placed there
    unmanaged_lp: Fraction  # by machines of others
    partitions: Internal[tuple[str, ...]]  # the names of those
    unknown: tuple[ComponentVerdict, ...] = ()  # components that are not in that sum: their reservation is not known

    @property
    def kept_lp(self) -> Fraction:
        """LPs that are kept for the hosts."""
        return self.processors - self.capacity_lp - self.unmanaged_lp

    @property
    def unpromised_lp(self) -> Fraction:
        """LPs that are not promised yet, at most so much where some is unknown; below nothing where it does not fit."""
        return self.capacity_lp - self.reserved_lp

    @output
    def headroom_lp(self) -> Fraction | None:
        """LPs that are not promised; below nothing where it does not fit. None: not all reservations are known."""
        return None if self.unknown else self.unpromised_lp

    @output
    def fits(self) -> bool | None:
        """Whether the hosts can promise it; None: that is not known yet."""
        return None if self.unknown and self.unpromised_lp >= 0 else self.unpromised_lp >= 0


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentProof:
    """The proof of a component's index in the applied layout."""

    entry: Proven
    proven: ProvenIndex  # one of the entry's
    outdated: tuple[str, ...] = ()  # what is no longer as it was when this was proven

    @property
    def index(self) -> PerformanceIndex:
        """The performance index."""
        return index_named(self.proven.index)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlatformTuning:
    """The last run of `rarms tune` on a platform."""

    platform: str
    run: TuningRun
    outdated: Internal[Mapping[tuple[str, ...], str]] = field(
        default_factory=dict
    )  # why what it measured of components together (by sorted names) does not hold any more


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """Everything that `rarms report` shows."""

    kind: Literal["report"] = "report"
    application: str
    description: str
    measurements: tuple[Measurement, ...]  # by platform, criticality (falling), name; the load that decides first
    capacities: tuple[PlatformCapacity, ...]  # by platform
    verdicts: tuple[ComponentVerdict, ...] = ()  # on each component whose reserve is to be measured, by platform
    proofs: tuple[ComponentProof, ...] = ()
    hosts: tuple[ComparedHost, ...] = ()  # those that could be looked at without waiting, by name
    is_planned: bool = True  # else the manifest has no layout that could be applied to them
    findings: tuple[Diagnostic, ...] = ()  # of the manifest, and why it has no layout, where hosts were looked at
    tunings: tuple[PlatformTuning, ...] = ()  # by platform
    candidates: Internal[tuple[Node, ...]] = ()  # the graph; empty: nothing can be combined, or not all is measured

    @output
    def commands(self) -> tuple[RecommendedCommand, ...]:
        """What shows why there is no layout; or what shows what is to be done on the hosts, and then what does it."""
        differs = any(host.to_apply for host in self.hosts)
        return (PLAN,) if not self.is_planned else (PLAN, APPLY) if differs else ()
