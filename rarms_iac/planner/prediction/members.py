"""What the data logs of components alone say of them together: one CR a way to predict."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil

from rarms_iac.model.host import Host
from rarms_iac.model.indexes import percentile_of
from rarms_iac.model.run import Periodic
from rarms_iac.model.system import AtMost, Component
from rarms_iac.planner.groups import Group
from rarms_iac.planner.prediction.belief import SELDOM, Outlook, at_least, belief_of, slack_on
from rarms_iac.planner.prediction.periodic import (
    WHOLE,
    Meets,
    MemberDemand,
    Resource,
    Task,
    demand_of,
    least_budget,
    least_shared,
    meets_by_deadline,
    meets_by_priority,
)
from rarms_iac.planner.reservations import MeasuredReservations, MeasuredTogether, ReservationSource

WAYS = (
    "processor sharing",
    "periodic resource of 1 ms, earliest deadline first",
    "periodic resource of 10 ms, earliest deadline first",
    "periodic resource of 10 ms, fixed priorities",
)
"""The ways to predict, in the order of what they say."""

Predictions = tuple[float | None, ...]
"""The CR that each way predicts for a compound, not rounded; None: it cannot tell."""

TICKS = 100
"""In a millisecond."""

EVENLY, IN_TURNS = 1 * TICKS, 10 * TICKS
"""Periods of the resource that a partition is taken for: time that comes all along, or in turns of a hypervisor."""

MOST = 90
"""Per cent: a threshold of at least this percentile of the response time is taken for a deadline."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Alone:
    """A component by itself."""

    demand: MemberDemand
    task: Task | None  # ticks; None: its jobs have no period or no deadline
    processors: int  # of the partition that it was measured in

    def fitted(self, window: int, meets: Meets) -> Task | None:
        """Scale the task's work so that alone it needs just the CR that it was measured to need.

        Args:
            window: the period of the resource, in ticks.
            meets: the test for deadlines.

        Returns:
            The scaled task; None: the component has no task, or not even a whole processor is enough for it.
        """
        if self.task is None:
            return None
        budget = least_budget([self.task], window, meets)
        if budget is None:
            return None
        part = self.demand.enough * window / (WHOLE * budget)
        return replace(self.task, work=max(1, round(self.task.work * part)))


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
            log, least = reservations.log(group.members, host), reservations.least(group.members, host)
            if len(group.members) == 1 and isinstance(log, MeasuredTogether) and least is not None:
                found[group.members[0].name] = alone_of(group.members[0], log, least.reserve)
    return {name: alone for name, alone in found.items() if alone is not None}


def alone_of(component: Component, log: MeasuredTogether, enough: int) -> Alone | None:
    """Derive a component's demand, and its task where it has a deadline, from its own data log.

    Args:
        component: the component, with its APTs and its arrival.
        log: the log of the component alone.
        enough: the CR at which it meets its APTs, in per cent of each of the log's processors.

    Returns:
        What is known of it; None: the log has no mean response time.
    """
    points = [(point.reserve, point.value) for point in log.curves(component.name, "mean_response_time").points]
    arrival = None if component.run is None else component.run.arrival
    period = float(arrival.period) if isinstance(arrival, Periodic) else None
    demand = demand_of(points, enough, period_ms=period)
    if demand is None:
        return None
    used = log.cpu_ms(component.name)
    if used is not None and demand.work_ms > 0:
        demand = replace(demand, parallel=min(float(log.processors), max(1.0, used / demand.work_ms)))
    return Alone(demand=demand, task=_task(component, demand), processors=log.processors)


def _task(component: Component, demand: MemberDemand) -> Task | None:
    deadlines = [
        float(most.value) for name, most in component.apt.items() if isinstance(most, AtMost) and _is_deadline(name)
    ]
    if component.run is not None and component.run.deadline is not None:
        deadlines.append(float(component.run.deadline))
    if demand.period_ms is None or not deadlines or demand.work_ms <= 0:
        return None
    allowed_ms = min(deadlines) - demand.waits_ms
    if allowed_ms <= 0:
        return None
    return task_of(demand.work_ms, demand.period_ms, allowed_ms)


def _is_deadline(index: str) -> bool:
    percentile = percentile_of(index)
    return index == "maximum_response_time" or (percentile is not None and percentile >= MOST)


def task_of(work_ms: float, period_ms: float, deadline_ms: float) -> Task:
    """Turn milliseconds into a task of whole ticks, rounded to the safe side: more work, shorter period and deadline.

    Args:
        work_ms: processor time of each job.
        period_ms: the least time between jobs.
        deadline_ms: from a job's release to its latest answer.

    Returns:
        The task; each value is at least one tick (`TICKS` a millisecond).
    """
    return Task(
        work=max(1, ceil(work_ms * TICKS)),
        period=max(1, int(period_ms * TICKS)),
        deadline=max(1, int(deadline_ms * TICKS)),
    )


def predictions_of(members: Sequence[Alone], processors: int) -> Predictions:
    """Predict, by each of `WAYS`, the CR that these components need together in one partition.

    The periodic resource's bounds hold for one processor; several are taken as one that is as fast as all of them.

    Args:
        members: what is known of each component alone.
        processors: virtual processors of the partition.

    Returns:
        A CR (per cent of each processor, not rounded) for each way, in the order of `WAYS`; None where it cannot say.
            All are None where a member was measured on another number of processors.
    """
    if any(member.processors != processors for member in members):
        return (None,) * len(WAYS)
    return (
        least_shared([member.demand for member in members], processors),
        _periodic(members, EVENLY, meets_by_deadline),
        _periodic(members, IN_TURNS, meets_by_deadline),
        _periodic(members, IN_TURNS, _by_deadline_length),
    )


def _periodic(members: Sequence[Alone], window: int, meets: Meets) -> float | None:
    tasks = [member.fitted(window, meets) for member in members]
    known = [task for task in tasks if task is not None]
    budget = least_budget(known, window, meets) if len(known) == len(tasks) else None
    return None if budget is None else budget * WHOLE / window


def _by_deadline_length(tasks: Sequence[Task], resource: Resource) -> bool:
    """Deadline monotonic: the shorter the deadline, the higher the priority; none may be longer than its period."""
    if any(task.deadline > task.period for task in tasks):
        return False
    return meets_by_priority(sorted(tasks, key=lambda task: task.deadline), resource)


@dataclass(frozen=True, slots=True, kw_only=True)
class Predictor:
    """Says what each of some ways predicts of a compound; each compound is worked out once."""

    ways: tuple[str, ...]
    predict: Callable[[tuple[str, ...], int], Predictions]  # members, virtual processors
    _known: dict[tuple[tuple[str, ...], int], Predictions] = field(default_factory=dict, compare=False, repr=False)

    def of(self, members: tuple[str, ...], processors: int) -> Predictions:
        """Return the CR that each way predicts for a compound.

        Args:
            members: its components, by sorted names.
            processors: virtual processors of its partition.

        Returns:
            A CR for each of `ways`, not rounded; None where a way cannot say. The same question is worked out once.
        """
        key = members, processors
        if key not in self._known:
            self._known[key] = self.predict(members, processors)
        return self._known[key]


def expected_of(predictor: Predictor, members: tuple[str, ...], processors: int, costs: Sequence[int]) -> int | None:
    """Predict the CR that a compound needs, before any of it was measured.

    Args:
        predictor: what each way to predict says of it.
        members: its components, by sorted names.
        processors: virtual processors of its partition.
        costs: what each part of it reserves, in per cent of one logical processor; at least one.

    Returns:
        The whole CR with an even chance of being enough; None: no way to predict knows these members.
    """
    predictions = predictor.of(members, processors)
    if all(prediction is None for prediction in predictions):
        return None
    neediest, together = max(costs) / processors, sum(costs) / processors
    slack = slack_on(processors)
    outlook = Outlook(
        neediest=neediest,
        together=together,
        predictions=predictions,
        low=at_least(max(costs), processors),
        slack=slack,
        less=SELDOM if slack else 0.0,
    )
    return belief_of(len(predictor.ways), []).of(outlook).quantile(0.5)


def _nothing(_members: tuple[str, ...], _processors: int) -> Predictions:
    return ()


NOTHING = Predictor(ways=(), predict=_nothing)
"""No way to predict."""


def predictor_of(alone: Mapping[str, Alone]) -> Predictor:
    """Make a predictor from what is known of components alone.

    Args:
        alone: by component's name, as `alone_in` returns it.

    Returns:
        A predictor by all of `WAYS`; of a compound with another component it says None for each way.
    """

    def predict(members: tuple[str, ...], processors: int) -> Predictions:
        known = [alone[name] for name in members if name in alone]
        return predictions_of(known, processors) if len(known) == len(members) else (None,) * len(WAYS)

    return Predictor(ways=WAYS, predict=predict)
