"""What a compound will probably need, by the data logs of its members alone: chooses questions, and proves nothing.

Begin at `predictor_of`. A partition that reserves a share of a processor over a window is a periodic resource: `budget`
ticks within every `period`, at an unknown time. The supply bound function is the least that it supplies in any `t`
ticks. The demand bound function is the most that tasks must have by then, where the earliest deadline goes first. If
the supply is never below the demand, every deadline is met; otherwise some supply and some releases miss one.

Sources: I. Shin and I. Lee, "Periodic resource model for compositional real-time guarantees", RTSS 2003; S. Baruah,
A. Mok and L. Rosier, "Preemptively scheduling hard-real-time sporadic tasks on one processor", RTSS 1990. Ticks are
whole, so all of it is exact.
"""

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from heapq import merge
from itertools import islice
from math import lcm

from rarms_iac.model.host import Host
from rarms_iac.model.indexes import percentile_of
from rarms_iac.model.run import Periodic
from rarms_iac.model.system import AtMost, Component
from rarms_iac.planner.groups import Group
from rarms_iac.planner.reservations import MeasuredReservations, ReservationSource
from rarms_iac.planner.verdicts import MeasuredTogether

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
    """Yield the due times of jobs released as early as possible, in ticks from then, ascending, without end."""

    def of(task: Task) -> Iterator[int]:
        at = task.deadline
        while True:
            yield at
            at += task.period

    return merge(*map(of, tasks))


def _horizon(tasks: Sequence[Task], resource: Resource, rate: Fraction) -> Fraction:
    """Return the time beyond which demand cannot exceed supply for the first time.

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
        period: of the resource, in ticks.

    Returns:
        The budget in ticks, 0 to `period`; None: not even the whole processor is enough.
    """

    def is_enough(budget: int) -> bool:
        return meets_by_deadline(tasks, Resource(budget=budget, period=period))

    budget = bisect_left(range(period + 1), True, key=is_enough)
    return budget if budget <= period else None


Predict = Callable[[tuple[str, ...], int], int | None]
"""The CR that a compound probably needs, by its components (sorted names) and virtual processors; None: not known."""

TICKS = 100
"""In a millisecond, the period of the resource: time comes evenly, as a task is fitted to what it needed alone."""

WHOLE = 100

MOST = 90
"""Per cent: a threshold of at least this percentile of the response time is taken for a deadline."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Alone:
    """A component by itself."""

    task: Task  # in ticks of all its processors together; it needs the CR that was measured to be enough
    processors: int  # of the partition that it was measured in


def alone_in(groups: Iterable[Group], reservations: ReservationSource, host: Host) -> Mapping[str, Alone]:
    """Collect what is known of the components that were measured alone for this host.

    Args:
        groups: the partitions of the system; those of several components are passed over.
        reservations: where logs come from; sources without data logs give nothing.
        host: the host that the logs must hold for.

    Returns:
        By component's name; a component whose log says too little is missing.
    """
    found = {}
    if isinstance(reservations, MeasuredReservations):
        for group in groups:
            log = reservations.log(group.members, host)
            if len(group.members) == 1 and isinstance(log, MeasuredTogether) and log.least is not None:
                (member,) = group.members
                points = log.curves(member.name, "mean_response_time").points
                means = [(point.reserve, point.value) for point in points]
                alone = alone_of(member, means, log.least, log.processors, log.cpu_ms(member.name))
                if alone is not None:
                    found[member.name] = alone
    return found


def alone_of(
    component: Component, points: Sequence[tuple[float, float]], enough: int, processors: int, cpu_ms: float | None
) -> Alone | None:
    """Derive a component's task from what was measured of it alone.

    A job is due at the earliest deadline of the component (`run.deadline`, or an APT on the maximum or a high
    percentile of the response time), otherwise when it answers on average where its CR is enough. Where the next job
    begins when the last one ended, that answer is the period, too.

    Args:
        component: with its APTs and its arrival.
        points: CR (per cent) and mean response time (ms) of each measured setting.
        enough: the CR at which it meets its APTs.
        cpu_ms: processor time of a job; None: it is taken to use one processor at a time.

    Returns:
        What is known of it; None: it never computes, or its deadline is over before it begins to.
    """
    waits, work = waits_and_work(points)
    answers = waits + WHOLE * work / enough
    run = component.run
    deadlines = [
        float(most.value) for name, most in component.apt.items() if isinstance(most, AtMost) and _is_deadline(name)
    ]
    if run is not None and run.deadline is not None:
        deadlines.append(float(run.deadline))
    deadline = min(deadlines, default=answers) - waits
    if work <= 0 or deadline <= 0:
        return None
    arrival = None if run is None else run.arrival
    period = float(arrival.period) if isinstance(arrival, Periodic) else answers
    period_ticks, deadline_ticks = (max(1, round(TICKS * each)) for each in (period, deadline))
    brings = supplied(Resource(budget=TICKS * enough // WHOLE, period=TICKS), deadline_ticks)
    busy = 1.0 if cpu_ms is None else min(float(processors), max(1.0, cpu_ms / work))
    share = busy / processors * min(brings, period_ticks * enough // WHOLE)
    task = Task(work=max(1, round(share)), period=period_ticks, deadline=deadline_ticks)
    return Alone(task=task, processors=processors)


def _is_deadline(index: str) -> bool:
    percentile = percentile_of(index)
    return index == "maximum_response_time" or (percentile is not None and percentile >= MOST)


def waits_and_work(points: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Fit how long a job waits at any reservation, and how long it computes with all of its processors.

    At a CR of c per cent it answers after `waits + 100 * work / c`. The fit takes the least squares of the relative
    errors; neither becomes negative.

    Args:
        points: CR (per cent) and mean response time (ms) of each measured setting; times of 0 or less are ignored.

    Returns:
        Both in ms; 0 where nothing was measured.
    """
    rows = [(1.0 / value, WHOLE / (reserve * value)) for reserve, value in points if value > 0]
    if not rows:
        return 0.0, 0.0
    ones, works = sum(wait for wait, _ in rows), sum(work for _, work in rows)
    square, mixed, worked = (
        sum(wait * wait for wait, _ in rows),
        sum(wait * work for wait, work in rows),
        sum(work * work for _, work in rows),
    )
    determinant = square * worked - mixed * mixed
    if determinant <= 1e-7 * square * worked:
        return 0.0, works / worked
    waits, work = (ones * worked - works * mixed) / determinant, (square * works - mixed * ones) / determinant
    if work < 0.0:
        return ones / square, 0.0
    return (0.0, works / worked) if waits < 0.0 else (waits, work)


def unpredicted(_members: tuple[str, ...], _processors: int) -> int | None:
    """Predict nothing.

    Returns:
        None, always.
    """
    return None


def predictor_of(alone: Mapping[str, Alone]) -> Predict:
    """Make a predictor from what is known of components alone.

    The bounds hold for one processor; several are taken for one that is as fast as all of them, on which a job that
    uses fewer leaves time to others.

    Args:
        alone: by component's name, as `alone_in` returns it.

    Returns:
        A predictor that knows a compound where each of its components was measured on as many processors, and all of
            the host is enough for them.
    """

    @cache
    def predict(members: tuple[str, ...], processors: int) -> int | None:
        known = [alone[name] for name in members if name in alone]
        if len(known) < len(members) or any(member.processors != processors for member in known):
            return None
        budget = least_budget([member.task for member in known], TICKS)
        return None if budget is None else WHOLE * budget // TICKS

    return predict
