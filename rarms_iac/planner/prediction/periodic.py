"""Periodic tasks on a periodic resource: does a reservation do, whenever its time comes?

A partition that reserves a share of a processor over a window is a periodic resource: `budget` ticks within every
`period`, nobody says when. What it supplies in any `t` ticks at least is its supply bound function; what tasks must
have by then at most is their demand (earliest deadline first) or request (fixed priorities) bound function. Where the
supply never lies below, every deadline is met, and where it does, some supply and some releases miss one.

Sources: I. Shin and I. Lee, "Periodic resource model for compositional real-time guarantees", RTSS 2003; S. Baruah,
A. Mok and L. Rosier, "Preemptively scheduling hard-real-time sporadic tasks on one processor", RTSS 1990; J. Lehoczky,
L. Sha and Y. Ding, "The rate monotonic scheduling algorithm", RTSS 1989. Ticks are whole, so all of it is exact.
"""

from collections.abc import Callable, Iterator, Sequence
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


Meets = Callable[[Sequence[Task], Resource], bool]
"""Whether all deadlines hold."""


def supplied(resource: Resource, ticks: int) -> int:
    """The supply bound function: what any so many ticks in a row bring at least (Shin and Lee 2003, eq. 2).

    At worst they begin when the budget of a period was given at its very start, and the next comes at the very end.
    """
    gap = resource.period - resource.budget
    if ticks <= gap:
        return 0
    periods, left = divmod(ticks - gap, resource.period)
    return periods * resource.budget + max(0, left - gap)


def supplied_after(resource: Resource, work: int) -> int:
    """The least number of ticks that bring at least this much work, above 0; the budget is above 0, too."""
    periods = -(-work // resource.budget) - 1
    gap = resource.period - resource.budget
    return 2 * gap + periods * resource.period + work - periods * resource.budget


def demanded(tasks: Sequence[Task], ticks: int) -> int:
    """The demand bound function: work of jobs that come and are due within so many ticks (Baruah et al. 1990)."""
    return sum(max(0, (ticks - task.deadline) // task.period + 1) * task.work for task in tasks)


def meets_by_deadline(tasks: Sequence[Task], resource: Resource) -> bool:
    """Whether earliest deadline first meets all deadlines; deadlines may be longer than periods."""
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
    """When jobs are due that are released as early as can be, in order; without end."""

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


def meets_by_priority(tasks: Sequence[Task], resource: Resource) -> bool:
    """Whether fixed priorities, the first task's the highest, meet all deadlines.

    Raises:
        ValueError: a deadline is longer than its period; then the first job need not be the slowest.
    """
    if any(task.deadline > task.period for task in tasks):
        raise ValueError("fixed priorities are judged where deadlines are at most periods")
    return resource.budget > 0 and all(_answers(tasks[: at + 1], resource) for at in range(len(tasks)))


def _answers(tasks: Sequence[Task], resource: Resource) -> bool:
    """Whether the last of them answers in time when all are released at once (Lehoczky et al. 1989)."""
    *higher, last = tasks
    ticks = 0
    while ticks <= last.deadline:
        requested = last.work + sum(-(-max(ticks, 1) // task.period) * task.work for task in higher)
        needed = supplied_after(resource, requested)
        if needed == ticks:
            return True
        ticks = needed
    return False


def least_budget(tasks: Sequence[Task], period: int, meets: Meets) -> int | None:
    """The least budget in every period with which the tasks meet their deadlines; None: not even all of it does."""
    if not meets(tasks, Resource(budget=period, period=period)):
        return None
    low, high = 0, period
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if meets(tasks, Resource(budget=middle, period=period)) else (middle + 1, high)
    return low
