"""The values of `rarms explain COMPONENT`: what a reservation rests on, and what was rejected."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from rarms_iac.app.alternatives import Elsewhere
from rarms_iac.app.explained_partition import ExplainedPartition, ExplainedPlace
from rarms_iac.app.previous_tuning import TUNE, PreviousTuning, RejectedCompound
from rarms_iac.model.commands import PLAN, RecommendedCommand
from rarms_iac.model.diagnostics import Diagnostic, has_errors
from rarms_iac.model.host import Host, SchedulerType
from rarms_iac.model.outcomes import Estimate
from rarms_iac.model.output import Internal, OpenBound, output
from rarms_iac.model.processor_number import ProcessorSource
from rarms_iac.model.quantities import LogicalProcessors
from rarms_iac.model.state import PartitionSettings
from rarms_iac.model.system import AtMost, Component, Threshold
from rarms_iac.model.totals import HostTotals
from rarms_iac.planner.reservations import depends_on_a_log
from rarms_iac.statistics.curves import Point


@dataclass(frozen=True, slots=True, kw_only=True)
class DataLogSummary:
    """The data log that a reservation rests on."""

    path: str
    first: str  # when its first setting was measured; empty: it has none
    last: str
    reserves: tuple[int, ...]  # the CRs that it has, ascending
    others: int  # settings in its file that were measured under other conditions, and do not count
    interference: str  # the load that asks for most
    other_loads: tuple[str, ...]  # that it stands up to as well
    processors: int  # of P1: a CR is per cent of these
    processors_from: ProcessorSource
    provider: str
    processor: str
    logical_processors: int
    smt: bool
    scheduler: SchedulerType
    os_build: int
    again: RecommendedCommand  # what measures it


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplainedIndex:
    """One index of the APT of one member at a reservation, as the curve of the data log has it."""

    member: str
    index: str
    threshold: Threshold
    reserve: int  # CR, per cent of P1's processors
    point: Internal[Point]  # of the curve, on which every reservation rests
    estimate: Internal[Estimate | None]  # what was measured there; None: it is looked up between two settings
    met: bool
    missed: Internal[bool]  # on the good side of the band, too; neither: it is not shown yet
    inconclusive: Internal[bool]  # it was measured there, and that gave no verdict

    @output
    def value(self) -> OpenBound:
        """As measured, in the index's unit; where nothing was, as looked up."""
        return (self.estimate or self.point).value

    @output
    def samples(self) -> int | None:
        """How many were measured there; None: none."""
        return None if self.estimate is None else self.estimate.samples

    @output
    def safe(self) -> OpenBound:
        """The side of the curve's band that a reservation rests on."""
        return self.point.upper if isinstance(self.threshold, AtMost) else self.point.lower


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """What the reservation of a component's partition rests on, and where that partition is."""

    kind: Literal["component"] = "component"
    subject: Internal[Component]
    shared: Internal[ExplainedPartition]
    place: Internal[ExplainedPlace]
    totals: Internal[HostTotals | None] = None  # of its host in the layout; None: there is no layout
    wanted_lp: LogicalProcessors | None  # before rounding to the provider's grain; None: nothing says how much
    fixed_partition: str = ""  # the partition whose reserve the manifest fixes; empty: it fixes none
    fixed_members: tuple[str, ...] = ()  # the members whose reserves the manifest fixes, where no log counts
    data_log: DataLogSummary | None = None  # that holds; beside a fixed reserve, which does not rest on it, too
    least: int | None = None  # CR, of P1's virtual processors, by that log; None: no setting in it is enough
    verdicts: tuple[ExplainedIndex, ...] = ()  # at the least reserve, or at the highest that was measured
    one_less: tuple[ExplainedIndex, ...] = ()  # at one per cent less than the least
    inconclusive: tuple[int, ...] = ()  # CRs that were measured and gave no verdict, ascending
    overloaded: tuple[int, ...] = ()  # CRs at which it falls behind its jobs, ascending
    remarks: tuple[str, ...] = ()
    previous: Internal[PreviousTuning]  # of its platform
    compounds: tuple[RejectedCompound, ...] = ()
    elsewhere: tuple[Elsewhere, ...] = ()

    @property
    def is_fixed(self) -> bool:
        """Whether the manifest fixes the reserve."""
        return bool(self.fixed_partition or self.fixed_members)

    @property
    def measured(self) -> DataLogSummary | None:
        """The data log that the reservation rests on."""
        return None if self.is_fixed else self.data_log

    @output
    def component(self) -> str:
        """The name that the manifest has for it."""
        return self.subject.name

    @output
    def criticality(self) -> int:
        """As the manifest has it."""
        return self.subject.criticality

    @output
    def partition(self) -> str:
        """The name of its partition."""
        return self.place.partition.name

    @output
    def host(self) -> str:
        """Where it runs; without a layout the first by name that could have it."""
        return self.place.host.name

    @output
    def fits(self) -> bool:
        """Whether there is a layout."""
        return self.shared.layout is not None

    @output
    def reserved_lp(self) -> LogicalProcessors | None:
        """What its partition is guaranteed; None: it is not known."""
        return None if self.place.no_host_because else self.place.partition.reserved

    @output
    def settings(self) -> PartitionSettings | None:
        """What its partition gets; None: how much it reserves is not known."""
        return None if self.place.no_host_because else self.place.partition.settings

    @output
    def errors(self) -> tuple[Diagnostic, ...]:
        """Why nothing can be said of how much it needs."""
        findings = self.shared.planning.findings if self.place.no_host_because else ()
        return tuple(finding for finding in findings if has_errors([finding]))

    @output
    def commands(self) -> tuple[RecommendedCommand, ...]:
        """What measures whether sharing saves something."""
        untried = depends_on_a_log(self.shared.group) and not self.compounds and not self.previous.runs
        return (TUNE,) if untried else ()


@dataclass(frozen=True, slots=True, kw_only=True)
class HostExplanation:
    """A component that runs on the host itself, and where it may: it has no reservation to explain."""

    kind: Literal["component_on_host"] = "component_on_host"
    subject: Internal[Component]
    places: Internal[tuple[Host, ...]]  # that it may run on, by name

    @output
    def component(self) -> str:
        """The name that the manifest has for it."""
        return self.subject.name

    @output
    def criticality(self) -> int:
        """As the manifest has it."""
        return self.subject.criticality

    @output
    def hosts(self) -> tuple[str, ...]:
        """Where it is started, by name."""
        return tuple(host.name for host in self.places)

    @output
    def task(self) -> str | None:
        """Its robotic task class; None: it has none."""
        return self.subject.task

    @output
    def commands(self) -> tuple[RecommendedCommand, ...]:
        """What shows the values of its task class."""
        return (PLAN,) if self.subject.task else ()


ComponentExplanation: TypeAlias = Explanation | HostExplanation
