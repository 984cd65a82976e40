"""Thresholds that depend on what other partitions of a host do, and measurements that did not see it.

A scheduler guarantees a share over its window, not when in the window it comes. A neighbour that pauses saves up what
it reserves, and takes it at once; so an answer may come a window later than under a load that never pauses
(docs/measuring.md, "what a reservation does not promise"). Linux keeps no claim for a window.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.host import SCHEDULER_WINDOW_MS, Host, ProviderKind
from rarms_iac.model.indexes import percentile_of
from rarms_iac.model.layout import Layout, LookedUp, PlacedPartition
from rarms_iac.model.loads import is_steady
from rarms_iac.model.run import Periodic
from rarms_iac.model.system import Component, Threshold, run_of
from rarms_iac.planner import planning_findings
from rarms_iac.planner.groups import Group
from rarms_iac.planner.problem import Problem, by_name
from rarms_iac.planner.reservations import depends_on_a_log
from rarms_iac.texts.quantities import show_milliseconds


def neighbour_findings(answer: Layout, problem: Problem, places: Places) -> Iterator[Diagnostic]:
    """Report the thresholds that other partitions of the same host decide.

    Args:
        problem: what it answers, with where reservations come from.

    Yields:
        A warning for a component that was measured under steady loads alone, a note for one whose threshold depends on
            its neighbours all the same.
    """
    groups = {group.name: group for group in problem.groups}
    for host in by_name(problem.system.hosts):
        here = [each for each in answer.on(host.name) if each.settings.reserve]
        if len(here) < 2 or host.provider is ProviderKind.LINUX:
            continue
        around = _Surroundings(problem, host, len(here) - 1)
        for partition in here:
            group = groups[partition.name]
            for member in group.members:
                yield from _member_findings(member, group, partition, around, places)


@dataclass(frozen=True, slots=True)
class _Surroundings:
    """The surroundings of a component on its host."""

    problem: Problem
    host: Host
    others: int  # partitions with a reservation on the host


def _member_findings(
    member: Component, group: Group, partition: PlacedPartition, around: _Surroundings, places: Places
) -> Iterator[Diagnostic]:
    work_ms = _work_ms(member, group, partition, around)
    if work_ms is not None and work_ms * partition.settings.reserve / 100 >= SCHEDULER_WINDOW_MS:
        return  # a job that is longer than the window has seen whole windows
    latest_ms = (work_ms or 0.0) + SCHEDULER_WINDOW_MS
    limits = {name: _limit_ms(name, bound, member) for name, bound in member.apt.items()}
    tails = [name for name, limit_ms in limits.items() if limit_ms is not None and limit_ms < latest_ms]
    means = [name for name, bound in member.apt.items() if _is_periodic_mean(name, member) and bound.value < latest_ms]
    values: dict[str, Any] = {
        "component": member.name,
        "host": around.host.name,
        "other_partitions": around.others,
        "window_ms": SCHEDULER_WINDOW_MS,
        "latest_ms": latest_ms,
    }
    if depends_on_a_log(group) and _has_steady_loads(group, around) and (tails or means):
        yield _steady_loads_finding(member, (*means, *tails), work_ms, {**values, "indexes": (*means, *tails)}, places)
    elif tails:
        yield planning_findings.ON_NEIGHBOURS.at(
            places.key("components", member.name, "apt", tails[0]),
            (
                "{indexes:all} of {component} depends on the {other_partitions:other partition} on {host}. Their "
                "work within a window of {window_ms:ms} changes the measured value."
            ),
            prose("Prove the applied layout: ", command("prove"), "."),
            address=f"component/{member.name}",
            indexes=tuple(tails),
            _do="does" if around.others == 1 else "do",
            **values,
        )


def _steady_loads_finding(
    member: Component, indexes: Sequence[str], work_ms: float | None, values: dict[str, Any], places: Places
) -> Diagnostic:
    late = f"up to {SCHEDULER_WINDOW_MS} ms later than measured"
    if work_ms is not None:
        late = (
            f"{show_milliseconds(round(work_ms + SCHEDULER_WINDOW_MS))} after their due time: "
            f"{show_milliseconds(round(work_ms))} of work by its reservation, and a window of "
            f"{SCHEDULER_WINDOW_MS} ms"
        )
    return planning_findings.MEASURED_STEADY.at(
        places.key("components", member.name, "apt", indexes[0]),
        (
            "{component} was measured only under loads that never pause. If other partitions pause, its jobs may "
            "answer {_late}. This is too late for {_tails:all}."
        ),
        prose(
            "Also measure with bursts in `policy.interference` (docs/measuring.md). Then prove the applied layout: ",
            command("prove"),
            ".",
        ),
        address=f"component/{member.name}",
        _late=late,
        _tails=tuple(indexes),
        **values,
    )


def _limit_ms(index: str, threshold: Threshold, member: Component) -> float | None:
    """Return by when the latest jobs must answer; None: the index is not about them, or no limit is set."""
    if index == "deadline_miss_rate":
        deadline = run_of(member).deadline
        return None if deadline is None else float(deadline)
    if index == "success_rate":
        within = member.simulation.success_within if member.simulation else None
        return None if within is None else float(within)
    is_late = index in {"maximum_response_time", "jitter"} or percentile_of(index) is not None
    return float(threshold.value) if is_late else None


def _is_periodic_mean(index: str, member: Component) -> bool:
    """Return whether it is the mean of periodic jobs; jobs that follow one another wait for no window."""
    return index == "mean_response_time" and isinstance(run_of(member).arrival, Periodic)


def _has_steady_loads(group: Group, around: _Surroundings) -> bool:
    system = around.problem.system
    loads = system.loads_of([each.name for each in group.members])
    return all(is_steady(system.interference[load]) for load in loads)


def _work_ms(member: Component, group: Group, partition: PlacedPartition, around: _Surroundings) -> float | None:
    """Return the duration of a job by its reservation; None: it was not measured."""
    answer = around.problem.reservations.look_up(group.members, around.host)
    job_ms = answer.job_ms.get(member.name) if isinstance(answer, LookedUp) else None
    return None if job_ms is None else job_ms / (partition.settings.reserve / 100)
