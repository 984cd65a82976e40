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
from math import inf, lcm

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
    """Compute the supply bound function: the least that a run of so many ticks brings (Shin and Lee 2003, eq. 2).

    At worst the run begins right after the budget was given at the very start of a period, and the next comes at the
    very end of its period.

    Args:
        resource: the budget in every period.
        ticks: the length of the run, at least 0.

    Returns:
        Ticks of processor time.
    """
    gap = resource.period - resource.budget
    if ticks <= gap:
        return 0
    periods, rest = divmod(ticks - gap, resource.period)
    return periods * resource.budget + max(0, rest - gap)


def supplied_after(resource: Resource, work: int) -> int:
    """Compute the least number of ticks that surely bring at least this much work: the inverse of `supplied`.

    Args:
        resource: with a budget above 0.
        work: ticks of processor time, above 0.

    Returns:
        Ticks, counted from the worst possible start.

    Raises:
        ZeroDivisionError: the budget is 0.
    """
    periods = -(-work // resource.budget) - 1
    gap = resource.period - resource.budget
    return 2 * gap + periods * resource.period + work - periods * resource.budget


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
        resource: what the partition gives.

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

    Args:
        tasks: by priority, the highest first; in ticks.
        resource: the supply of processor time.

    Returns:
        True: every job of every task ends by its deadline, however the supply falls.

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
    """Find the least budget in every period with which the tasks meet their deadlines, by bisection.

    Args:
        tasks: in the order that `meets` asks for.
        period: of the resource, in ticks.
        meets: the test; more budget must never make it fail. It is called about log2(period) times.

    Returns:
        The budget in ticks, 0 to `period`; None: not even the whole processor is enough.
    """
    if not meets(tasks, Resource(budget=period, period=period)):
        return None
    low, high = 0, period
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if meets(tasks, Resource(budget=middle, period=period)) else (middle + 1, high)
    return low


ROUNDS = 100
CLOSE = 1e-7
WHOLE = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class MemberDemand:
    """What each job of a component asks for, as its response time over the CR tells it.

    Alone at a CR of c per cent it answers after `waits_ms + 100 * work_ms / c`.
    """

    waits_ms: float  # whatever the reservation
    work_ms: float  # with all of the partition's processors to itself
    enough: int  # CR at which it meets its APTs alone: together it must not answer later than there
    period_ms: float | None = None  # between its jobs; None: the next begins when the last one ended
    parallel: float = 1.0  # processors that it keeps busy while it computes

    def response_ms(self, reserve: float, slower: float = 1.0) -> float:
        """Return the response time in ms.

        Args:
            reserve: the CR, in per cent, above 0.
            slower: how many times longer the work takes beside other components.

        Returns:
            Waiting and work, in ms.
        """
        return self.waits_ms + self.work_ms * slower * WHOLE / reserve

    @property
    def allowed_ms(self) -> float:
        """The longest mean response time, in ms, with which the component meets its APTs."""
        return self.response_ms(self.enough)


def responses(demands: Sequence[MemberDemand], reserve: float, processors: int) -> tuple[float, ...]:
    """Predict mean response times of components in one partition by processor sharing, as a fixed point.

    Args:
        demands: what each component's jobs ask for.
        reserve: the CR, in per cent of each processor, above 0.
        processors: virtual processors of the partition.

    Returns:
        A mean response time in ms for each, in their order; `inf` where jobs come faster than they are done. At most
            `ROUNDS` rounds are computed.
    """
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


def _computing(demand: MemberDemand, response_ms: float) -> float:
    """The part of the time in which it computes."""
    between = response_ms if demand.period_ms is None else max(demand.period_ms, response_ms)
    return (response_ms - demand.waits_ms) / between if between > 0 else 0.0


def _overrun(demand: MemberDemand, response_ms: float) -> bool:
    """Whether a job is not done when the next is due: then each is later than the one before."""
    return demand.period_ms is not None and response_ms - demand.waits_ms > demand.period_ms


def _slower(demands: Sequence[MemberDemand], computing: Sequence[float], at: int, processors: int) -> float:
    """How many times longer the work of one takes beside the others, each there with its own chance."""
    chances = {demands[at].parallel: 1.0}
    for other, demand in enumerate(demands):
        if other != at:
            after: dict[float, float] = {}
            for wanted, chance in chances.items():
                after[wanted] = after.get(wanted, 0.0) + chance * (1.0 - computing[other])
                more = wanted + demand.parallel
                after[more] = after.get(more, 0.0) + chance * computing[other]
            chances = after
    return sum(chance * max(1.0, wanted / processors) for wanted, chance in chances.items())


def least_shared(demands: Sequence[MemberDemand], processors: int) -> float:
    """Find the least CR at which each component answers as soon as it does alone at its own sufficient CR.

    Args:
        demands: what each component's jobs ask for.
        processors: virtual processors of the partition.

    Returns:
        The CR in per cent, to within 0.05 above the exact one; above 100: not even all of the partition is enough.
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
) -> MemberDemand | None:
    """Fit the demand whose response times lie closest to what was measured.

    The fit takes the least squares of the relative errors; neither waiting nor work becomes negative.

    Args:
        points: CR (per cent) and mean response time (ms) of each measured setting; times of 0 or less are ignored.
        enough: the CR at which the component meets its APTs alone.
        period_ms: between its jobs; None: the next begins when the last one ended.
        parallel: processors that it keeps busy while it computes.

    Returns:
        The demand; None: nothing was measured.
    """
    rows = [(1.0 / value, WHOLE / (reserve * value)) for reserve, value in points if value > 0]
    if not rows:
        return None
    ones, works = sum(wait for wait, _ in rows), sum(work for _, work in rows)
    square, mixed, worked = (
        sum(wait * wait for wait, _ in rows),
        sum(wait * work for wait, work in rows),
        sum(work * work for _, work in rows),
    )
    apart = square * worked - mixed * mixed
    waits = (ones * worked - works * mixed) / apart if apart > CLOSE * square * worked else 0.0
    work = (square * works - mixed * ones) / apart if apart > CLOSE * square * worked else works / worked
    if work < 0.0:
        waits, work = ones / square, 0.0
    elif waits < 0.0:
        waits, work = 0.0, works / worked
    return MemberDemand(waits_ms=waits, work_ms=work, enough=enough, period_ms=period_ms, parallel=parallel)
