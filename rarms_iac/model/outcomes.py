"""The outcomes of measuring: an estimate, the verdict on one setting, the next step and the end of an experiment.

One vocabulary for all rooms: statistics gives estimates and verdicts, a strategy gives steps, the loop ends with a
conclusion, and views and program output show all of them. What all data logs of components say of a threshold is an
`Achievement`; `planner/verdicts.py` makes it.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal, assert_never, cast

from rarms_iac.model.output import Internal, OpenBound, OutputText, output
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.system import Threshold

WIDTH = 3
"""A passing setting is shown to be least by a failing one at most so many points below it."""


class Doubt(StrEnum):
    """Why the few samples of the first pass hardly show an index."""

    EXTREME = "extreme"  # more jobs have a longer maximum and a shorter minimum
    SHARE = "share"  # a share of few jobs has large steps
    TAIL = "tail"  # a percentile beyond the samples, from a fitted tail


@dataclass(frozen=True, slots=True, kw_only=True)
class UncertainEstimate:
    """An estimate of the first pass that more samples may change most."""

    component: str
    index: str
    doubt: Doubt


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A performance index of one series: what was seen, and the bounds between which the truth lies.

    Values are in the index's own unit, as in an APT: ms, per cent, or a second.
    """

    value: float
    lower: (
        OpenBound  # the truth is rarely below, by the error that was asked for; -inf: samples say nothing of this side
    )
    upper: OpenBound  # likewise above; inf: likewise
    samples: int  # those that the value is made of
    effective_samples: float  # how many independent samples they are worth; at most `samples`
    beyond: float | None = None  # of an extreme: the share of jobs, in per cent, that may yet lie beyond it


@dataclass(frozen=True, slots=True, kw_only=True)
class Overload:
    """A periodic component falls behind its jobs: the queue grows, and with it every response time, without an end."""

    period_ms: float
    between_ms: float  # from the end of one job to the end of the next, on average: more than the period
    job_cpu_ms: float | None  # processor time of a job; None: unknown

    @output
    def needed_lp(self) -> float | None:
        """LPs that the jobs need which are due: processor time of a job by the period."""
        return None if self.job_cpu_ms is None else self.job_cpu_ms / self.period_ms

    @output
    def received_lp(self) -> float | None:
        """LPs that the component was seen to get."""
        return None if self.job_cpu_ms is None else self.job_cpu_ms / self.between_ms


@dataclass(frozen=True, slots=True, kw_only=True)
class NoEstimate:
    """The samples say nothing about the index."""

    reason: str
    overload: Overload | None = None  # where that is the reason


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedIndex:
    """One index of an APT with its estimate."""

    index: str
    threshold: Threshold
    estimate: Estimate


@dataclass(frozen=True, slots=True, kw_only=True)
class RareSlowJobs:
    """A threshold is met if no job slower than any that was seen occurs more often than once in so many jobs."""

    kind: Literal["slow_jobs"] = "slow_jobs"
    component: str
    index: str
    slower_than_ms: float
    once_in: int  # jobs


@dataclass(frozen=True, slots=True, kw_only=True)
class RareRuns:
    """A threshold is met if no run of so many bad jobs occurs more often than once in so many jobs."""

    kind: Literal["runs"] = "runs"
    component: str
    index: str
    jobs: int  # of a run
    once_in: int  # jobs


Condition = RareSlowJobs | RareRuns
"""On which a threshold is met: what its samples had no room for."""


class _Judgement(OutputText):
    """Base of the verdicts: their text is `verdict_word`."""

    __slots__ = ()

    def __str__(self) -> str:
        return verdict_word(cast("Verdict", self))


@dataclass(frozen=True, slots=True, kw_only=True)
class Met(_Judgement):
    """Every index meets its threshold; of a maximum: so far (`Estimate.beyond`)."""

    judged: tuple[JudgedIndex, ...]
    warm_up: int  # samples that were left out


@dataclass(frozen=True, slots=True, kw_only=True)
class Missed(_Judgement):
    """At least one index misses its threshold."""

    judged: tuple[JudgedIndex, ...]  # none where an overload decides
    warm_up: int
    overload: Overload | None = None  # the reason, where an index misses by arithmetic


@dataclass(frozen=True, slots=True, kw_only=True)
class WithinNoise(_Judgement):
    """The samples cannot tell; the truth lies within the estimates' bounds."""

    judged: tuple[JudgedIndex, ...]
    warm_up: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Unsteady(_Judgement):
    """The series has no steady state, so it says nothing about the next hour."""

    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class TooFewSamples(_Judgement):
    """There is nothing to estimate an index from."""

    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class TooManyFailures(_Judgement):
    """More samples of a component failed than `run.failures` allows: there is no verdict, and nothing is recorded."""

    component: str
    failures: tuple[str, ...]  # why each sample failed, in order
    allowed: int
    out_of_memory: int = 0  # so many of its processes the kernel killed, because its group had no memory left


Verdict = Met | Missed | WithinNoise | Unsteady | TooFewSamples | TooManyFailures
"""On the APT of one component at one setting."""

VerdictWord = Literal["met", "missed", "inconclusive", "no steady state", "too few samples", "too many failed samples"]


def verdict_word(verdict: Verdict) -> VerdictWord:
    """Return the name of a verdict, in tables, in JSON and in the configuration logs."""
    match verdict:
        case Met():
            return "met"
        case Missed():
            return "missed"
        case WithinNoise():
            return "inconclusive"
        case Unsteady():
            return "no steady state"
        case TooFewSamples():
            return "too few samples"
        case TooManyFailures():
            return "too many failed samples"
        case _:
            assert_never(verdict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """The experiment goes on: run the setting with this CR."""

    reserve: ReservePercent
    until_clear: bool = False  # it goes on until the verdicts are clear; otherwise as `run.until` says
    within_until: bool = False  # with `until_clear`: it ends at `run.until` all the same
    precision: float | None = None  # with `until_clear`: not before the mean is known within this part of it
    unconditional: bool = False  # with `until_clear`: until its verdicts have no `Condition`, if they may be rid of it
    first_pass: bool = False  # only until its estimates tell on which side of the thresholds they probably lie
    until_known: bool = False  # with `until_clear`: it ends, too, once it shows closely enough where the answer lies


@dataclass(frozen=True, slots=True, kw_only=True)
class Sufficient:
    """Every APT is met at this CR, which was measured."""

    reserve: ReservePercent
    failed: int | None  # the highest lower CR at which one was not met; None: there is none, or it was not measured
    inconclusive: tuple[int, ...] = ()  # lower CRs above `failed` that were measured and have no steady state
    more_settings: int = 0  # the search ended before its end: so many settings more, at most, may find a lower CR
    down_to: ReservePercent | None = None  # the least CR that may be enough, where that saves more than the precision


@dataclass(frozen=True, slots=True, kw_only=True)
class NotAchievable:
    """Not every APT is met at the highest CR that the host can give, which is this one."""

    reserve: ReservePercent


@dataclass(frozen=True, slots=True, kw_only=True)
class NotResolved:
    """It is not known yet which CR is enough."""

    reason: str
    member: str = ""  # whose samples are meant: the one that has to be measured longest; empty: each
    samples: int | None = None  # with which the highest setting would probably be clear, maybe more than it may have;
    # None: unknown
    more_settings: int = 0  # the search ended before its end: so many settings more, at most, may find one
    ends_at_until: bool = False  # a setting took `run.until` at most, and no budget


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingFailed:
    """The setting with this CR had too many failed samples, and was not recorded."""

    reserve: ReservePercent
    verdict: TooManyFailures


@dataclass(frozen=True, slots=True, kw_only=True)
class Swept:
    """All the settings that were asked for are there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stopped:
    """A user asked for an end; what is recorded stays, and the same command goes on."""


SearchDecision = Measure | Sufficient | NotAchievable | NotResolved
"""What a search for the least sufficient CR answers."""

Conclusion = Sufficient | NotAchievable | NotResolved | SettingFailed | Swept | Stopped
"""How an experiment ended."""

ExperimentDecision = Measure | Conclusion
"""What a strategy answers."""


class Achievement(StrEnum):
    """The standing of a threshold, from good to bad; a component has that of its worst threshold."""

    MET = "met"
    PROVISIONAL = "provisional"  # met by the estimates of the first pass, and inconclusive with every load
    UNMEASURED = "not measured"  # a load that the reservation must hold with has no data log that holds
    OPEN = "inconclusive"
    MISSED = "not achieved"


def worst(achievements: tuple[Achievement, ...]) -> Achievement:
    """Return the worst of them; of none, that nothing is measured."""
    order = tuple(Achievement)
    return max(achievements, key=order.index, default=Achievement.UNMEASURED)


@dataclass(frozen=True, slots=True, kw_only=True)
class ThresholdAchievement:
    """The standing of one threshold of a component with all loads."""

    component: str
    index: str
    threshold: Threshold
    achievement: Achievement


@dataclass(frozen=True, slots=True, kw_only=True)
class ReservationVerdict:
    """The verdict of the data logs on the thresholds of a partition's components together."""

    thresholds: tuple[ThresholdAchievement, ...]
    interference: str = ""  # the load that asks for most; empty: nothing is measured
    so_far: Internal[ReservePercent | None] = None  # the least CR that is enough, or seems so, with the measured loads
    not_measured: tuple[str, ...] = ()  # loads without a data log that holds

    @property
    def achievement(self) -> Achievement:
        """Of the worst threshold."""
        return worst(tuple(each.achievement for each in self.thresholds))

    @output
    def reserve(self) -> ReservePercent | None:
        """The least CR at which every threshold holds with every load, in whole per cent; None: it is not known."""
        return self.so_far if self.achievement in {Achievement.MET, Achievement.PROVISIONAL} else None

    def of(self, component: str) -> Achievement:
        """Return the verdict of a component: how its worst threshold stands."""
        return worst(tuple(each.achievement for each in self.thresholds if each.component == component))

    def worst_indexes(self, component: str) -> tuple[str, ...]:
        """Name the indexes of a component that stand as it does."""
        achievement = self.of(component)
        own = (each for each in self.thresholds if each.component == component)
        return tuple(each.index for each in own if each.achievement is achievement)
