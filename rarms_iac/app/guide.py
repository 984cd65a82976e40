"""The facts of a component's manual integration guide, from manifest and data logs."""

import shlex
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from rarms_iac.app.data_logs import measured_reservations
from rarms_iac.app.decision_logs import describe_apt
from rarms_iac.app.explain import find_component
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError
from rarms_iac.model.indexes import find_index
from rarms_iac.model.layout import PlacedPartition
from rarms_iac.model.quantities import Unit
from rarms_iac.model.run import Command
from rarms_iac.model.state import PartitionSettings
from rarms_iac.model.system import Component, RunsOn
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.reservations import MeasuredReservations, depends_on_a_log, names_of
from rarms_iac.planner.sizes import size
from rarms_iac.planner.task_classes import ClassValues, classes_of, registry_values
from rarms_iac.planner.verdicts import MeasuredTogether


@dataclass(frozen=True, slots=True, kw_only=True)
class GuideFacts:
    """The values to set by hand for one component."""

    kind: Literal["guide"] = "guide"
    component: str
    beside: tuple[str, ...]  # other components of the partition
    apt: tuple[str, ...]  # `mean_response_time at most 100 ms`
    platform: str
    settings: PartitionSettings  # of the partition
    host_lp: int
    task: str | None
    task_values: tuple[str, ...]  # `Priority = 5 (DWORD)`
    command: str  # for a shell; empty: the manifest names no program
    depends_on: str  # what the reserve comes from
    shortest_ms: float | None  # the shortest response time that a threshold allows


def guide_facts(manifest: Manifest, name: str) -> GuideFacts:
    """Return the settings to make by hand for a component, on the first host by name that can have it.

    Args:
        manifest: With its data logs next to it.

    Returns:
        Settings in the units of their tools: whole per cent, MiB.

    Raises:
        RequestError: no such component, or it runs on the host itself and has nothing to set up.
        UseCaseError: Nothing says how much it needs (negative).
    """
    system = manifest.system
    if find_component(manifest, name).runs_on is not RunsOn.PARTITION:
        raise RequestError(f"{name} runs on the host itself. Only components in a partition have a reservation.")
    reservations = measured_reservations(manifest, {})
    group = next(group for group in groups_of(system) if name in names_of(group.members))
    for _, host in sorted(system.hosts.items()):
        partition = size(group, host, reservations)
        if isinstance(partition, PlacedPartition) and group.may_run_on(host.name):
            return _facts(group, partition, reservations, manifest, system.components[name])
    planning = plan_layout(system, reservations, {}, manifest.places, explain=False)
    raise UseCaseError(Outcome.NEGATIVE, planning.findings, manifest.sources)


def _task_values(task: str | None, classes: Iterable[ClassValues]) -> tuple[str, ...]:
    """Return the values of the class in the registry, in words; every member of the partition counts for it."""
    mine = (task_class for task_class in classes if task is not None and task_class.name.lower() == task.lower())
    return tuple(
        f"{name} = {value.data} ({value.kind.value})"
        for class_values in mine
        for name, value in registry_values(class_values).items()
    )


def _facts(
    group: Group,
    partition: PlacedPartition,
    reservations: MeasuredReservations,
    manifest: Manifest,
    component: Component,
) -> GuideFacts:
    host = manifest.system.hosts[partition.host]
    log = reservations.log(group.members, host) if depends_on_a_log(group) else None
    tasks, processors = manifest.system.tasks, partition.settings.processors
    classes = classes_of(group.members, tasks, group.name, manifest.places, processors=processors).classes
    return GuideFacts(
        component=component.name,
        beside=tuple(member.name for member in group.members if member.name != component.name),
        apt=tuple(f"{index} {words}" for index, words in describe_apt(component).items()),
        platform=host.platform,
        settings=partition.settings,
        host_lp=host.logical_processors,
        task=component.task_class,
        task_values=_task_values(component.task_class, classes),
        command=_command(component),
        depends_on=f"the smallest setting of {log.path} that meets the thresholds"
        if isinstance(log, MeasuredTogether)
        else "fixed in the manifest",
        shortest_ms=_shortest(component),
    )


def _command(component: Component) -> str:
    start = None if component.run is None else component.run.start
    return shlex.join(start.words) if isinstance(start, Command) else ""


def _shortest(component: Component) -> float | None:
    times = [
        float(threshold.value)
        for name, threshold in component.apt.items()
        if (index := find_index(name)) is not None and index.unit is Unit.TIME
    ]
    return min(times, default=None)
