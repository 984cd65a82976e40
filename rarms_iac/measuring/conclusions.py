"""How the measuring of an experiment ended: the strategies say it, the command line tells it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from rarms_iac.model.measurement import Series


def to_its_end(_seen: Mapping[str, Series]) -> bool:
    """Every sample that `run.until` asks for is taken."""
    return False


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """Not ended: run the setting with this CR."""

    reserve: int
    settled: Callable[[Mapping[str, Series]], bool] = field(default=to_its_end, compare=False)
    """Whether the samples so far, by component, may end it; asked now and then."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sufficient:
    """Every APT is met at this CR, which was measured."""

    reserve: int
    failed: int | None  # the highest lower CR at which one was not met; None: there is none, or nobody looked
    error: float  # of the verdicts that this rests on
    untold: tuple[int, ...] = ()  # lower CRs above that one that were measured and say neither: no steady state


@dataclass(frozen=True, slots=True, kw_only=True)
class NotAchievable:
    """Not every APT is met at the highest CR that the host can give."""

    reserve: int  # that CR
    error: float


@dataclass(frozen=True, slots=True, kw_only=True)
class NotResolved:
    """The samples allowed cannot tell."""

    says: str


@dataclass(frozen=True, slots=True, kw_only=True)
class NoVerdict:
    """More samples of a component failed than it may have: the setting can say nothing, and was not recorded."""

    reserve: int
    component: str
    failures: tuple[str, ...]  # why each failed, in order


@dataclass(frozen=True, slots=True, kw_only=True)
class Swept:
    """All the settings that were asked for are there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stopped:
    """Somebody asked for an end; what is recorded stays, and the same command goes on."""


Conclusion = Sufficient | NotAchievable | NotResolved | NoVerdict | Swept | Stopped
Step = Measure | Conclusion
