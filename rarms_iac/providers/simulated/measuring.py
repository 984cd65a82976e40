"""The simulated host as one that is measured on: what is on it becomes a machine of the scheduler model, which runs.

Partitions that run and were given nothing to do are idle; what they reserve stays reserved.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, assert_never, runtime_checkable

from rarms_iac.model.commands import command, prose
from rarms_iac.model.host import Host
from rarms_iac.model.loads import Browser, Bursts, BusyLoop, CommandLoad, Interference, Stress
from rarms_iac.model.mmcss import thread_priority
from rarms_iac.model.run import Periodic
from rarms_iac.model.series import Sample
from rarms_iac.model.setting import PlatformFacts
from rarms_iac.model.state import RegistryValue, ValueKind
from rarms_iac.model.system import Component, TaskCategory, run_of
from rarms_iac.providers.interface import HostRefused
from rarms_iac.providers.measuring import Obstacle, PartitionWork, RemainingSamples, Work, running_partition
from rarms_iac.providers.simulated.content import Content, SimulatedMachine
from rarms_iac.providers.simulated.provider import SimulatedHostProvider
from rarms_iac.providers.simulated.scheduling.machine import (
    ORDINARY,
    QUIET_INTERRUPTS,
    WINDOW_MS,
    BurstLoads,
    JobDemand,
    JobDone,
    ModelLoad,
    ModelMachine,
    VirtualMachine,
)

PROCESSOR = "simulated"
"""A simulated host's name for its processors."""

GUEST = "Windows build {build}"
MEBIBYTE = 2**20


def demand_of(component: Component, priority: int = ORDINARY) -> JobDemand:
    """Return the demand of a component that has a `simulation`; its threads run at this priority."""
    simulation, arrival = component.simulation, run_of(component).arrival
    assert simulation is not None, "`obstacle` names a component without one before anything is run"
    return JobDemand(
        component=component.name,
        work_ms=float(simulation.work),
        blocked_ms=float(simulation.blocked),
        varies=float(simulation.varies),
        threads=simulation.threads,
        period_ms=float(arrival.period) if isinstance(arrival, Periodic) else None,
        success_within_ms=None if simulation.success_within is None else float(simulation.success_within),
        timeout_ms=float(run_of(component).timeout),
        priority=priority,
    )


def model_load(interference: Interference, reserve: int = 0) -> ModelLoad:
    """Return the load that interferes, where its partition reserves so many per cent of each of its processors.

    Of another program nothing is known, so it is taken for one that never waits.
    """
    match interference:
        case Bursts(threads=threads):
            cycle = interference.cycle(reserve)
            return BurstLoads(burst_ms=cycle.burst_ms, gap_ms=cycle.gap_ms, threads=threads)
        case BusyLoop() | Browser():
            return interference
        case CommandLoad(instances=threads) | Stress(workers=threads):
            return BusyLoop(threads=threads)
        case _:
            assert_never(interference)


Simulate = Callable[[ModelMachine, int], Iterator[JobDone]]
"""Runs a machine of the scheduler model from a seed: its jobs in the order in which they end, without an end."""


@runtime_checkable
class ObservableJobs(Protocol):
    """Jobs of a machine that can be looked into, and whose loads can begin again, while it runs."""

    def restart_loads(self) -> bool:
        """Start every load that never pauses again; False: there is none."""

    def used_processors(self, machine: str) -> int:
        """Return the most threads of the machine's components that ran, or waited for a processor, at once."""


class SimulatedMeasuringHost(SimulatedHostProvider):
    """A `MeasuringHost` that needs nothing installed: time passes in the scheduler model only."""

    def __init__(self, host: Host, path: Path, simulate: Simulate) -> None:
        super().__init__(host, path)
        self._simulate = simulate

    def platform_facts(self) -> PlatformFacts:
        described = self._host.simulated
        return PlatformFacts(
            provider=self._host.provider,
            processor=PROCESSOR,
            logical_processors=self._host.logical_processors,
            smt=described.smt,
            scheduler=described.scheduler_type,
            guest_image=GUEST.format(build=described.guest_windows_build),
            os_build=described.windows_build,
        )

    @property
    def scheduler_memory_ms(self) -> float:
        """Return the window over which a reserve is guaranteed and unused claim is kept."""
        return WINDOW_MS

    def obstacle(self, subject: Component | Interference, *, in_its_partition: bool = False) -> Obstacle | None:  # noqa: ARG002 - the protocol's
        if not isinstance(subject, Component) or subject.simulation is not None:
            return None
        return Obstacle(
            "its demand on a simulated host is not set",
            prose(
                "Add `simulation: { work: 20 ms }`, or measure on a real host: ",
                command("run", "COMPONENT"),
                " tries it.",
            ),
        )

    @contextmanager
    def run(self, work: Work) -> Iterator["SimulatedRun"]:
        content = self.load()
        machines = tuple(self._machine(content, partition, work.application) for partition in work.partitions)
        idle = self._idle(content, work)
        machine = ModelMachine(
            lps=self._host.logical_processors, machines=(*machines, *idle), interrupts=QUIET_INTERRUPTS
        )
        jobs = self._simulate(machine, work.seed)
        yield SimulatedRun(jobs=jobs, work=work)

    def _machine(self, content: Content, partition_work: PartitionWork, application: str) -> VirtualMachine:
        """Return one operating system of the work, with what the host's file says of its partition."""
        load = partition_work.load
        if not partition_work.partition:
            return VirtualMachine(
                name=self.name,
                vps=self._host.logical_processors,
                components=tuple(self._demand(component, content, "") for component in partition_work.components),
                loads=() if load is None else (model_load(load),),
                partitioned=False,
            )
        machine = self._running(content, partition_work.partition, application)
        loads = () if load is None else (model_load(load, machine.settings.reserve),)
        demands = tuple(self._demand(component, content, machine.id) for component in partition_work.components)
        return _partition(machine, partition_work.partition, components=demands, loads=loads)

    def _running(self, content: Content, partition: str, application: str) -> SimulatedMachine:
        return content.machines[running_partition(self._state(content), partition, application).id]

    def _idle(self, content: Content, work: Work) -> tuple[VirtualMachine, ...]:
        """Return the other running machines: they do nothing, and keep what they reserve."""
        names = [work_there.partition for work_there in work.partitions if work_there.partition]
        busy = {self._running(content, name, work.application).id for name in names}
        others = [
            machine for machine in content.machines.values() if machine.settings.running and machine.id not in busy
        ]
        return tuple(_partition(other, f"idle {other.id}") for other in sorted(others, key=lambda other: other.id))

    def _demand(self, component: Component, content: Content, machine: str) -> JobDemand:
        if obstacle := self.obstacle(component):
            raise HostRefused(self.name, f"{component.name}: {obstacle.reason}", obstacle.advice)
        return demand_of(component, _priority(component.task_class, content, machine))


@dataclass(slots=True, kw_only=True)
class SimulatedRun:
    """A `Running` whose time is the model's."""

    jobs: Iterator[JobDone]
    work: Work
    _now: float = 0.0
    _remaining: RemainingSamples = field(init=False)
    _consumed: dict[str, float] = field(default_factory=dict)

    def samples(self) -> Iterator[tuple[str, Sample]]:
        self.count_from_now()
        runs = {member.name: run_of(member) for part in self.work.partitions for member in part.components}
        while not self._remaining.are_over(self._now):
            job = next(self.jobs)
            self._now = max(self._now, job.began + job.response)
            self._consumed[job.component] = job.cpu
            self._remaining.take(job.component)
            yield job.component, _sample(job, float(runs[job.component].timeout))

    def count_from_now(self) -> None:
        self._remaining = RemainingSamples(self.work, self._now)

    def restart_load(self) -> bool:
        return isinstance(self.jobs, ObservableJobs) and self.jobs.restart_loads()

    def elapsed_ms(self) -> float:
        return self._now

    def cpu_ms(self, component: str) -> float | None:
        """Return the time up to the component's last job that ended."""
        return self._consumed.get(component, 0.0)

    def used_processors(self, partition: str) -> int | None:
        """Return the exact number: the model counts at each moment."""
        return self.jobs.used_processors(partition) if isinstance(self.jobs, ObservableJobs) else None

    def evidence(self) -> None:
        """Return None: nothing disturbs a model."""


def _partition(
    machine: SimulatedMachine,
    name: str,
    *,
    components: tuple[JobDemand, ...] = (),
    loads: tuple[ModelLoad, ...] = (),
) -> VirtualMachine:
    """Return a partition of the model under this name, by which chance is drawn: its id changes with each making."""
    settings = machine.settings
    return VirtualMachine(
        name=name,
        vps=settings.processors,
        reserve=settings.reserve,
        limit=settings.limit,
        weight=settings.weight,
        memory_mib=settings.memory / MEBIBYTE,
        components=components,
        loads=loads,
    )


def _sample(job: JobDone, timeout: float) -> Sample:
    """Return the sample of a job; one that its component's `timeout` ended has no answer."""
    if not job.answered:
        failure = f"no answer within {timeout:g} ms"
        return Sample(began_ms=job.began, response_ms=None, successful=False, failure=failure)
    return Sample(began_ms=job.began, response_ms=job.response, successful=job.successful)


def _priority(task: str | None, content: Content, machine: str) -> int:
    """Return the priority of the component's threads in that operating system.

    Of its task class there, else the usual.
    """
    if task is None:
        return ORDINARY
    classes = {name.lower(): values for name, values in content.registry(machine).tasks.items()}
    values = {name.lower(): value for name, value in classes.get(task.lower(), {}).items()}
    category = {category.value: category for category in TaskCategory}.get(str(_data(values, "scheduling category")))
    priority, background = _data(values, "priority"), _data(values, "backgroundpriority")
    if category is None or not isinstance(priority, int):
        return ORDINARY
    return thread_priority(category, priority, background if isinstance(background, int) else 1)


def _data(values: Mapping[str, RegistryValue], name: str) -> int | str | None:
    value = values.get(name)
    kind = ValueKind.SZ if name == "scheduling category" else ValueKind.DWORD
    return value.data if value is not None and value.kind is kind else None
