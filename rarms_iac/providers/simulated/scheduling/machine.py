"""What goes into the scheduler model and what comes out. Times are in ms, shares in per cent of a machine's own VPs.

The state of the model is here, too: the clock with what is to happen, threads, virtual and logical processors, and
their shares. What each VP of a host is due is its reserve, and by weight a part of what is not claimed (weighted
max-min fairness). The weights of a multiprocessor can be infeasible: a VP runs on one LP at a time, however much it
weighs. What it cannot use is the others' by their weights, so every weight is first lowered to what its VP can use
("weight readjustment": Chandra, Adler, Goyal and Shenoy, Surplus Fair Scheduling, OSDI 2000). Else, who weighs too
much is owed ever more.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from math import inf
from typing import NamedTuple, Protocol

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
    """Threads that wake at the same moment, take a burst of processor time each, and sleep (`simulation.py`)."""

    burst_ms: float
    gap_ms: float  # between bursts, on average
    threads: int | None = None  # None: one a VP


ModelLoad = BusyLoop | BurstLoads | Browser
"""A busy loop has threads that never wait, without a number one a VP; `simulation.py` says what a browser does."""


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
        """Refuse what no host would be asked: more reserved than there is, or two of one name."""
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
    """A piece of an LP's time: the trace of a simulation is made of these, each LP's without gap or overlap."""

    lp: int
    began: float
    ended: float
    ran: str  # `P1.0` (a VP), INTERRUPT, PARENT or IDLE


IDLE = "idle"
INTERRUPT = "interrupt"
PARENT = "parent"


Action = Callable[[], None]

INSTANT = 1e-6
"""Milliseconds below which a duration is none: far above a float's grain after days, far below all we model."""


class Owner:
    """One that asks for actions; raising its turn cancels the actions that it asked for before."""

    def __init__(self) -> None:
        self.turn = 0


class Agenda:
    """The clock, and the actions to come."""

    def __init__(self) -> None:
        self.now = 0.0
        self._asked = 0
        self._coming: list[tuple[float, int, int, Owner, Action]] = []

    def at(self, time: float, owner: Owner, action: Action) -> None:
        """Let the action happen then, unless the owner's turn has been raised in between."""
        self._asked += 1
        heappush(self._coming, (time, self._asked, owner.turn, owner, action))

    def after(self, delay: float, owner: Owner, action: Action) -> None:
        """Let the action happen so much later."""
        self.at(self.now + delay, owner, action)

    def due(self, until: float) -> Action | None:
        """Return the next action that counts, the clock set to its time.

        None (the clock at `until`) when none comes first.
        """
        coming = self._coming
        while coming and coming[0][0] <= until:
            time, _, turn, owner, action = heappop(coming)
            if owner.turn == turn:
                if time > self.now:
                    self.now = time
                return action
        self.now = max(self.now, until) if until != float("inf") else self.now
        return None


NOTHING, CLAIM, LATE = 0, 1, 2
"""How urgent it is that a VP runs; the higher one runs."""


class Account:
    """The processor time that was consumed."""

    def __init__(self) -> None:
        self.consumed = 0.0


class Thread:
    """A thread of a guest, with the work before it."""

    def __init__(self, priority: int, account: Account, done: Action) -> None:
        self.priority = priority
        self.account = account
        self.done = done
        self.remaining = 0.0
        self.quantum = 0.0
        self.last: VirtualProcessor | None = None


class GuestScheduler(Protocol):
    """The methods of an operating system that the hypervisor calls."""

    @property
    def contended(self) -> bool:
        """Whether a thread waits there whose priority one of the running ones has."""

    def finished(self, vp: "VirtualProcessor") -> None:
        """End the work of the VP's thread."""

    def quantum_over(self, vp: "VirtualProcessor") -> None:
        """End the turn of the VP's thread."""


class VirtualProcessor(Owner):
    """A VP: shares are fractions of one LP, claim is milliseconds of reserved time not yet used."""

    home: "LogicalProcessor"
    due: Action

    def __init__(self, guest: GuestScheduler, name: str, number: int, shares: tuple[float, float], weight: int) -> None:
        super().__init__()
        self.guest = guest
        self.name = name
        self.number = number
        self.reserve, self.limit = shares
        self.weight = weight
        self.usable_weight = float(weight)  # of it, what it can use with those that demand now
        self.thread: Thread | None = None
        self.lp: LogicalProcessor | None = None
        self.waiting = False
        self.claim = 0.0
        # The claims with which it is LATE, and has a CLAIM: first while it waits, then while it runs.
        self.late_from = self.late_until = self.claim_from = self.claim_until = inf
        self.since = 0.0  # up to when claim is counted, on the reserve clock
        self.used = 0.0  # ms of what is left over, by usable weight
        self.bit = 0  # set by the hypervisor
        self.limit_left = 0.0
        self.limit_window = -1

    def saved(self) -> float:
        """Return for how long its reserve has not been used, in ms."""
        return self.claim / self.reserve if self.reserve else 0.0

    def urgency(self) -> int:
        """Return LATE: its reserve must be honoured now; CLAIM: it may use it; NOTHING: it lives on what is left over.

        What runs keeps its urgency for a turn.
        """
        claim = self.claim
        if claim >= (self.late_from if self.waiting else self.late_until):
            return LATE
        return CLAIM if claim >= (self.claim_from if self.waiting else self.claim_until) else NOTHING

    def save(self, clock: float) -> None:
        """Add the claim of a VP that waits."""
        if clock != self.since:
            self.claim += self.reserve * (clock - self.since)
            self.since = clock

    def idle(self, clock: float, window: float) -> None:
        """Add the claim of a VP that does not wait; beyond the window it lapses."""
        gained = self.gain(clock)
        if self.reserve:
            self.claim = min(self.claim + gained, max(self.claim, self.reserve * window))

    def gain(self, clock: float) -> float:
        """Return the claim gained up to the reserve clock, not yet added."""
        gained = self.reserve * (clock - self.since)
        self.since = clock
        return gained

    def consume(self, elapsed: float, clock: float) -> None:
        """Run for so long: first of its claim, then of what is left over."""
        thread = self.thread
        assert thread is not None
        thread.remaining -= elapsed
        thread.quantum -= elapsed
        thread.account.consumed += elapsed
        self.limit_left -= elapsed
        net = self.gain(clock) - elapsed
        if self.claim <= 0.0:
            self.used -= net / self.usable_weight  # what its reserve gains meanwhile is used up at once
            return
        self.claim += net
        if self.claim <= -INSTANT:  # used up on the way: the rest was left over, and is not a debt
            self.used -= self.claim / self.usable_weight
        if self.claim < INSTANT:
            self.claim = 0.0

    def refill(self, window: int, length: float) -> None:
        """Let its limit start again in every window."""
        if window != self.limit_window:
            self.limit_window = window
            self.limit_left = self.limit * length


class LogicalProcessor(Owner):
    """An LP: the VP on it, and what has been taken from it for interrupts and the parent."""

    due: Action

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number
        self.vp: VirtualProcessor | None = None
        self.since = 0.0
        self.armed_at = inf
        self.slice_until = 0.0
        self.taken: deque[tuple[float, str, Callable[[], None] | None]] = deque()
        self.taken_left = 0.0

    def doing(self) -> str:
        """Return the activity of the LP now, as the trace names it."""
        if self.taken:
            return self.taken[0][1]
        return self.vp.name if self.vp is not None else IDLE


class Entitlement(NamedTuple):
    """The entitlement of a VP that demands: reserve and limit are fractions of one LP."""

    reserve: float
    limit: float
    weight: float


def usable_weights(demanding: Sequence[Entitlement], lps: int) -> list[float]:
    """Lower each weight to what its VP can use beyond its reserve.

    Args:
        demanding: Every VP that wants to run, in any order.

    Returns:
        The weights in the same order. By these, what the reserves leave can be shared to the last bit: each VP gets
        its reserve and weight times one and the same level, none passes its limit, and no LP is idle while a VP
        may still run. A VP whose limit is its reserve keeps its weight: nothing is shared with it.
    """
    level = _level(demanding, lps)
    if not level:
        return [vp.weight for vp in demanding]
    return [min(vp.weight, (vp.limit - vp.reserve) / level) if vp.limit > vp.reserve else vp.weight for vp in demanding]


def _level(demanding: Sequence[Entitlement], lps: int) -> float:
    """Return the worth of a unit of weight, in LPs.

    Water rises over all VPs alike, and leaves out those at their limit.
    """
    remaining = lps - sum((vp.reserve for vp in demanding), 0.0)
    rising = sum((vp.weight for vp in demanding), 0.0)
    level = 0.0
    for full_at, vp in sorted(((vp.limit - vp.reserve) / vp.weight, vp) for vp in demanding):
        if full_at * rising >= remaining:
            return remaining / rising
        level = full_at
        remaining -= vp.limit - vp.reserve
        rising -= vp.weight
    return level
