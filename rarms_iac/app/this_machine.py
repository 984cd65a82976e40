"""What is done on this machine: a component's place in its partition and task class, and the start of partitions."""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from rarms_iac.app.hosts import host_errors
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.wiring import place_on, start_after_boot
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.run import Call
from rarms_iac.model.system import Component, RunsOn
from rarms_iac.planner.groups import groups_of
from rarms_iac.planner.mechanism import deadline_period_us
from rarms_iac.planner.task_classes import classes_of
from rarms_iac.providers.interface import HostError
from rarms_iac.providers.measuring import PartitionWork
from rarms_iac.rcss import CannotJoin, robotic_task
from rarms_iac.running.orders import ProcessPlace
from rarms_iac.storage.writing import owner


def find_place(manifest: Manifest, component: Component, report: Callable[[str], None]) -> ProcessPlace:
    """Find the partition and the task class of a component on this machine.

    Args:
        manifest: Without a Linux host it has no partition for processes of this machine.
        report: Hears in words where the component is about to run; a component that nothing could reserve for has none.

    Returns:
        Its place; without a partition here, with everything else.
    """
    if sys.platform == "win32":
        return _task_of(component, report)
    if component.run is not None and component.run.attach is not None:
        report(f"{component.name} is already running. rarms reads its samples and does not change it.")
        return ProcessPlace()
    system, reasons = manifest.system, []
    group = next((group for group in groups_of(system) if component in group.members), None)
    hosts = [host for host in system.hosts.values() if host.provider is ProviderKind.LINUX and host.connect is None]
    if not hosts:
        return ProcessPlace()
    name = group.name if group else ""
    members = (
        group.members if group else [other for other in system.components.values() if other.runs_on is RunsOn.HOST]
    )
    classes = classes_of(members, system.tasks, name, manifest.places).classes
    for host in hosts:
        period = deadline_period_us(group, host) if group else None
        part = PartitionWork(partition=name, components=(component,), classes=classes, deadline_period_us=period)
        try:
            place = place_on(host, part, system.application.name)
        except HostError as problem:
            reasons.append(str(problem))
            continue
        words = (*place.words, *place.priority)
        rules = [f"threads {rule.pattern} at priority {rule.priority}" for rule in place.threads]
        told = ", ".join([" ".join(words)] * bool(words) + rules)
        task = f" ({told})" if told else ""
        inside = f"in its partition {name} on {host.name}" if group else f"on {host.name} itself"
        report(f"{component.name} runs {inside}{task}.")
        return place
    report(f"{component.name} runs without a reservation: {'; '.join(reasons)}.")
    return ProcessPlace()


def _task_of(component: Component, report: Callable[[str], None]) -> ProcessPlace:
    """Return the task class for the runner's own thread on Windows, where it can be joined.

    Other threads have to ask.
    """
    task = component.task_class
    if task is None:
        return ProcessPlace()
    if component.run is None or not isinstance(component.run.start, Call):
        report(f"{component.name} is a command: its own code must join {task} with one call, see docs/task-classes.md.")
        return ProcessPlace()
    try:
        with robotic_task(task):
            report(f"{component.name} runs in the task class {task}.")
    except CannotJoin as problem:
        report(f"{component.name} runs without its task class: {problem}")
        return ProcessPlace()
    return ProcessPlace(task=task)


@dataclass(frozen=True, slots=True, kw_only=True)
class StartedPartitions:
    """The partitions of this machine that were started, by slice."""

    started: Mapping[str, tuple[str, ...]]
    kind: Literal["started"] = "started"


def start_partitions_after_boot(timeout_ms: int) -> StartedPartitions:
    """Start what is off on this machine, a Linux host, though no run stopped it. No manifest is read.

    Args:
        timeout_ms: how long to wait for each slice that another run holds; 0: not at all.

    Returns:
        What was started; where rarms keeps nothing, there is nothing.

    Raises:
        UseCaseError: another run holds a slice (refused), or a partition does not start (failed).
    """
    with host_errors():
        return StartedPartitions(started=start_after_boot(owner(), timeout_ms))
