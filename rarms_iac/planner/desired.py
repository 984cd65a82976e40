"""The desired State of one host: its partitions and task classes, with their marks."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from rarms_iac.model.claims import CoreSharing
from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.model.layout import Layout, PlacedPartition
from rarms_iac.model.names import is_shipped_task, renaming
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import (
    ID_DIGITS,
    NO_GENERATION,
    Mark,
    Partition,
    PartitionSettings,
    RegistryValue,
    Responsiveness,
    RunState,
    StartAction,
    State,
    StoppedBy,
    TaskClass,
    TaskRecord,
    ValueKind,
)
from rarms_iac.model.system import Application, Disruption, System, Unused
from rarms_iac.planner.groups import unnamed_partitions
from rarms_iac.planner.task_classes import ClassValues, classes_of, registry_values, thread_rules
from rarms_iac.running.thread_priorities import rules_text
from rarms_iac.storage.marks import set_of_settings, set_of_values


@dataclass(frozen=True, slots=True, kw_only=True)
class Desired:
    """One host as it is and as it is to be, which is what is compared; and what else was decided about it."""

    seen: SeenHost
    state: State  # as it is to be
    layout: Layout | None = None  # of all hosts; None: nothing is laid out, as where everything is removed
    unnamed: frozenset[str] = frozenset()  # partitions of ours that the manifest no longer names
    unused: frozenset[str] = frozenset()  # those of them that are in `state`, stopped
    classes: Mapping[tuple[str, str], ClassValues] = field(default_factory=dict)  # by partition (empty: the host), name
    by_hand: tuple[TaskClass, ...] = ()  # wanted in guests that could not be looked into: in no state, so no change
    findings: tuple[Diagnostic, ...] = ()

    @property
    def host(self) -> str:
        """The host's name in the manifest."""
        return self.seen.name

    @property
    def partitions(self) -> tuple[PlacedPartition, ...]:
        """The partitions that the layout places here, by name."""
        return self.layout.on(self.host) if self.layout else ()


def desired_state(system: System, layout: Layout, seen: SeenHost, places: Places, limit: Disruption) -> Desired:
    """Work out the state that one host is to have, and what else the difference must know.

    A partition with our mark that is placed on no host is removed where it holds nothing that could be lost, or where
    the policy and the limit allow it. Otherwise it is kept, stopped, with its automatic start off: it is unused. A
    partition that is placed on another host is not in this state, and so it is removed here.

    Args:
        places: lines of the manifest, for the findings.
        limit: the most that a change may disrupt.

    Returns:
        The wanted state with partitions and task classes in the order of their names, and findings about task classes.
    """
    observed, there = seen.state, seen.present
    here = layout.on(seen.name)
    current = _current_names(there, {partition.name for partition in here}, system.moved)
    unnamed = unnamed_partitions({partition.name for partition in layout.partitions}, system.moved, there.values())
    may_remove = system.policy.unused is Unused.REMOVE and limit is Disruption.REMOVAL
    unused = [there[name] for name in sorted(unnamed) if not (may_remove or observed.holds_nothing(there[name].id))]
    wanted = [_wanted(partition, there.get(current.get(partition.name, "")), system, places) for partition in here]
    found, values, problems = _tasks(system, layout, observed, current, places)
    tasks = sorted(found, key=lambda task_class: (task_class.inside, task_class.name))
    unseen = _unseen_guests(tasks, observed, current)
    return Desired(
        seen=seen,
        layout=layout,
        state=State(
            facts=observed.facts,
            partitions=tuple(
                sorted([*wanted, *map(_stopped_unwanted, unused)], key=lambda partition: partition.settings.name)
            ),
            tasks=tuple(task for task in tasks if task.inside not in unseen),
            serials=observed.serials,
            responsiveness=_responsiveness(seen.host, observed, system.application),
        ),
        unused=frozenset(partition.mark.name for partition in unused if partition.mark),
        unnamed=unnamed,
        classes=values,
        by_hand=tuple(task for task in tasks if task.inside in unseen),
        findings=problems,
    )


def _unseen_guests(tasks: Iterable[TaskClass], observed: State, current: Mapping[str, str]) -> frozenset[str]:
    """Return the partitions of these classes whose guests were not looked into; a simulated host shows them all.

    Every Windows has task classes, so a guest of a Hyper-V host of which none is known was not looked into.
    """
    if observed.facts.provider is not ProviderKind.HYPERV:
        return frozenset()
    seen = {task.inside for task in observed.tasks}
    return frozenset(task.inside for task in tasks if task.inside and current.get(task.inside, "") not in seen - {""})


def _current_names(there: Collection[str], here: Collection[str], moved: Mapping[str, str]) -> Mapping[str, str]:
    """Return the present name on the host of each wanted partition, after the manifest's moves.

    Only partitions that are there have an entry.
    """
    return {new: old for old, new in renaming(there, here, moved).new.items() if new in here}


def _wanted(partition: PlacedPartition, there: Partition | None, system: System, places: Places) -> Partition:
    stopped_by = there.mark.stopped_by if there is not None and there.mark else StoppedBy.NO_USER
    runs_or_is_wanted_again = there is not None and (there.settings.running or stopped_by is StoppedBy.MEASUREMENT)
    stays = _machine_that_stays(partition.settings, there)
    settings = replace(
        partition.settings,
        running=partition.settings.running or runs_or_is_wanted_again,
        secure_boot=partition.settings.secure_boot if stays is None or stays.settings.secure_boot else "",
        threads=_threads(partition, system, places),
    )
    request, application = system.partitions.get(partition.name), system.application.name
    mark = Mark(
        application=application,
        robot=system.application.robot,
        name=partition.name,
        machine="",
        set="",
        protected=request is not None and request.protect,
    )
    wanted = _marked(settings, mark, there, partition.sharing)
    stays_stopped = stopped_by is StoppedBy.USER and there is not None and not there.settings.running
    return _stopped(wanted) if stays_stopped else wanted


def _threads(partition: PlacedPartition, system: System, places: Places) -> str:
    """Return the priorities of threads in a control group; MMCSS of Windows has none by name."""
    members = [system.components[name] for name in partition.components]
    if partition.settings.generation != NO_GENERATION or not any(member.threads for member in members):
        return ""
    classes = classes_of(members, system.tasks, partition.name, places).classes
    return rules_text(rule for member in members for rule in thread_rules(member, classes))


def _stopped(wanted: Partition) -> Partition:
    """Return a partition that `rarms stop` stopped.

    It is as wanted, but does not run; its digest does not tell that.
    """
    assert wanted.mark is not None
    return replace(
        wanted,
        settings=replace(wanted.settings, running=False),
        state=RunState.OFF,
        mark=replace(wanted.mark, stopped_by=StoppedBy.USER),
    )


def _stopped_unwanted(there: Partition) -> Partition:
    """Return a partition that the manifest no longer wants: as it is, but stopped, and not started with its host."""
    assert there.mark is not None
    name = there.mark.name
    settings = replace(there.settings, name=name, running=False, start_action=StartAction.NOTHING, secure_boot="")
    return _marked(settings, replace(there.mark, stopped_by=StoppedBy.NO_USER), there, there.sharing)


def _marked(settings: PartitionSettings, mark: Mark, there: Partition | None, sharing: CoreSharing) -> Partition:
    """Return the partition with these settings; its mark says them, and the machine that is there."""
    machine = there.id if there else ""
    stays = _machine_that_stays(settings, there)
    live = stays.settings.secure_boot if stays else ""
    return Partition(
        # Where it is not fixed, it is left as it is, and no part of what the mark says.
        settings=replace(settings, secure_boot=settings.secure_boot or live),
        id=machine,
        state=RunState.RUNNING if settings.running else RunState.OFF,
        mark=replace(mark, machine=machine[:ID_DIGITS], set=set_of_settings(settings)),
        sharing=there.sharing if there else sharing,
    )


def _machine_that_stays(settings: PartitionSettings, there: Partition | None) -> Partition | None:
    """Return the machine that is there, unless another generation makes it again."""
    return there if there is not None and there.settings.generation == settings.generation else None


def _tasks(
    system: System, layout: Layout, observed: State, current: Mapping[str, str], places: Places
) -> tuple[list[TaskClass], dict[tuple[str, str], ClassValues], tuple[Diagnostic, ...]]:
    """Return the classes of every operating system of this host that has components."""
    tasks: list[TaskClass] = []
    decided: dict[tuple[str, str], ClassValues] = {}
    problems: list[Diagnostic] = []
    if observed.facts.provider is ProviderKind.LINUX:
        return tasks, decided, ()  # MMCSS is of Windows; on Linux classes are scheduling parameters of threads
    # The host's own Windows may have fewer processors than the machine (minroot), so none of its are named.
    processors = {partition.name: partition.settings.processors for partition in layout.on(observed.facts.name)}
    for inside, members in _systems(layout, observed.facts.name):
        users = [system.components[name] for name in members]
        found = classes_of(users, system.tasks, inside, places, processors=processors.get(inside, 0))
        problems += found.findings
        for values in found.classes:
            decided[inside, values.name] = values
            there = _task_there(observed, current.get(inside, inside), values.name)
            tasks.append(_task(values, inside, there, system.application))
    return tasks, decided, tuple(problems)


def _responsiveness(host: Host, observed: State, application: Application) -> Responsiveness | None:
    """Return the manifest's settings of the host's own Windows, with the values from before rarms."""
    if host.system_responsiveness is None or host.provider is ProviderKind.LINUX:
        return None
    wanted = Responsiveness(value=RegistryValue(kind=ValueKind.DWORD, data=host.system_responsiveness))
    there = observed.responsiveness or Responsiveness()
    return replace(wanted, record=_record(there, application, wanted.values))


def _systems(layout: Layout, host: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield operating systems with the components whose threads run there; the host's own has an empty name."""
    yield "", tuple(name for name, place in layout.on_hosts if place == host)
    for partition in layout.on(host):
        yield partition.name, partition.components


def _task_there(observed: State, inside: str, name: str) -> TaskClass | None:
    found = [task for task in observed.tasks if task.inside == inside and task.name.lower() == name.lower()]
    return found[0] if found else None


def _task(values: ClassValues, inside: str, there: TaskClass | None, application: Application) -> TaskClass:
    wanted = registry_values(values)
    return TaskClass(
        name=there.name if there and is_shipped_task(there.name) else values.name,
        inside=inside,
        values=wanted,
        record=_record(there, application, wanted),
        machine=there.machine if there else "",
    )


def _record(
    there: TaskClass | Responsiveness | None, application: Application, wanted: Mapping[str, RegistryValue]
) -> TaskRecord:
    """Return the record of what rarms writes: what was there before is kept once, by the application's first record."""
    before = (there.values if there else None) or None
    if there and there.record and there.record.application == application.name:
        before = there.record.before
    return TaskRecord(application=application.name, robot=application.robot, set=set_of_values(wanted), before=before)
