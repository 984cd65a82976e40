"""What the planner answers: a Layout, or why there is none."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from fractions import Fraction
from typing import Literal

from rarms_iac.model.claims import ANY_THREAD, Claim, CoreSharing
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.outcomes import UncertainEstimate
from rarms_iac.model.output import Internal, output
from rarms_iac.model.quantities import LogicalProcessors, guaranteed
from rarms_iac.model.state import PartitionSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class Making:
    """The settings that only the creation of a machine needs; empty: the host's default, or none."""

    image: str = ""  # parent disk of a differencing child
    switch: str = ""
    vm_path: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedPartition:
    """A partition with its members, its host and what it gets there, in the provider's grain."""

    host: str
    components: tuple[str, ...]  # most critical first, ties by name
    criticality: int  # the highest of its members'
    settings: PartitionSettings  # running where it starts by itself; secure boot only where the manifest fixes it
    making: Making = Making()
    why_limit: str = ""
    why_weight: str = ""
    sharing: CoreSharing = ANY_THREAD
    mechanism: str = ""  # on Linux, how its reservation is kept and why, for a person

    @property
    def name(self) -> str:
        """The partition's name in the manifest."""
        return self.settings.name

    @property
    def claim(self) -> Claim:
        """What it claims of its host while it runs."""
        return self.sharing.claim(self.settings.processors, self.settings.reserve, self.settings.memory)

    @property
    def reserved(self) -> LogicalProcessors:
        """The LPs that it is guaranteed, after rounding to the provider's grain."""
        return guaranteed(self.settings.reserve, self.settings.processors)


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """The quality of the choice of hosts, where there was one."""

    reserved: Internal[int]  # in all, in per cent of one logical processor
    reserved_bound: Internal[int]  # no layout reserves less
    moves: int
    moves_bound: int  # no layout that reserves at most as much moves fewer

    @property
    def proven(self) -> bool:
        """Whether no layout is better."""
        return (self.reserved, self.moves) == (self.reserved_bound, self.moves_bound)

    @output
    def reserved_lp(self) -> Fraction:
        """LPs that are reserved in all."""
        return Fraction(self.reserved, 100)

    @output
    def reserved_bound_lp(self) -> Fraction:
        """LPs that each layout reserves at least."""
        return Fraction(self.reserved_bound, 100)

    @output
    def verdict(self) -> Literal["optimal", "within the bound"]:
        """What may be said of it."""
        return "optimal" if self.proven else "within the bound"


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenLayout:
    """The hosts that the solver chose, with its word on how good the choice is."""

    hosts: Mapping[str, str]  # by partition
    reserved_bound: int  # as of `Placement`
    moves_bound: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Every component in a partition on a host, or on a host itself."""

    partitions: tuple[PlacedPartition, ...]  # by host, then name
    on_hosts: tuple[tuple[str, str], ...]  # component, host: those that run outside partitions
    placement: Placement | None = None  # None where there was nothing to choose

    def chosen(self) -> ChosenLayout:
        """Return the part that was chosen."""
        placement = self.placement
        return ChosenLayout(
            hosts={partition.name: partition.host for partition in self.partitions},
            reserved_bound=placement.reserved_bound if placement else 0,
            moves_bound=placement.moves_bound if placement else 0,
        )

    def on(self, host: str) -> tuple[PlacedPartition, ...]:
        """Return the partitions of a host, by name."""
        return tuple(partition for partition in self.partitions if partition.host == host)


@dataclass(frozen=True, slots=True, kw_only=True)
class LookedUp:
    """The need of components in one partition on a host."""

    reservation: LogicalProcessors
    processors: int | None = None  # virtual ones, with which they were measured together; None: not measured
    provisional: bool = False  # by the estimates of the first pass, and inconclusive
    uncertain: tuple[UncertainEstimate, ...] = ()  # of a provisional one, those that are the least certain
    remarks: tuple[Diagnostic, ...] = ()  # that a log could not be verified, or is of a busy host; without a place
    # By member: processor time of a job, in ms, on each of the processors that it uses; absent: not measured.
    job_ms: Mapping[str, float] = field(default_factory=dict)
    governors: tuple[str, ...] = ()  # of `MachineSpeed`, those that it was measured with; empty: not known
    memory_peak: int = 0  # bytes, the most that the members had at once while they were measured; 0: not known


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedAnswer:
    """The answer of data logs for components in one partition, on hosts for which the same logs hold."""

    members: tuple[str, ...]  # by name
    hosts: tuple[str, ...]  # by name
    answer: LookedUp


class RelaxationKind(Enum):
    """The certainty of a relaxation, or the assumption that it depends on."""

    CERTAIN = "certain"
    LOWER_SETTINGS = "lower_settings"  # less is enough for components of which no lower setting was measured
    FEWER_PROCESSORS = "fewer_processors"  # components need no more in each that stays
    COMBINING = "combining"  # components need together the least that they could
    MORE_PROCESSORS = "more_processors"  # what was measured holds on a larger host


@dataclass(frozen=True, slots=True, kw_only=True)
class RelaxedLevel:
    """An APT that would be easier to meet."""

    component: str
    index: str
    level: str  # as the manifest has it: 131 ms


@dataclass(frozen=True, slots=True, kw_only=True)
class Relaxation:
    """Changes of the manifest with which it would fit; they were tried. An uncertain one has to be measured."""

    changes: tuple[str, ...]  # needed together
    levels: tuple[RelaxedLevel, ...] = ()  # of the changes, those of an APT
    kind: RelaxationKind = RelaxationKind.CERTAIN
    hosts: tuple[str, ...] = ()  # where it has to be measured, each for itself, if the hosts differ in platform


@dataclass(frozen=True, slots=True, kw_only=True)
class Infeasible:
    """No layout exists, or none was found: causes and ways out."""

    proven: bool
    causes: tuple[Diagnostic, ...]  # without a place; without advice: the relaxations are it
    relaxations: tuple[Relaxation, ...]
    unfinished: tuple[str, ...] = ()  # parts of the search for relaxations that ended at its limit, as nouns
    node_limit: int = 0  # solver nodes of that search; 0: it was not run
