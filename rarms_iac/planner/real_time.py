"""Finds task classes that the kernel of a Linux host would refuse, or would never stop, before anything is changed."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.layout import Layout
from rarms_iac.planner.problem import Problem, by_name
from rarms_iac.planner.task_classes import budget_percent
from rarms_iac.texts.findings import Finding

BUDGETS = Finding.error("RARMS442", "Real-time budgets exceed the host")
NEVER_STOPPED = Finding.error("RARMS443", "The kernel never stops threads with a task class")

WHOLE_PERCENT = 100


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
            yield BUDGETS.at(
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
        if facts.deadline_percent != WHOLE_PERCENT:
            continue
        for partition in with_class:
            for member in groups[partition.name].members:
                if member.task_class and member.threads:
                    yield NEVER_STOPPED.at(
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
