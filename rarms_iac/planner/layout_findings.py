"""Findings on a layout that fits: thresholds that neighbours decide, real-time budgets, and conditions of measurements.

A scheduler guarantees a share over its window, not when in the window it comes. A neighbour that pauses saves up what
it reserves, and takes it at once. So an answer may come a window later than under a load that never pauses
(docs/measuring.md, "what a reservation does not promise"). Linux keeps no claim for a window.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

from rarms_iac.model.claims import WHOLE
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.host import SCHEDULER_WINDOW_MS, Host, ProviderKind
from rarms_iac.model.indexes import percentile_of
from rarms_iac.model.layout import Layout, LookedUp, PlacedPartition
from rarms_iac.model.loads import is_steady
from rarms_iac.model.run import Periodic
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.system import Component, Threshold, run_of
from rarms_iac.planner import planning_findings
from rarms_iac.planner.groups import Group
from rarms_iac.planner.problem import Problem, by_name
from rarms_iac.planner.reservations import depends_on_a_log
from rarms_iac.planner.task_classes import budget_percent
from rarms_iac.texts.findings import DIFFERENT
from rarms_iac.texts.messages import in_a_row
from rarms_iac.texts.quantities import show_bytes, show_milliseconds, write_bytes

MEMORY_FACTOR = 1.2
"""A partition's memory over the peak that was measured: a plan warns where it is less."""

_MEBIBYTE = 2**20

Measured = tuple[tuple[str, ...], LookedUp]
"""The names of a partition's components, and what their data logs say."""


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


def real_time_findings(answer: Layout, problem: Problem, places: Places) -> Iterator[Diagnostic]:
    """Report the budgets of hosts with control groups of version 1 that are too large together, and missing limits.

    Where real-time threads may use all of each processor, a class for threads of a program that was not written for it
    could stop the host.
    """
    groups = {group.name: group for group in problem.groups}
    for host in by_name(problem.system.hosts):
        facts = problem.seen[host.name].facts
        with_class = [
            partition
            for partition in answer.on(host.name)
            if any(member.task_class for member in groups[partition.name].members)
        ]
        budgets = {partition.name: budget_percent(partition.settings.reserve) for partition in with_class}
        admitted, needed = facts.real_time_percent, sum(budgets.values())
        if admitted is not None and needed > admitted:
            name = max(budgets, key=lambda each: (budgets[each], each))
            yield planning_findings.BUDGETS.at(
                places.key(problem.system.section_of(name), name),
                "Partitions with task classes on {host} need {_budgets} = {needed_percent} % of each processor. The "
                "kernel gives all of them {admitted_percent} % (cpu.rt_runtime_us).",
                "Lower the reserve of one partition, or remove `task` from its components.",
                address=f"partition/{name}",
                host=host.name,
                needed_percent=needed,
                admitted_percent=admitted,
                _budgets=" + ".join(f"{percent} % ({partition})" for partition, percent in budgets.items()),
            )
        if facts.deadline_percent != WHOLE:
            continue
        for partition in with_class:
            for member in groups[partition.name].members:
                if member.task_class and member.threads:
                    yield planning_findings.NEVER_STOPPED.at(
                        places.key("components", member.name, "task"),
                        (
                            "Threads of {component} get a real-time priority on {host}. The kernel lets such threads "
                            "use all of each processor (sched_rt_runtime_us)."
                        ),
                        f"Run on {host.name}: `sysctl kernel.sched_rt_runtime_us=950000`.",
                        address=f"component/{member.name}",
                        component=member.name,
                        host=host.name,
                    )


def other_governor(seen: SeenHost, measured: Sequence[Measured], places: Places) -> Iterator[Diagnostic]:
    """Report that a host sets its processors' frequency otherwise than while its components were measured.

    Args:
        measured: Of the partitions that are to run there.
    """
    now = seen.facts.governor
    others = [(names, found.governors) for names, found in measured if set(found.governors) - {now}]
    if not now or not others:
        return
    components = tuple(sorted({name for names, _ in others for name in names}))
    governors = tuple(sorted({each for _, found in others for each in found} - {now}))
    yield DIFFERENT.of_host(
        seen.name,
        "{host} uses the governor {governor}; {components:all} {_were} measured with {_measured}. Jobs may take more "
        "or less time than measured.",
        prose(
            f"Set the governor {governors[0]} on {seen.name}. Or measure again: ",
            command("measure", *components, again=True),
            ".",
        ),
        place=places.key("hosts", seen.name),
        governor=now,
        measured_with=governors,
        components=components,
        _were="was" if len(components) == 1 else "were",
        _measured=in_a_row(governors),
    )


def little_memory(names: tuple[str, ...], memory: int, found: LookedUp, places: Places) -> Iterator[Diagnostic]:
    """Report that a partition's memory is less than `MEMORY_FACTOR` times the peak that was measured.

    Args:
        memory: Of the partition, bytes.
    """
    if memory >= MEMORY_FACTOR * found.memory_peak:
        return
    enough = ceil(MEMORY_FACTOR * found.memory_peak / _MEBIBYTE) * _MEBIBYTE
    yield planning_findings.LITTLE_MEMORY.at(
        places.value("components", names[0], "memory"),
        (
            "{components:all} used up to {_peak} in the measurement, and {_have} {_memory}. The kernel ends "
            "processes at the limit."
        ),
        prose(
            f"Write `memory: {write_bytes(enough)}` or more, 1.2 times the peak. The data log is valid for the "
            "present memory only. Then measure again: ",
            command("measure", *names, together=len(names) > 1),
            ".",
        ),
        address=f"component/{names[0]}",
        components=names,
        memory_bytes=memory,
        peak_bytes=found.memory_peak,
        _have="has" if len(names) == 1 else "have together",
        _memory=show_bytes(memory, found.memory_peak),
        _peak=show_bytes(found.memory_peak, memory),
    )
