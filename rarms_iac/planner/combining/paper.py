"""TPTULR and CombineComponents as the paper has them; docs/combining.md says what is done where it is silent."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from rarms_iac.planner.combining.oracle import (
    WHOLE,
    Always,
    Coi,
    Consent,
    Members,
    PerformanceOracle,
    PlannerReporter,
    SilentReporter,
    leader,
    processors_of,
    total,
    union,
)
from rarms_iac.storage.datalog.decisions import TrailSetting

SUCCESSFUL = "successful"
UNABLE = "Unable to reduce total CPU reservation by combining CoIs"

STEP = 10
"""CMCPUR: 10, 20, ... 100 %."""

MOST_OF_PAIR = 1 + WHOLE // STEP
"""Settings that the procedure asks for a pair at most: the sum of both, then CMCPUR."""

Sharing = Callable[[Members], bool]
"""Whether these may be in one partition: what `apart` and `dedicated` forbid is not tried."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Inquiry:
    """The oracle and the listener of the procedure, and the pairs that it may try."""

    oracle: PerformanceOracle
    reporter: PlannerReporter = field(default_factory=SilentReporter)
    consent: Consent = field(default_factory=Always)
    may_share: Sharing = lambda _members: True

    def ask(self, members: Members, reserve: int, predicted: int | None = None) -> TrailSetting:
        """Ask the oracle about one setting, and tell the reporter what it answered.

        Args:
            members: the components together, by sorted names.
            reserve: the CR, 1..100 whole per cent.
            predicted: the CR that is expected to be enough; None: nothing was predicted.

        Returns:
            The answer, with the members that miss an APT by sorted names.

        Raises:
            Unanswered: the oracle has no answer.
        """
        worse = self.oracle.worse(members, reserve)
        answer = TrailSetting(
            components=members,
            reserve=reserve,
            worse=tuple(sorted(worse)),
            unresolved=bool(worse) and self.oracle.unresolved(members, reserve),
            predicted=predicted,
        )
        self.reporter.setting_answered(answer)
        return answer


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperTuning:
    """The result of tuning."""

    cois: tuple[Coi, ...]  # as they are now, most critical first
    compounds: tuple[Coi, ...]  # in the order in which they were made
    trail: tuple[TrailSetting, ...]
    needed: bool  # False: all fitted, and there was nothing to do

    @property
    def message(self) -> str:
        """What the paper says; empty where there was nothing to do."""
        if not self.needed:
            return ""
        return SUCCESSFUL if self.compounds else UNABLE


def tune_performance_to_use_less_resource(
    cois: Sequence[Coi], fits: Callable[[Sequence[Coi]], bool], inquiry: Inquiry, *, repeat: bool = False
) -> PaperTuning:
    """Apply TPTULR: combine CoIs that do not fit as they are.

    One call makes one combination; `repeat` goes on with the compound until the CoIs fit or nothing succeeds.

    Args:
        cois: what runs now, in any order.
        fits: whether the hosts have room for these CoIs; the paper compares their sum with 100 %.
        inquiry: who answers, who may refuse a combination, and who gets reports.
        repeat: go on with the compound after the first combination.

    Returns:
        The CoIs as they are then, by falling criticality, what was combined and what was asked, in order.

    Raises:
        Unanswered: the oracle has no answer.
    """
    trail: list[TrailSetting] = []
    made: list[Coi] = []
    now = ordered(cois)
    needed = not fits(now)
    while needed and (not made or (repeat and not fits(now))):
        found = combine_components(now, inquiry, trail)
        if found is None:
            break
        compound, parts = found
        made.append(compound)
        now = ordered([*(coi for coi in now if coi not in parts), compound])
    return PaperTuning(cois=now, compounds=tuple(made), trail=tuple(trail), needed=needed)


def ordered(cois: Sequence[Coi]) -> tuple[Coi, ...]:
    """Sort CoIs by non-increasing criticality, equal ones by name, as the paper's procedures expect them.

    Returns:
        All of them, the most critical first.
    """
    return tuple(sorted(cois, key=lambda coi: (-coi.criticality, coi.name)))


def combine_components(
    cois: Sequence[Coi], inquiry: Inquiry, trail: list[TrailSetting]
) -> tuple[Coi, tuple[Coi, Coi]] | None:
    """Apply CombineComponents: combine the least critical one with the next possible one.

    What was asked is added to the trail.

    Args:
        inquiry: who answers, who may refuse a combination, and who gets reports.
        trail: what was asked so far, in order; every answer is appended.

    Returns:
        The compound and its two parts; None: no component could be combined with it.

    Raises:
        Unanswered: the oracle has no answer.
    """
    others = list(ordered(cois))
    least = others.pop() if others else None
    while least is not None and others:
        next_to_last = others.pop()
        compound = _tried(least, next_to_last, inquiry, trail)
        if compound is not None:
            inquiry.reporter.combined(compound, total((least, next_to_last)))
            return compound, (next_to_last, least)
    return None


def _tried(least: Coi, next_to_last: Coi, inquiry: Inquiry, trail: list[TrailSetting]) -> Coi | None:
    """Try one pair, first with the sum of both, then by CMCPUR; None is TryAgain."""
    pair = (next_to_last, least)
    members, processors = union(*pair), processors_of(pair)
    together = min(WHOLE, -(-total(pair) // processors))  # no partition can reserve more than all of it
    gain = total(pair) - max(coi.cost for coi in pair)
    allowed = inquiry.may_share(members) and inquiry.consent.allows(members, MOST_OF_PAIR, gain)
    if not allowed:
        inquiry.reporter.declined(members)
        return None
    first = inquiry.ask(members, together)  # the sum of both reservations
    trail.append(first)
    if all(set(coi.members) & set(first.worse) for coi in pair):
        return None
    for reserve in range(STEP, WHOLE + 1, STEP):
        answer = inquiry.ask(members, reserve)
        trail.append(answer)
        if answer.met:
            return replace(leader(pair), members=members, processors=processors, reserve=reserve, missed=None)
    return None
