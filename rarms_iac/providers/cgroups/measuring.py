"""Measuring on a Linux host: real components and loads, each started inside its control group."""

import json
import os
import platform
import signal
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from random import Random

from rarms_iac.model.commands import APPLY, PLAN, command, prose
from rarms_iac.model.host import Host, SchedulerType
from rarms_iac.model.loads import Interference, is_steady
from rarms_iac.model.operations import Operation, WriteTaskClass
from rarms_iac.model.plan import Scope
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.run import Elapsed
from rarms_iac.model.series import Sample
from rarms_iac.model.setting import ALL_PARTITIONS, LOAD_PARTITIONS, P1, MachineSpeed, PlatformFacts, SettingEvidence
from rarms_iac.model.state import USUAL_DEADLINE_PERCENT
from rarms_iac.model.system import Component, run_of
from rarms_iac.planner.task_classes import ClassValues, thread_rules
from rarms_iac.providers.cgroups.attach_target import AttachTarget, find_target
from rarms_iac.providers.cgroups.groups import SLICE_PERIOD_US, GroupTree
from rarms_iac.providers.cgroups.machine import ThreadLooks, consumed_ms, looking_at, read_boot
from rarms_iac.providers.cgroups.provider import STATE_FOLDER, LinuxHostProvider
from rarms_iac.providers.cgroups.speed import read_speed
from rarms_iac.providers.interface import HostFailed, HostRefused
from rarms_iac.providers.measuring import NO_RUN, Obstacle, PartitionWork, RemainingSamples, Work, running_partition
from rarms_iac.rcss import CLASSES_VARIABLE
from rarms_iac.running.component import ComponentRun, run_in_parallel, source_of
from rarms_iac.running.kernel_files import UnreadableFile, in_ms, kernel_text, whole_number
from rarms_iac.running.loads import InterferingLoad, check_load
from rarms_iac.running.orders import CannotStart, ProcessPlace, RunningError, StartContext
from rarms_iac.running.start import order_of
from rarms_iac.running.work_places import WorkPlaces
from rarms_iac.texts.messages import reason_of

MEMORY_MS = 100.0
"""How long the past influences the kernel's scheduling: its longest quota period. Its load averages, by which a group's
share is spread over the processors, halve every 32 ms. Measured on two LPs: two busy loops started next to two others
have their share within two points in each window that begins 50 ms or more after their start."""

OWN_PRIORITY = 1
"""The real-time priority (SCHED_FIFO, the lowest) of rarms and its supervisors: the load would delay them."""

MEASURE_AGAIN = "Run the same command again. Results so far are saved."
ENDLESS = Elapsed(time=Milliseconds(Fraction(10**12)))
PARENT_VARIABLE = "RARMS_CGROUP_PARENT"
"""The environment variable from which a component takes the parent of its containers' control groups."""
INTERFERENCE = "interference"
"""What messages call the load."""

PAUSE_S = (0.005, 0.03)
"""The least and the greatest pause before a load begins again: eight of them are no 5 % of a setting, which would
count as disturbed (`measuring/evidence.py`)."""
_PAUSES = Random()  # noqa: S311 - no secret

_STAT, _PRESSURE, _PROCESSORS = Path("/proc/stat"), Path("/proc/pressure/cpu"), Path("/proc/cpuinfo")
_STOLEN = 8
"""The column of `/proc/stat` with the time that the hypervisor below took (steal)."""


class LinuxMeasuringHost(LinuxHostProvider):
    """A `MeasuringHost` of real processes on this machine, in real time."""

    def __init__(
        self, host: Host, base: Path, state_folder: Path = STATE_FOLDER, tree: GroupTree | None = None
    ) -> None:
        """Prepare; nothing is read before the first call.

        Args:
            base: the manifest's folder, from which components start.
        """
        super().__init__(host, state_folder, tree)
        self._context = StartContext(base=base)

    def platform_facts(self) -> PlatformFacts:
        facts = self.observe().facts
        return PlatformFacts(
            provider=facts.provider,
            processor=_processor_model(),
            logical_processors=facts.logical_processors,
            smt=facts.smt,
            scheduler=SchedulerType.NONE,
            guest_image="",
            os_build=0,
        )

    def machine_speed(self) -> MachineSpeed:
        """Return the speed of the machine's processors now."""
        return read_speed(self._effects)

    @property
    def scheduler_memory_ms(self) -> float:
        return MEMORY_MS

    def obstacle(self, subject: Component | Interference, *, in_its_partition: bool = False) -> Obstacle | None:  # noqa: ARG002 - the protocol's
        try:
            if not isinstance(subject, Component):
                check_load(INTERFERENCE, subject, self._context)
            elif subject.run is None:
                return NO_RUN
            else:
                source_of(subject.name, subject.run, order_of(subject.name, subject.run, self._context))
                if subject.run.attach is not None:
                    with self.kernel_errors():
                        self._target(subject)
        except CannotStart as problem:
            return Obstacle(
                problem.message, problem.advice or "Install the missing programs of the component or the load."
            )
        return None

    def execute(self, operation: Operation, scope: Scope) -> None:
        """Do an operation; task classes are not written to this host, as their values go with each process."""
        if not isinstance(operation, WriteTaskClass):
            super().execute(operation, scope)

    @contextmanager
    def run(self, work: Work) -> Iterator["RealWork"]:
        groups = {
            part.partition: self._running_group(part, work.application) for part in work.partitions if part.partition
        }
        with ExitStack() as ends:
            groups |= ends.enter_context(self._holding_attached(work, groups))
            folders = {name: self.tree.place(group).groups for name, group in groups.items()}
            with self.reported():
                looked = WorkPlaces(
                    _folders(folders, (part for part in work.partitions if part.components)),
                    _folders(folders, (part for part in work.partitions if part.load is not None)),
                )
                ends.enter_context(_real_time_priority(self.name))
                loads = [
                    ends.enter_context(self._interfering_load(part.load, part, groups))
                    for part in work.partitions
                    if part.load is not None and self._gets_time(part.partition, groups)
                ]
                runs = [run for part in work.partitions for run in self._component_runs(part, groups)]
            started = time.perf_counter()
            read = ends.enter_context(run_in_parallel(runs))
            looks = {
                part.partition: ends.enter_context(looking_at(self.tree, groups[part.partition]))
                for part in work.partitions
                if part.partition and part.components
            }
            yield RealWork(
                host=self,
                work=work,
                groups=groups,
                runs=runs,
                loads=loads,
                read=read,
                started=started,
                looked=looked,
                looks=looks,
            )

    @contextmanager
    def _holding_attached(self, work: Work, groups: Mapping[str, str]) -> Iterator[Mapping[str, str]]:
        """Hold a component that runs already to what P1 reserves, and P2 to what it reserves.

        Yields:
            The group that holds it, by partition; none without such a component.
        """
        attached = {part.partition: part.components for part in work.partitions if any(map(_attached, part.components))}
        if not attached.keys() & {P1}:
            for partition, components in attached.items():
                self._refuse_elsewhere(partition, components, groups)
            yield {}
            return
        component, *others = attached[P1]
        if others:
            message = f"{component.name} is attached and can only be measured alone"
            raise HostRefused(self.name, message, "Measure its reservation, and do not combine it with others.")
        tree = self.tree
        with ExitStack() as ends, self.reported():
            target = self._target(component)
            ends.callback(self.restore_attached)
            percent, boot = tree.read(groups[P1]).shares_percent, read_boot(self._effects)
            held = self._attached.hold(target, tree, groups[P1], percent, boot)
            loads = [groups[name] for name in LOAD_PARTITIONS if name in groups]
            for load in loads if target.unit else ():  # no weight of P2 leaves anything to a group in another slice
                values = tree.read(load)
                quota = replace(values, quota_percent=values.shares_percent, period_us=SLICE_PERIOD_US)
                tree.write(load, quota)
            yield {P1: held}

    def _target(self, component: Component) -> AttachTarget:
        attached = None if component.run is None else component.run.attach
        assert attached is not None
        return find_target(component.name, attached, self.tree, self._effects)

    def _refuse_elsewhere(self, partition: str, components: Sequence[Component], groups: Mapping[str, str]) -> None:
        """Refuse an attached component that does not run in its partition."""
        with self.reported():
            inside = set(self.tree.processes(groups[partition])) if partition else set()
            for component in filter(_attached, components):
                target = self._target(component)
                if partition and not inside.intersection(self.tree.members_below(target.group)):
                    message = f"{target.title} is not running in the partition {partition}"
                    parent = self.tree.parent_of_containers(groups[partition])
                    advice = f"Start it there, with `Slice={parent}` in its unit or with `--cgroup-parent {parent}`."
                    raise HostRefused(self.name, message, advice)

    def _gets_time(self, partition: str, groups: Mapping[str, str]) -> bool:
        """Return False for a further part of P2 that reserves nothing: on a full host, its load would never start."""
        if partition not in LOAD_PARTITIONS[1:]:
            return True
        return self.tree.read(groups[partition]).shares_percent > LEAST_SHARES_PERCENT

    def _interfering_load(self, load: Interference, part: PartitionWork, groups: Mapping[str, str]) -> InterferingLoad:
        group = groups.get(part.partition)
        reserve = None if group is None else self.tree.read(group).shares_percent / self._processors
        return InterferingLoad(
            INTERFERENCE, load, replace(self._context, inside=self._place(part, group)), reserve=reserve
        )

    @contextmanager
    def reported(self) -> Iterator[None]:
        """Raise what goes wrong with processes and files of the kernel as `HostRefused` or `HostFailed`."""
        with self.kernel_errors(advice=MEASURE_AGAIN):
            try:
                yield
            except CannotStart as problem:
                advice = prose("Run the component alone: ", command("run", "COMPONENT"), ".")
                raise HostRefused(self.name, f"{problem}", problem.advice or advice) from problem
            except RunningError as problem:
                raise HostFailed(self.name, f"{problem}", MEASURE_AGAIN) from problem

    def _component_runs(self, part: PartitionWork, groups: Mapping[str, str]) -> Iterator[ComponentRun]:
        """Yield the components of a partition. They run until the work ends; the caller judges their failures."""
        for component in part.components:
            run = replace(run_of(component), until=ENDLESS, failures=10**9)
            group = groups.get(part.partition)
            context = replace(self._context, inside=self._place(part, group, component))
            yield ComponentRun(component.name, run, context)

    def _command_prefix(self, component: Component, part: PartitionWork, group: str | None) -> tuple[str, ...]:
        """Return the words before a component's command: `chrt` or `taskset` for its deadline or its task class.

        Raises:
            HostRefused: the kernel would refuse the deadline.
        """
        if part.deadline_period_us is None or group is None:
            return class_words(component, part.classes)
        values = self.tree.read(group)
        if values.shares_percent <= LEAST_SHARES_PERCENT:
            return class_words(component, part.classes)
        if values.processors is not None:
            message = f"{part.partition} has {len(values.processors)} of {self._processors} processors. The "
            message += "kernel refuses SCHED_DEADLINE to a thread that may not run on all processors"
            raise HostRefused(
                self.name,
                message,
                prose("Another tool changed cpuset.cpus of its group: ", PLAN, " shows it, ", APPLY, " restores it."),
            )
        return deadline_words(values.shares_percent, part.deadline_period_us)

    def _place(self, part: PartitionWork, group: str | None, component: Component | None = None) -> ProcessPlace:
        place = ProcessPlace() if group is None else self.tree.place(group)
        if component is not None and _attached(component):
            return place  # it has its place: only its groups are looked at
        words = () if component is None or component.threads else self._command_prefix(component, part, group)
        parent = "" if group is None else self.tree.parent_of_containers(group)
        environment = class_environment(part) | ({PARENT_VARIABLE: parent} if parent else {})
        threads = () if component is None else thread_rules(component, part.classes)
        if threads:
            self._refuse_endless_real_time(component.name if component else "")
        return replace(place, priority=words, parent=parent, environment=environment, threads=threads)

    def _refuse_endless_real_time(self, component: str) -> None:
        """Refuse priorities of threads where the kernel never stops a thread that has one.

        Raises:
            HostRefused: real-time threads may use all of each processor.
        """
        if self.facts.deadline_percent == WHOLE:
            message = f"{component} gives real-time priorities to threads of another program, and "
            message += "the kernel never stops such threads (sched_rt_runtime_us)"
            raise HostRefused(self.name, message, "Set a limit: `sysctl kernel.sched_rt_runtime_us=950000`.")

    def place(self, part: PartitionWork, application: str) -> ProcessPlace:
        """Return the place of a component's processes: the control group of its partition, its task class.

        Args:
            part: the partition's name in the manifest, empty for the host itself, one component, and the task classes
                of all members.

        Raises:
            HostRefused: the partition is not there or does not run.
        """
        (component,) = part.components
        with self.reported():
            group = self._running_group(part, application) if part.partition else None
            return self._place(part, group, component)

    def _running_group(self, part: PartitionWork, application: str) -> str:
        """Return the control group of a running partition; where it has task classes, give it their budget."""
        partition = part.partition
        state, definitions = self._look()
        running = running_partition(state, partition, application)
        group = definitions[running.id].group
        if part.classes:
            with self.kernel_errors():
                try:
                    self.tree.allow_real_time(group, running.settings.reserve)
                except OSError as problem:
                    message = f"{partition} does not get a real-time budget for its task classes: {reason_of(problem)}"
                    advice = "Lower cpu.rt_runtime_us of other control groups."
                    raise HostRefused(self.name, message, advice) from problem
        return group


WHOLE = 100
"""The part of each processor, in per cent, that real-time threads have where `sched_rt_runtime_us` is -1."""


def _attached(component: Component) -> bool:
    return component.run is not None and component.run.attach is not None


LEAST_SHARES_PERCENT = 1.0
"""The shares of a group without reservation: the kernel has no weight of 0."""


def deadline_words(reserved_percent: float, period_us: int) -> tuple[str, ...]:
    """Return the `chrt` command that gives a component's first thread its time in each period, before other threads.

    Threads that it makes are ordinary ones (the kernel lets no other be made): they have their group's share.

    Args:
        reserved_percent: of one logical processor, as the group has it.
        period_us: of SCHED_DEADLINE, its deadline too.
    """
    period = period_us * 1000
    runtime = round(min(reserved_percent, USUAL_DEADLINE_PERCENT) * period / 100)
    values = ("--sched-runtime", str(runtime), "--sched-deadline", str(period), "--sched-period", str(period))
    return ("chrt", "--reset-on-fork", "--deadline", *values, "0")


def class_words(component: Component, classes: Iterable[ClassValues]) -> tuple[str, ...]:
    """Return the command before a component's own: it sets the real-time priority and processors of its task class.

    Args:
        component: its `task` names the class, in any case.
        classes: as the planner decided them for the partition.
    """
    for values in classes:
        if component.task_class is not None and values.name.lower() == component.task_class.lower():
            words = ("chrt", "--fifo", str(values.thread_priority))
            return ("taskset", f"{values.affinity:x}", *words) if values.affinity else words
    return ()


def class_environment(part: PartitionWork) -> dict[str, str]:
    """Return the environment variable from which `rcss` reads a partition's task classes.

    Returns:
        Empty without task classes, and where components have deadlines: the kernel allows no priority with these.
    """
    if not part.classes or part.deadline_period_us is not None:
        return {}
    known = {values.name: {"priority": values.thread_priority, "affinity": values.affinity} for values in part.classes}
    return {CLASSES_VARIABLE: json.dumps(known)}


@dataclass(slots=True, kw_only=True)
class RealWork:
    """A `RunningWork` of processes; times are those of `time.perf_counter`."""

    host: LinuxMeasuringHost
    work: Work
    groups: Mapping[str, str]  # by partition
    runs: Sequence[ComponentRun]
    loads: Sequence[InterferingLoad]
    read: Iterator[tuple[str, Sample]]
    started: float
    looked: WorkPlaces  # where processes work, since before the components started
    looks: Mapping[str, ThreadLooks] = field(default_factory=dict)  # by partition that runs components
    _under_way_ms: dict[str, float] = field(default_factory=dict)  # by component, how long a job was
    _remaining: RemainingSamples = field(init=False)
    _before: SettingEvidence = field(default_factory=SettingEvidence)  # the host's counters when samples began to count
    _group_alone: dict[str, tuple[str, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for part in self.work.partitions:
            if part.partition and len(part.components) == 1 and part.load is None:
                group = self.groups[part.partition]
                with self.host.reported():
                    self._group_alone[part.components[0].name] = group, self.host.tree.cpu_ms(group)

    def samples(self) -> Iterator[tuple[str, Sample]]:
        runs = {run.component: run for run in self.runs}
        self.count_from_now()
        with self.host.reported():
            for name, sample in self.read:
                for load in self.loads:
                    load.check()
                self._remaining.take(name)
                took_ms = sample.response_ms or 0.0
                self._under_way_ms[name] = min(self.elapsed_ms(), self._under_way_ms.get(name, 0.0) + took_ms)
                yield name, replace(sample, began_ms=sample.began_ms + 1000 * (runs[name].began - self.started))
                if self._remaining.are_over(self.elapsed_ms()):
                    return

    def count_from_now(self) -> None:
        self._remaining = RemainingSamples(self.work, self.elapsed_ms())
        self._before = self._counters()
        self._under_way_ms = {}
        for looks in self.looks.values():
            looks.forget()

    def restart_load(self) -> bool:
        """Stop its processes for a short random time: the kernel then knows nothing of how they ran before."""
        parts = [part for part in self.work.partitions if part.load is not None and is_steady(part.load)]
        groups = [self.groups[part.partition] for part in parts if part.partition]
        with self.host.reported():
            processes = [process for group in groups for process in self.host.tree.processes(group)]
        if not processes:
            return False
        try:
            _signal(processes, signal.SIGSTOP)
            time.sleep(_PAUSES.uniform(*PAUSE_S))
        finally:
            _signal(processes, signal.SIGCONT)
        return True

    def elapsed_ms(self) -> float:
        return 1000 * (time.perf_counter() - self.started)

    def cpu_ms(self, component: str) -> float | None:
        """Return the time of the group if the component is alone in it, else of its processes, in clock ticks."""
        with self.host.reported():
            if component in self._group_alone:
                group, before = self._group_alone[component]
                return self.host.tree.cpu_ms(group) - before
            process = next((run.process for run in self.runs if run.component == component and run.has_own_time), None)
            return None if process is None else consumed_ms(process)

    def used_processors(self, partition: str) -> int | None:
        """Count by looks at the group's threads."""
        members = [
            member.name for part in self.work.partitions if part.partition == partition for member in part.components
        ]
        under_way_ms = max((self._under_way_ms.get(name, 0.0) for name in members), default=0.0)
        with self.host.reported():
            return self.looks[partition].most(under_way_ms) if partition in self.looks and under_way_ms else None

    def evidence(self) -> SettingEvidence:
        skipped = {run.component: run.skipped for run in self.runs if run.skipped.count}
        with self.host.reported():
            places, counted = [run.place for run in self.runs], self._counters().since(self._before)
            self.looked.look(places)
            return replace(
                counted,
                skipped_lines=skipped,
                messages={run.component: heard for run in self.runs if (heard := run.heard)},
                outside=self.looked.outside(places, self.elapsed_ms()),
                others=self.looked.others(self.elapsed_ms(), counted.elapsed_ms),
                memory_peak=None if P1 not in self.looks else self.looks[P1].memory_peak,
                out_of_memory={run.component: killed for run in self.runs if (killed := run.killed_for_memory)},
                threads={run.component: run.threads for run in self.runs if not run.threads.is_fine},
            )

    def _counters(self) -> SettingEvidence:
        """Return the kernel's counts until now."""
        with self.host.reported():
            return SettingEvidence(
                elapsed_ms=self.elapsed_ms(),
                cpu_ms={name: self.host.tree.cpu_ms(group) for name, group in self.groups.items()},
                throttled_ms={
                    name: self.host.tree.throttled_ms(group)
                    for name, group in {**self.groups, ALL_PARTITIONS: ""}.items()
                },
                stolen_ms=_stolen_ms(),
                speeds=(self.host.machine_speed(),),
                waiting_ms=_waiting_ms(),
            )


@contextmanager
def _real_time_priority(host: str) -> Iterator[None]:
    """Give this thread, and the threads and supervisors that it starts, a real-time priority.

    The load's slice has the highest weight: without the priority rarms would read samples up to a second late.

    Raises:
        HostRefused: this process may not take the priority.
    """
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(OWN_PRIORITY))
    except PermissionError as problem:
        raise HostRefused(
            host,
            "rarms may not set its real-time priority; without this priority, the load delays its clock",
            "Run rarms as root. Under control groups v1, also use a group with cpu.rt_runtime_us.",
        ) from problem
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)


def _signal(processes: Iterable[int], number: signal.Signals) -> None:
    for process in processes:
        with suppress(ProcessLookupError):
            os.kill(process, number)


def _folders(folders: Mapping[str, Sequence[Path]], parts: Iterable[PartitionWork]) -> list[Path]:
    return [folder for part in parts for folder in folders.get(part.partition, ())]


def _stolen_ms() -> float:
    """Return the time, of all processors, that the hypervisor below took since the machine's start."""
    words = (text := kernel_text(_STAT)).partition("\n")[0].split()
    if len(words) <= _STOLEN:
        raise UnreadableFile(_STAT, text, f"{_STOLEN} times of all processors")
    return in_ms(whole_number(_STAT, words[_STOLEN]))


def _waiting_ms() -> float | None:
    """Return the time of waiting for a processor (PSI) since the machine's start; None: not counted here."""
    line = kernel_text(_PRESSURE).partition("\n")[0]
    return whole_number(_PRESSURE, line.rpartition("total=")[2]) / 1000 if line.startswith("some") else None


def _processor_model() -> str:
    lines = (line.partition(":") for line in kernel_text(_PROCESSORS).splitlines())
    return next((value.strip() for name, _, value in lines if name.strip() == "model name"), platform.machine())
