"""Periodic tasks on a periodic resource: does a reservation do, whenever its time comes?

A partition that reserves a share of a processor over a window is a periodic resource: `budget` ticks within every
`period`, at no known moment. What it supplies in any `t` ticks at least is its supply bound function; what tasks must
have by then at most is their demand bound function, where the earliest deadline goes first. Where the supply never lies
below, every deadline is met, and where it does, some supply and some releases miss one.

Sources: I. Shin and I. Lee, "Periodic resource model for compositional real-time guarantees", RTSS 2003; S. Baruah,
A. Mok and L. Rosier, "Preemptively scheduling hard-real-time sporadic tasks on one processor", RTSS 1990. Ticks are
whole, so all of it is exact.
"""

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from heapq import merge
from itertools import islice
from math import lcm

LOOKED_AT = 20_000
"""Deadlines at which supply is compared with demand; where that does not decide, the answer is the safe one, no."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Jobs that come no closer than a period, each with its work and its deadline; whole ticks, all above 0."""

    work: int
    period: int
    deadline: int  # after the release of the job

    @property
    def rate(self) -> Fraction:
        """The share of a processor that it takes."""
        return Fraction(self.work, self.period)


@dataclass(frozen=True, slots=True, kw_only=True)
class Resource:
    """So many ticks of a processor within every period, whenever in it they come."""

    budget: int  # 0 to period
    period: int

    @property
    def rate(self) -> Fraction:
        """The share of the processor."""
        return Fraction(self.budget, self.period)


def supplied(resource: Resource, ticks: int) -> int:
    """Compute the supply bound function: the least that a run of so many ticks brings (Shin and Lee 2003, eq. 2).

    At worst the run begins right after the budget was given at the very start of a period, and the next comes at the
    very end of its period.

    Args:
        ticks: the length of the run, at least 0.

    Returns:
        Ticks of processor time.
    """
    gap = resource.period - resource.budget
    if ticks <= gap:
        return 0
    periods, rest = divmod(ticks - gap, resource.period)
    return periods * resource.budget + max(0, rest - gap)


def demanded(tasks: Sequence[Task], ticks: int) -> int:
    """Compute the demand bound function: work of jobs that come and are due within so many ticks (Baruah et al. 1990).

    Args:
        tasks: in any order.
        ticks: the length of the run.

    Returns:
        Ticks of processor time, at most what any such run can demand.
    """
    return sum(max(0, (ticks - task.deadline) // task.period + 1) * task.work for task in tasks)


def meets_by_deadline(tasks: Sequence[Task], resource: Resource) -> bool:
    """Judge whether earliest deadline first meets all deadlines; deadlines may be longer than periods.

    Args:
        tasks: in any order; none: always met.

    Returns:
        True only where it is proved. Where the first `LOOKED_AT` deadlines do not decide, the answer is False.
    """
    rate = sum((task.rate for task in tasks), Fraction(0))
    if rate > resource.rate:
        return False
    horizon = _horizon(tasks, resource, rate)
    for ticks in islice(_deadlines(tasks), LOOKED_AT):
        if ticks > horizon:
            return True
        if demanded(tasks, ticks) > supplied(resource, ticks):
            return False
    return not tasks


def _deadlines(tasks: Sequence[Task]) -> Iterator[int]:
    """When jobs are due that are released as early as can be, in ticks from then, ascending; without end."""

    def of(task: Task) -> Iterator[int]:
        at = task.deadline
        while True:
            yield at
            at += task.period

    return merge(*map(of, tasks))


def _horizon(tasks: Sequence[Task], resource: Resource, rate: Fraction) -> Fraction:
    """Beyond it, demand cannot exceed supply first.

    Supply lies above a line of the resource's rate that begins after both gaps, demand below one of the tasks' rate.
    Where the rates are the same, all repeats after the least common multiple of the periods.
    """
    again = lcm(resource.period, *(task.period for task in tasks))
    whole = Fraction(2 * again + 2 * resource.period + max((task.deadline for task in tasks), default=0))
    if rate == resource.rate:
        return whole
    ahead = sum((task.rate * max(0, task.period - task.deadline) for task in tasks), Fraction(0))
    late = 2 * resource.rate * (resource.period - resource.budget)
    return min(whole, (late + ahead) / (resource.rate - rate))


def least_budget(tasks: Sequence[Task], period: int) -> int | None:
    """Find the least budget in every period with which the tasks meet their deadlines, earliest deadline first.

    Args:
        tasks: in any order.
        period: of the resource, in ticks.

    Returns:
        The budget in ticks, 0 to `period`; None: not even the whole processor is enough.
    """

    def is_enough(budget: int) -> bool:
        return meets_by_deadline(tasks, Resource(budget=budget, period=period))

    budget = bisect_left(range(period + 1), True, key=is_enough)
    return budget if budget <= period else None
