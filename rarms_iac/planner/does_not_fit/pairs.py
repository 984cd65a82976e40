"""Which pair to combine: only where the least that the two could need together would fit (DESIGN section 3)."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations

from rarms_iac.model.plan import Claim
from rarms_iac.model.quantities import LogicalProcessors, ProcessorTime, show_percent
from rarms_iac.model.system import CpuWish, Host, PartitionWish, System
from rarms_iac.planner.groups import Group, may_share
from rarms_iac.planner.prediction.members import NOTHING, Predictor, expected_of
from rarms_iac.planner.reservations import names_of

Fits = Callable[[System], bool]
Claimed = Callable[[Group], Claim | None]
"""What a partition is promised on the host; None: it cannot be there."""

TRIED = 30
"""Pairs that are planned, those that combine the least critical first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """What a pair is tried with."""

    system: System
    host: Host
    claimed: Claimed
    fits: Fits
    predictor: Predictor = NOTHING


def pair_to_combine(groups: Sequence[Group], trial: Trial) -> str | None:
    """The best pair in the objective's order that may help, with what the two may need for it; None: there is none.

    Together they need at least what the needier needs alone, and gain nothing unless it is less than both need.
    """
    for pair in list(_in_order(groups))[:TRIED]:
        claims = [claim for group in pair if (claim := trial.claimed(group)) is not None and claim.reserve]
        if len(claims) == len(pair):
            told = _tried(pair, claims, trial)
            if told is not None:
                return told
    return None


def _tried(pair: tuple[Group, Group], claims: Sequence[Claim], trial: Trial) -> str | None:
    """In per cent of each of their virtual processors, as it would be measured."""
    wide = max(one.processors for one in claims)
    needs = [one.processors * one.reserve for one in claims]
    lower, upper = -(-max(needs) // wide), -(-sum(needs) // wide) - 1

    def works(reserve: int) -> bool:
        return trial.fits(_combined(trial.system, *pair, reserve * wide))

    def share(reserve: int) -> str:
        return show_percent(Fraction(reserve * wide, trial.host.logical_processors))

    if lower > upper or not works(lower):
        return None
    members = names_of(member for group in pair for member in group.members)
    expected = expected_of(trial.predictor, members, wide, needs)
    predicted = "" if expected is None else f" (predicted: {share(expected)})"
    most = share(_highest(lower, upper, works))
    return (
        f"combining {pair[0].name} and {pair[1].name} in one partition may be enough: the two need {share(lower)} to "
        f"{share(upper)} of {trial.host.name} then{predicted}, and up to {most} fits (`rarms tune` measures it)"
    )


def _in_order(groups: Sequence[Group]) -> Iterator[tuple[Group, Group]]:
    """Pairs that nothing forbids, by the criticalities of those who would share, then by name."""

    def key(pair: tuple[Group, Group]) -> tuple[list[int], tuple[str, ...]]:
        members = [member for group in pair for member in group.members]
        return sorted((one.criticality for one in members), reverse=True), tuple(group.name for group in pair)

    pairs = combinations(sorted(groups, key=lambda one: (one.criticality, one.name)), 2)
    yield from sorted((pair for pair in pairs if may_share(*pair)), key=key)


def _combined(system: System, one: Group, other: Group, percent: int) -> System:
    """The manifest with both in one partition that reserves so much of one LP."""
    kept = {name: wish for name, wish in system.partitions.items() if name not in (one.name, other.name)}
    wide = max(one, other, key=lambda group: (group.criticality, group.name))
    reserve = ProcessorTime(LogicalProcessors(Fraction(percent, 100)))
    wish = PartitionWish(
        name=wide.name,
        components=tuple(member.name for group in (one, other) for member in group.members),
        cpu=CpuWish(reserve=reserve),
    )
    return replace(system, partitions={**kept, wide.name: wish})


def _highest(low: int, high: int, works: Callable[[int], bool]) -> int:
    """The largest number that works; `low` does."""
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if works(middle) else (low, middle - 1)
    return low
