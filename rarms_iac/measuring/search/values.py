"""What a search is told and what it answers; a strategy is a pure function from the one to the other."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from rarms_iac.model.measurement import Series, Setting
from rarms_iac.model.system import Run, Threshold
from rarms_iac.statistics.estimates import SAFE_SIDE, NoEstimate, estimate
from rarms_iac.statistics.steady_state import Unsteady
from rarms_iac.statistics.verdicts import LAST_EARLY_LOOK, VERDICT_ERROR, Met, Missed, Verdict, decide, judge


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """One component in P1 with what it must reach there."""

    name: str
    apt: Mapping[str, Threshold]
    run: Run


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """What is searched: the least CR at which all members meet their APTs."""

    members: tuple[Member, ...]
    processors: int  # VPs of P1
    error: float = VERDICT_ERROR  # of ending a setting early, and of saying that it misses: all members together

    @property
    def error_each(self) -> float:
        """The same of one member: whichever of them is wrong, the setting is (union bound)."""
        return self.error / max(1, len(self.members))

    @property
    def error_of_passing(self) -> float:
        """The probability that a setting passes whose APTs are not all met: at its end, or at an early look."""
        return SAFE_SIDE + LAST_EARLY_LOOK * self.error


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """A setting with the verdict on each member."""

    setting: Setting
    verdicts: Mapping[str, Verdict]

    @property
    def reserve(self) -> int:
        """The CR of the setting."""
        return self.setting.reserve

    @property
    def passed(self) -> bool:
        """Whether every member was shown to meet its APT; within the noise, the safe side is no."""
        return not self.worse

    @property
    def worse(self) -> tuple[str, ...]:
        """The members that were not shown to meet their APT."""
        return tuple(name for name, verdict in self.verdicts.items() if not isinstance(verdict, Met))

    @property
    def untold(self) -> bool:
        """Whether it says neither: nothing but a missing steady state keeps it from passing."""
        return not self.passed and all(isinstance(self.verdicts[name], Unsteady) for name in self.worse)

    @property
    def failed(self) -> bool:
        """Whether a member with a steady state was not shown to meet its APT, so that less is not enough either."""
        return not self.passed and not self.untold

    @property
    def judged(self) -> bool:
        """Whether it says anything of the APT: failures and a missing steady state do not."""
        return self.passed or any(isinstance(verdict, Missed) for verdict in self.verdicts.values())


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """Measure this setting next."""

    reserve: int
    precision: float | None = None  # not before the index is known within this part of it; None: the verdict is all


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """The least reservation: measured as passing, and one at most `reserve - failed` points below it as failing."""

    reserve: int
    failed: int | None  # the highest setting below that failed; None: there is none below


@dataclass(frozen=True, slots=True, kw_only=True)
class NotAchievable:
    """The APT is missed with all of the platform: the paper's message is `MESSAGE`."""

    message: str = "Threshold performance is not achievable on this platform."


@dataclass(frozen=True, slots=True, kw_only=True)
class NotResolved:
    """The samples allowed do not settle it."""

    why: str


Step = Measure | Found | NotAchievable | NotResolved
Strategy = Callable[[Sequence[Trial], Goal], Step]


def trial_of(setting: Setting, goal: Goal) -> Trial:
    """The setting with its verdicts, as they were when it ended: the same for a setting read from a data log.

    A member passes by the rule that a plan takes: the safe side of every index's band meets its threshold.
    """
    found = {member.name: _verdict(setting, member, goal) for member in goal.members}
    return Trial(setting=setting, verdicts=found)


def settled(series: Mapping[str, Series], goal: Goal, *, precision: float | None = None) -> bool:
    """Whether a setting that is being measured may stop now; to be asked at `next_look` counts of samples.

    What it shows is clear then, so that more samples would hardly turn what it passes by (`trial_of`).

    One member that misses settles it; otherwise every member must be settled. The precision is `Measure.precision`.
    """
    if precision is not None and not all(_known(series[member.name], member, precision) for member in goal.members):
        return False
    verdicts = [decide(series[member.name], member.apt, member.run, error=goal.error_each) for member in goal.members]
    return any(isinstance(verdict, Missed) for verdict in verdicts) or None not in verdicts


def _known(series: Series, member: Member, precision: float) -> bool:
    """Whether its response times, whose mean says most to a search, are known that well; True if it shows none."""
    mean = estimate("mean_response_time", series, member.run)
    return isinstance(mean, NoEstimate) or mean.upper - mean.value <= precision * mean.value


def _verdict(setting: Setting, member: Member, goal: Goal) -> Verdict:
    series = next(series for series in setting.series if series.component == member.name)
    safe = judge(series, member.apt, member.run, error=SAFE_SIDE * max(1, len(member.apt)))
    if isinstance(safe, Met):
        return safe
    # That it misses is a claim of its own, which every member's share in the error goes into.
    return judge(series, member.apt, member.run, error=goal.error_each)
