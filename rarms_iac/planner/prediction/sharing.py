"""Processor sharing: how much slower a component answers when others of its partition compute at the same time.

Whoever computes shares the partition's processors evenly with whoever computes at the same moment, and does so for as
long as it takes to answer: a fixed point of response times, as mean value analysis has it (M. Reiser and S. Lavenberg,
"Mean-value analysis of closed multichain queuing networks", J. ACM 27, 1980), each component a chain of one customer.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

ROUNDS = 100
CLOSE = 1e-7
WHOLE = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class Demand:
    """What each job of a component asks for, as its response time over the CR tells it.

    Alone at a CR of c per cent it answers after `waits_ms + 100 * work_ms / c`.
    """

    waits_ms: float  # whatever the reservation
    work_ms: float  # with all of the partition's processors to itself
    enough: int  # CR at which it meets its APTs alone: together it must not answer later than there
    period_ms: float | None = None  # between its jobs; None: the next begins when the last one ended
    parallel: float = 1.0  # processors that it keeps busy while it computes

    def response_ms(self, reserve: float, slower: float = 1.0) -> float:
        """At this CR (per cent), with its work so many times slower."""
        return self.waits_ms + self.work_ms * slower * WHOLE / reserve

    @property
    def allowed_ms(self) -> float:
        """What meets its APTs."""
        return self.response_ms(self.enough)


def responses(demands: Sequence[Demand], reserve: float, processors: int) -> tuple[float, ...]:
    """The mean response times (ms) of these in one partition at this CR, in their order; `inf`: more than it has."""
    found = tuple(demand.response_ms(reserve) for demand in demands)
    for _ in range(ROUNDS):
        computing = [_computing(demand, seen) for demand, seen in zip(demands, found, strict=True)]
        after = tuple(
            demand.response_ms(reserve, _slower(demands, computing, at, processors))
            for at, demand in enumerate(demands)
        )
        near = all(abs(new - old) <= CLOSE * new for new, old in zip(after, found, strict=True))
        found = after
        if near:
            break
    return tuple(inf if _overrun(demand, seen) else seen for demand, seen in zip(demands, found, strict=True))


def _computing(demand: Demand, response_ms: float) -> float:
    """The part of the time in which it computes."""
    between = response_ms if demand.period_ms is None else max(demand.period_ms, response_ms)
    return (response_ms - demand.waits_ms) / between if between > 0 else 0.0


def _overrun(demand: Demand, response_ms: float) -> bool:
    """Whether a job is not done when the next is due: then each is later than the one before."""
    return demand.period_ms is not None and response_ms - demand.waits_ms > demand.period_ms


def _slower(demands: Sequence[Demand], computing: Sequence[float], at: int, processors: int) -> float:
    """How many times longer the work of one takes beside the others, each there with its own chance."""
    chances = {demands[at].parallel: 1.0}
    for other, one in enumerate(demands):
        if other != at:
            after: dict[float, float] = {}
            for wanted, chance in chances.items():
                after[wanted] = after.get(wanted, 0.0) + chance * (1.0 - computing[other])
                more = wanted + one.parallel
                after[more] = after.get(more, 0.0) + chance * computing[other]
            chances = after
    return sum(chance * max(1.0, wanted / processors) for wanted, chance in chances.items())


def least_shared(demands: Sequence[Demand], processors: int) -> float:
    """The least CR (per cent, not rounded) at which each of them answers as soon as it does alone where that is enough.

    Above 100: not even all of the partition is enough.
    """
    low, high = float(max((demand.enough for demand in demands), default=0)), 2.0 * WHOLE
    while high - low > 0.05:
        middle = (low + high) / 2
        seen = responses(demands, middle, processors)
        enough = all(at <= demand.allowed_ms * (1 + CLOSE) for demand, at in zip(demands, seen, strict=True))
        low, high = (low, middle) if enough else (middle, high)
    return high


def demand_of(
    points: Sequence[tuple[float, float]], enough: int, *, period_ms: float | None = None, parallel: float = 1.0
) -> Demand | None:
    """The demand whose response times lie closest to what was measured: CR (per cent) and mean response time (ms).

    Least squares of what it is off, in parts of the value; neither waiting nor work is below 0. None: nothing measured.
    """
    rows = [(1.0 / value, WHOLE / (reserve * value)) for reserve, value in points if value > 0]
    if not rows:
        return None
    ones, works = sum(one for one, _ in rows), sum(work for _, work in rows)
    square, mixed, worked = (
        sum(one * one for one, _ in rows),
        sum(one * work for one, work in rows),
        sum(work * work for _, work in rows),
    )
    apart = square * worked - mixed * mixed
    waits = (ones * worked - works * mixed) / apart if apart > CLOSE * square * worked else 0.0
    work = (square * works - mixed * ones) / apart if apart > CLOSE * square * worked else works / worked
    if work < 0.0:
        waits, work = ones / square, 0.0
    elif waits < 0.0:
        waits, work = 0.0, works / worked
    return Demand(waits_ms=waits, work_ms=work, enough=enough, period_ms=period_ms, parallel=parallel)
