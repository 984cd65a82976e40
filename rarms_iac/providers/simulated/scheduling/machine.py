"""What goes into the scheduler model and what comes out. Times are in ms, shares in per cent of a machine's own VPs."""

from dataclasses import dataclass
from math import inf
from typing import NamedTuple

from rarms_iac.model.loads import Browser, BusyLoop

ORDINARY = 8
"""The thread priority of a program that asks for none (Windows' normal class)."""


WINDOW_MS = 100.0
"""A reserve is guaranteed over it, and unused claim is kept for it: the longest that the scheduler remembers."""

QUIET_INTERRUPTS = 1.0
"""Per cent of every LP that a machine's clock, network and disks take even when idle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobDemand:
    """A component: what each of its jobs asks for. A job waits (`blocked_ms`), then works on all its threads."""

    component: str
    work_ms: float  # processor time of all threads together
    blocked_ms: float = 0.0
    varies: float = 0.0  # per cent: the coefficient of variation of work and blocked time
    threads: int = 1
    period_ms: float | None = None  # a job is due so often; None: the next begins when the last one ended
    success_within_ms: float | None = None  # None: every answer is a success
    timeout_ms: float = inf  # a job that runs for so long is ended there, and uses nothing more
    priority: int = ORDINARY  # 0..31: inside one operating system the higher one runs


@dataclass(frozen=True, slots=True, kw_only=True)
class BurstLoads:
    """Threads that wake at the same moment, take a burst of processor time each, and sleep (`programs.py`)."""

    burst_ms: float
    gap_ms: float  # between bursts, on average
    threads: int | None = None  # None: one a VP


ModelLoad = BusyLoop | BurstLoads | Browser
"""A busy loop has threads that never wait, without a number one a VP; `programs.py` says what a browser does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VirtualMachine:
    """An operating system on its own VPs, in a partition, or (`partitioned=False`) on the machine itself."""

    name: str
    vps: int
    reserve: float = 0.0  # per cent of each VP, guaranteed over the machine's window
    limit: float = 100.0  # per cent of each VP, never passed in any window
    weight: int = 100  # its part of what is left over
    memory_mib: float | None = None  # None: more than it needs
    components: tuple[JobDemand, ...] = ()
    loads: tuple[ModelLoad, ...] = ()
    partitioned: bool = True  # whether its devices are the parent's, whose time its I/O then costs


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelMachine:
    """Logical processors and what shares them."""

    lps: int
    machines: tuple[VirtualMachine, ...]
    interrupts: float = 0.0  # per cent of every LP that ISRs and DPCs take from everyone
    window_ms: float = WINDOW_MS

    def __post_init__(self) -> None:
        """Refuses what no host would be asked: more reserved than there is, or two of one name."""
        reserved = sum(machine.vps * machine.reserve for machine in self.machines)
        if reserved > self.lps * 100 + 1e-6:
            raise ValueError(f"{reserved:g} % of one LP are reserved, and {self.lps} LPs have {self.lps * 100} %")
        names = [machine.name for machine in self.machines]
        components = [demand.component for machine in self.machines for demand in machine.components]
        for listed in (names, components):
            if len(set(listed)) != len(listed):
                raise ValueError(f"a name stands twice in {', '.join(listed)}")


@dataclass(frozen=True, slots=True)
class JobDone:
    """A job that ended."""

    component: str
    began: float  # ms since the start; of a periodic job, when it was due
    response: float  # ms from there to its answer, or to its end without one
    successful: bool
    cpu: float  # ms of processor time that its component consumed so far, this job included
    answered: bool = True  # it was not ended by its component's time-out


class TracePiece(NamedTuple):
    """What an LP did for a while: the trace of a simulation is made of these, each LP's without gap or overlap."""

    lp: int
    began: float
    ended: float
    ran: str  # `P1.0` (a VP), INTERRUPT, PARENT or IDLE


IDLE = "idle"
INTERRUPT = "interrupt"
PARENT = "parent"
