"""Runs a machine: it yields jobs as they end.

Programs run in the guests: components with their jobs, and interfering loads with the numbers of a browser.
"""

from collections import deque
from collections.abc import Callable, Iterator
from math import ceil, inf, log, sqrt
from random import Random
from typing import assert_never

from rarms_iac.model.experiment import most_at_once
from rarms_iac.model.loads import LONGEST_GAP, SHORTEST_GAP, Browser, BusyLoop
from rarms_iac.providers.simulated.scheduling.hypervisor import HypervisorScheduler, OperatingSystem
from rarms_iac.providers.simulated.scheduling.machine import (
    INSTANT,
    INTERRUPT,
    ORDINARY,
    PARENT,
    Account,
    Action,
    Agenda,
    BurstLoads,
    JobDemand,
    JobDone,
    LogicalProcessor,
    ModelLoad,
    ModelMachine,
    Owner,
    Thread,
    TracePiece,
    VirtualMachine,
)

FRAME_MS = 40.0
"""25 frames a second, as web video of the time had."""

DECODE_MS = 4.0
"""Decoding and scaling one frame in software, on the browser's own thread."""

PAINT_MS = 2.0
"""Drawing it where the graphics driver is the machine's own."""

INTERRUPT_MS = 0.2
"""ISRs and DPCs of a frame's network packets and its screen update."""

INTERCEPT_MS = 10.0
"""Of them in a partition: every access to an emulated device traps into the hypervisor, above every VP."""

PARENT_MS = 16.0
"""Drawing it in a partition: the parent emulates the screen and encodes it, above every VP."""

PIECE_MS = 1.0
"""The longest piece in which interrupts and the parent take an LP."""

SYSTEM_MIB = 150.0
"""What the guest's operating system needs of its memory."""

BROWSER_MIB = 130.0
"""What a browser that plays video works on."""

DISK_READ_MS = 12.0
"""A random read of a disk of the time, 8 ms of seek and 4 ms of rotation (7200 a minute); the screen is locked."""

READS_A_FRAME = 1.0 / 3.0
"""How many frames read a page back where no working set is in memory: most touch what the last one touched."""


def absent_share(instances: int, memory_mib: float | None) -> float:
    """Return the part of the browsers' working sets that is not in memory, 0..1."""
    if memory_mib is None or not instances:
        return 0.0
    return max(0.0, 1.0 - max(0.0, memory_mib - SYSTEM_MIB) / (instances * BROWSER_MIB))


LEAST_WORK_MS = 1e-3


class Variation:
    """Draws durations of a given mean and coefficient of variation: log-normal, so never negative."""

    def __init__(self, random: Random, per_cent: float) -> None:
        variance = log(1.0 + (per_cent / 100.0) ** 2)
        self._random = random
        self._sigma = sqrt(variance)
        self._shift = -variance / 2.0

    def of(self, mean: float) -> float:
        """Draw one duration."""
        if not self._sigma or not mean:
            return mean
        return mean * self._random.lognormvariate(self._shift, self._sigma)


class ProcessorUse:
    """The time in which so many threads of a partition's components ran, or waited for a processor, at once."""

    def __init__(self) -> None:
        self.at_once_ms: dict[int, float] = {}  # by number of threads
        self._under_way_ms = 0.0  # with a job of any component
        self._now = 0.0
        self._jobs = 0
        self._threads = 0

    def change(self, now: float, *, jobs: int = 0, threads: int = 0) -> None:
        """Note that so many more jobs are under way from now on, and so many more threads want a processor."""
        elapsed, self._now = now - self._now, now
        self.at_once_ms[self._threads] = self.at_once_ms.get(self._threads, 0.0) + elapsed
        if self._jobs:
            self._under_way_ms += elapsed
        self._jobs += jobs
        self._threads += threads

    def most(self) -> int:
        """Return the most threads at once, at least 1, that was no rare moment."""
        return most_at_once(self.at_once_ms, self._under_way_ms)


class ComponentProgram(Owner):
    """Runs the jobs of one component."""

    def __init__(
        self,
        demand: JobDemand,
        system: OperatingSystem,
        random: Random,
        tell: Callable[[JobDone], None],
        use: ProcessorUse,
    ) -> None:
        super().__init__()
        self.account = Account()
        self._use = use
        self._demand = demand
        self._system = system
        self._agenda = system.agenda
        self._tell = tell
        self._variation = Variation(random, demand.varies)
        self._threads = [Thread(demand.priority, self.account, self._thread_done) for _ in range(demand.threads)]
        self._busy = 0
        self._due = random.uniform(0.0, demand.period_ms) if demand.period_ms else 0.0
        self._ends = inf
        self._clock = Owner()
        self._watched = False

    def start(self) -> None:
        """Start the first job at once, or at a random moment of a periodic component's period."""
        if self._due:
            self._agenda.at(self._due, self, self.begin)
        else:
            self.begin()

    def begin(self) -> None:
        """Begin the job that is due: it first waits, then works."""
        self._ends = self._agenda.now + self._demand.timeout_ms
        self._use.change(self._agenda.now, jobs=1)
        self._watch()
        blocked = self._variation.of(self._demand.blocked_ms)
        if blocked > 0.0:
            self._agenda.after(blocked, self, self._work)
        else:
            self._work()

    def _work(self) -> None:
        work = max(LEAST_WORK_MS, self._variation.of(self._demand.work_ms)) / len(self._threads)
        self._busy = len(self._threads)
        self._use.change(self._agenda.now, threads=self._busy)
        for thread in self._threads:
            thread.remaining = work
        for thread in self._threads:
            self._system.ready(thread)

    def _thread_done(self) -> None:
        self._busy -= 1
        self._use.change(self._agenda.now, threads=-1)
        if not self._busy:
            self._answer()

    def _watch(self) -> None:
        """Ask for one look at a time, however many jobs there are: hardly one of them takes too long."""
        if not self._watched and self._ends < inf:
            self._watched = True
            self._agenda.at(self._ends, self._clock, self._look)

    def _look(self) -> None:
        self._watched = False
        if self._ends <= self._agenda.now + INSTANT:
            self._give_up()
        else:
            self._watch()

    def _give_up(self) -> None:
        """End the job where it stands, as a process that takes too long; what it consumed stays consumed."""
        self.turn += 1  # it may yet have been waiting
        for thread in self._threads:
            if thread.remaining > 0.0 and self._busy:
                self._system.drop(thread)
                thread.remaining = 0.0
        self._use.change(self._agenda.now, threads=-self._busy)
        self._busy = 0
        self._over(successful=False, answered=False)

    def _answer(self) -> None:
        within = self._demand.success_within_ms
        self._over(successful=within is None or self._agenda.now - self._due <= within, answered=True)

    def _over(self, *, successful: bool, answered: bool) -> None:
        """Tell of the job; the next one begins at once, or when it is due."""
        demand, now = self._demand, self._agenda.now
        response = now - self._due
        self._ends = inf
        self._use.change(now, jobs=-1)
        self._tell(JobDone(demand.component, self._due, response, successful, self.account.consumed, answered))
        self._due = self._due + demand.period_ms if demand.period_ms else now
        if self._due <= now:
            self.begin()
        else:
            self._agenda.at(self._due, self, self.begin)


class Devices:
    """The LPs' time for interrupts and the parent: in short pieces, on every LP in turn."""

    def __init__(self, hypervisor: HypervisorScheduler) -> None:
        self._hypervisor = hypervisor
        self._turn = 0

    def interrupt(self, duration: float) -> None:
        """Spread ISRs and DPCs of this duration over the LPs; no thread waits for their end."""
        pieces = max(1, ceil(duration / PIECE_MS))
        for _ in range(pieces):
            self._hypervisor.take(self._next(), duration / pieces, INTERRUPT)

    def parent(self, duration: float, then: Action) -> None:
        """Let the parent work for a guest, piece by piece; `then` follows."""
        piece = min(duration, PIECE_MS)
        rest = duration - piece
        after = then if rest < LEAST_WORK_MS else lambda: self.parent(rest, then)
        self._hypervisor.take(self._next(), piece, PARENT, after)

    def _next(self) -> LogicalProcessor:
        self._turn = (self._turn + 1) % len(self._hypervisor.lps)
        return self._hypervisor.lps[self._turn]


class GuestScreen:
    """The one screen of a guest: who draws on it locks it, the others wait in the order in which they came."""

    def __init__(self, absent: float) -> None:
        self.absent = absent  # as of `absent_share`
        self._waiting: deque[Action] = deque()
        self._locked = False

    def lock(self, then: Action) -> None:
        """Lock the screen; `then` follows."""
        if self._locked:
            self._waiting.append(then)
        else:
            self._locked = True
            then()

    def release(self) -> None:
        """Let the next one have it."""
        if self._waiting:
            self._waiting.popleft()()
        else:
            self._locked = False


class BrowserProgram(Owner):
    """Decodes and draws frames, 25 a second if it can; a frame that comes late is not made up for."""

    def __init__(self, system: OperatingSystem, random: Random, devices: Devices, screen: GuestScreen | None) -> None:
        super().__init__()
        self._system = system
        self._agenda = system.agenda
        self._random = random
        self._devices = devices
        self._screen = screen
        self._variation = Variation(random, 20.0)
        self._decoder = Thread(ORDINARY, Account(), self._decoded)
        self._due = random.uniform(0.0, FRAME_MS)

    def start(self) -> None:
        """Start the first frame within the first period."""
        self._agenda.at(self._due, self, self._frame)

    def _frame(self) -> None:
        work = DECODE_MS if self._screen else DECODE_MS + PAINT_MS
        self._decoder.remaining = self._variation.of(work)
        self._system.ready(self._decoder)

    def _decoded(self) -> None:
        if self._screen is None:
            self._devices.interrupt(INTERRUPT_MS)
            self._drawn()
        else:
            self._screen.lock(self._draw)

    def _draw(self) -> None:
        assert self._screen is not None
        reads = self._random.random() < READS_A_FRAME * self._screen.absent
        self._agenda.after(self._variation.of(DISK_READ_MS) if reads else 0.0, self, self._paged_in)

    def _paged_in(self) -> None:
        self._devices.interrupt(INTERCEPT_MS)
        self._devices.parent(self._variation.of(PARENT_MS), self._painted)

    def _painted(self) -> None:
        assert self._screen is not None
        self._drawn()
        self._screen.release()

    def _drawn(self) -> None:
        now = self._agenda.now
        self._due = max(now, self._due + FRAME_MS)
        self._agenda.at(self._due, self, self._frame)


class BurstProgram(Owner):
    """Threads that wake together; the gap to their next burst begins when the last of them is done."""

    def __init__(self, load: BurstLoads, threads: int, system: OperatingSystem, random: Random) -> None:
        super().__init__()
        self._load = load
        self._system = system
        self._agenda = system.agenda
        self._random = random
        self._threads = [Thread(ORDINARY, Account(), self._thread_done) for _ in range(threads)]
        self._busy = 0

    def start(self) -> None:
        """Wait for the next burst."""
        gap = self._load.gap_ms * self._random.uniform(SHORTEST_GAP, LONGEST_GAP)
        self._agenda.after(gap, self, self._burst)

    def _burst(self) -> None:
        self._busy = len(self._threads)
        for thread in self._threads:
            thread.remaining = max(LEAST_WORK_MS, self._load.burst_ms)
        for thread in self._threads:
            self._system.ready(thread)

    def _thread_done(self) -> None:
        self._busy -= 1
        if not self._busy:
            self.start()


class InterruptSource(Owner):
    """ISRs and DPCs that take a given share of one LP, in pieces that come at random."""

    def __init__(self, lp: LogicalProcessor, share: float, hypervisor: HypervisorScheduler, random: Random) -> None:
        super().__init__()
        self._lp = lp
        self._gap = PIECE_MS * (1.0 / share - 1.0)
        self._hypervisor = hypervisor
        self._agenda = hypervisor.agenda
        self._random = random

    def start(self) -> None:
        """Wait for the next one."""
        self._agenda.after(self._random.expovariate(1.0) * self._gap, self, self._come)

    def _come(self) -> None:
        self._hypervisor.take(self._lp, PIECE_MS, INTERRUPT, self.start)


class BusyLoopProgram(Owner):
    """A thread that never waits, except when its load begins again."""

    def __init__(self, system: OperatingSystem) -> None:
        super().__init__()
        self._system = system
        self._agenda = system.agenda
        self._worker = Thread(ORDINARY, Account(), lambda: None)
        self._worker.remaining = inf

    def start(self) -> None:
        """Run from now on."""
        self._system.ready(self._worker)

    def restart(self, pause_ms: float) -> None:
        """Stop, and start again after a pause."""
        self._system.pause(self._worker)
        self._agenda.after(pause_ms, self, self.start)


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
        """Start every load that never pauses again, after a random part of the window; components run on.

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
