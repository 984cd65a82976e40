"""The bounds of the periodic resource model against schedules that are simulated tick by tick."""

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, lcm

from rarms_iac.planner.prediction import Resource, Task, demanded, least_budget, meets_by_deadline, supplied
from tests.effort import examples

SETS = 200  # random sets a policy; 10,000 in the long run
PERIODS = (3, 4, 5, 6, 8, 10, 12, 15, 20, 24, 30)  # that repeat together after 120 ticks

Supply = Callable[[int], bool]
"""Whether this tick is given."""


@dataclass(slots=True, kw_only=True)
class Job:
    rank: int  # of its task: 0 is the highest priority
    due: int
    work: int  # ticks that are still to be done


def misses(tasks: Sequence[Task], supply: Supply, first: Sequence[int], until: int) -> bool:
    """Whether a job is late, earliest deadline first, when task k releases its jobs from `first[k]` on."""
    ready: list[Job] = []
    for tick in range(until):
        for rank, (task, begins) in enumerate(zip(tasks, first, strict=True)):
            if tick >= begins and (tick - begins) % task.period == 0:
                ready.append(Job(rank=rank, due=tick + task.deadline, work=task.work))
        if any(job.due <= tick for job in ready):
            return True
        if ready and supply(tick):
            runs = min(ready, key=lambda job: (job.due, job.rank))
            runs.work -= 1
            if not runs.work:
                ready.remove(runs)
    return any(job.due <= until for job in ready)


def at_worst(resource: Resource) -> Supply:
    """The last budget was given at once, and from now on each comes as late as it can."""
    gap = resource.period - resource.budget

    def given(tick: int) -> bool:
        return tick >= gap and (tick - gap) % resource.period >= gap

    return given


def at_random(resource: Resource, chance: random.Random) -> Supply:
    """In every period some of its ticks."""
    supplied: dict[int, set[int]] = {}

    def given(tick: int) -> bool:
        period, at = divmod(tick, resource.period)
        if period not in supplied:
            supplied[period] = set(chance.sample(range(resource.period), resource.budget))
        return at in supplied[period]

    return given


def a_case(chance: random.Random) -> tuple[list[Task], Resource]:
    """Up to four tasks, some with deadlines beyond their periods, and a resource of about the rate that they need."""
    tasks = []
    for _ in range(chance.randint(1, 4)):
        period = chance.choice(PERIODS)
        deadline = chance.randint(max(1, period // 2), period * 2 if chance.random() < 0.3 else period)
        tasks.append(Task(work=chance.randint(1, max(1, period // 4)), period=period, deadline=deadline))
    period = chance.choice((2, 3, 4, 5, 6, 8, 10))
    rate = float(sum(task.rate for task in tasks))
    budget = min(period, max(1, round(period * min(1.0, rate * chance.uniform(0.95, 2.2)))))
    return tasks, Resource(budget=budget, period=period)


def until(tasks: Sequence[Task], resource: Resource) -> int:
    """Twice the time after which all repeats, and the last deadlines; where too much is asked, until that shows."""
    again = lcm(resource.period, *(task.period for task in tasks))
    whole = 2 * again + 2 * resource.period + max(task.deadline for task in tasks)
    beyond = sum(task.rate for task in tasks) - resource.rate
    late = sum(task.rate * task.deadline for task in tasks) / beyond if beyond > 0 else 0
    return max(whole, ceil(late) + max(task.deadline for task in tasks))


def test_bounds_say_what_schedule_at_worst_does() -> None:
    chance, said = random.Random("periodic"), {True: 0, False: 0}
    for _ in range(examples(SETS)):
        tasks, resource = a_case(chance)
        found = meets_by_deadline(tasks, resource)
        said[found] += 1
        late = misses(tasks, at_worst(resource), [0] * len(tasks), until(tasks, resource))
        assert found is not late, f"{tasks} on {resource}"
    assert min(said.values()) > examples(SETS) // 10, "both answers are common"


def test_what_holds_at_worst_holds_whenever_budget_comes() -> None:
    chance, held = random.Random("any supply"), 0
    for _ in range(examples(SETS)):
        tasks, resource = a_case(chance)
        first = [chance.randrange(task.period) for task in tasks]
        if meets_by_deadline(tasks, resource):
            held += 1
            assert not misses(tasks, at_random(resource, chance), first, until(tasks, resource))
    assert held


def test_supply_bound_is_least_that_worst_supply_brings() -> None:
    for period in range(1, 8):
        for budget in range(1, period + 1):
            resource = Resource(budget=budget, period=period)
            given, brought = at_worst(resource), 0
            for tick in range(5 * period):
                assert supplied(resource, tick) == brought
                brought += given(tick)


def test_demand_bound_counts_jobs_due() -> None:
    tasks = [Task(work=2, period=5, deadline=3), Task(work=1, period=4, deadline=6)]

    assert [demanded(tasks, ticks) for ticks in (2, 3, 6, 8, 10)] == [0, 2, 3, 5, 6]


def test_least_budget_does_and_one_less_does_not() -> None:
    tasks = [Task(work=2, period=20, deadline=15), Task(work=5, period=30, deadline=30)]
    found = least_budget(tasks, 10)

    assert found is not None
    assert meets_by_deadline(tasks, Resource(budget=found, period=10))
    assert not meets_by_deadline(tasks, Resource(budget=found - 1, period=10))
    assert least_budget([Task(work=5, period=5, deadline=4)], 10) is None


def test_nothing_to_run_needs_nothing() -> None:
    assert least_budget([], 10) == 0
