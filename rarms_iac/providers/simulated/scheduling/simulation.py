"""Runs a machine: it yields jobs as they end."""

from collections import deque
from collections.abc import Callable, Iterator
from math import inf
from random import Random
from typing import assert_never

from rarms_iac.model.loads import Browser, BusyLoop
from rarms_iac.providers.simulated.scheduling.guest import OperatingSystem
from rarms_iac.providers.simulated.scheduling.hypervisor import HypervisorScheduler
from rarms_iac.providers.simulated.scheduling.machine import (
    BurstLoads,
    JobDone,
    ModelLoad,
    ModelMachine,
    TracePiece,
    VirtualMachine,
)
from rarms_iac.providers.simulated.scheduling.processors import Agenda
from rarms_iac.providers.simulated.scheduling.programs import (
    BrowserProgram,
    BurstProgram,
    BusyLoopProgram,
    ComponentProgram,
    Devices,
    GuestScreen,
    InterruptSource,
    ProcessorUse,
    absent_share,
)


class SchedulerSimulation:
    """A machine that runs: an iterator of its jobs in the order in which they end.

    The same machine and seed give the same jobs. It ends at `until_ms`, if that is given, and may be left at any
    moment: nothing needs to be closed.
    """

    def __init__(
        self,
        machine: ModelMachine,
        seed: int,
        *,
        until_ms: float = inf,
        trace: Callable[[TracePiece], None] | None = None,
    ) -> None:
        self._seed = seed
        self._until = until_ms
        self._agenda = Agenda()
        self._hypervisor = HypervisorScheduler(self._agenda, machine.lps, machine.window_ms, trace)
        self._devices = Devices(self._hypervisor)
        self._done: deque[JobDone] = deque()
        self._components: dict[str, ComponentProgram] = {}
        self._busy_loops: list[BusyLoopProgram] = []
        self._use: dict[str, ProcessorUse] = {}  # by machine
        self._window_ms = machine.window_ms
        self._starts = self._random("starts")
        for system in sorted(machine.machines, key=lambda system: system.name):
            self._start(system)
        if machine.interrupts:
            for lp in self._hypervisor.lps:
                random = self._random(f"interrupts/{lp.number}")
                InterruptSource(lp, machine.interrupts / 100.0, self._hypervisor, random).start()
        self._hypervisor.decide()

    def consumed_ms(self, component: str) -> float:
        """Return the processor time that the component has consumed until now, unfinished jobs included."""
        self._hypervisor.settle_all()
        return self._components[component].account.consumed

    def used_processors(self, machine: str) -> int:
        """Return the most threads of the machine's components that ran or waited for a processor at once."""
        return self._use[machine].most()

    def restart_loads(self) -> bool:
        """Let every load that never pauses begin anew, after a random part of the window; components run on.

        Returns:
            False: there is none.
        """
        pause = self._starts.uniform(0.0, self._window_ms)
        for loop in self._busy_loops:
            loop.restart(pause)
        return bool(self._busy_loops)

    def __iter__(self) -> Iterator[JobDone]:
        return self

    def __next__(self) -> JobDone:
        while not self._done:
            action = self._agenda.due(self._until)
            if action is None:
                self._hypervisor.settle_all()
                raise StopIteration
            action()
            if self._hypervisor.changed:
                self._hypervisor.decide()
        return self._done.popleft()

    def _random(self, name: str) -> Random:
        return Random(f"{self._seed}/{name}")  # noqa: S311 - repeatable noise is the purpose, not a secret

    def _start(self, machine: VirtualMachine) -> None:
        system = OperatingSystem(machine, self._hypervisor)
        use = self._use[machine.name] = ProcessorUse()
        for demand in machine.components:
            random = self._random(f"component/{demand.component}")
            component = ComponentProgram(demand, system, random, self._done.append, use)
            self._components[demand.component] = component
            component.start()
        playing = sum(load.instances for load in machine.loads if isinstance(load, Browser))
        screen = GuestScreen(absent_share(playing, machine.memory_mib)) if machine.partitioned else None
        for number, load in enumerate(machine.loads):
            self._start_load(load, machine, system, f"{machine.name}/{number}", screen)

    def _start_busy_loops(self, count: int, system: OperatingSystem) -> None:
        loops = [BusyLoopProgram(system) for _ in range(count)]
        self._busy_loops += loops
        for loop in loops:
            loop.start()

    def _start_load(
        self,
        load: ModelLoad,
        machine: VirtualMachine,
        system: OperatingSystem,
        name: str,
        screen: GuestScreen | None,
    ) -> None:
        match load:
            case BusyLoop(threads=threads):
                self._start_busy_loops(machine.vps if threads is None else threads, system)
            case BurstLoads(threads=threads):
                count = machine.vps if threads is None else threads
                BurstProgram(load, count, system, self._random(f"bursts/{name}")).start()
            case Browser(instances=instances):
                for number in range(instances):
                    random = self._random(f"browser/{name}/{number}")
                    BrowserProgram(system, random, self._devices, screen).start()
            case _:
                assert_never(load)
