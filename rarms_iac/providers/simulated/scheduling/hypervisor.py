"""Which VP runs on which LP, and which thread on which VP (docs/scheduling-model.md has the rules and their reasons).

The operating system of a virtual machine has strict priorities; equal threads take turns.
"""

from collections.abc import Callable
from functools import partial
from heapq import heapify, heappop, heappush
from math import inf

from rarms_iac.providers.simulated.scheduling.machine import (
    INSTANT,
    LATE,
    NOTHING,
    Agenda,
    Entitlement,
    LogicalProcessor,
    Thread,
    TracePiece,
    VirtualMachine,
    VirtualProcessor,
    usable_weights,
)

SHORTEST_SAVED_MS = 20.0
"""A waiting VP must have saved claim for this much time before it interrupts one without: VPs do not thrash."""

SHORTEST_TURN_MS = 2.0
"""For how long a late VP runs before one that is later by this much interrupts it."""

SHORTEST_WAIT_MS = 0.05
"""How often at most a waiting VP is looked at again, since interrupts delay the moment for which it waits."""

SLICE_MS = 10.0
"""How long one VP runs of what is left over before another of less use (by weight) takes its turn."""


class HypervisorScheduler:
    """Places VPs on LPs; calls the guest (`finished`, `quantum_over`) when a thread's work or turn is over."""

    def __init__(self, agenda: Agenda, lps: int, window_ms: float, trace: Callable[[TracePiece], None] | None) -> None:
        self.agenda = agenda
        self._window = window_ms
        self._trace = trace
        self._taken = self._read_at = self._reserve_clock = 0.0
        self._waiting: list[VirtualProcessor] = []
        self._busy = self._sharing = 0  # the VPs that have a thread, a bit each: now, and when weights were last made
        self._shares: dict[int, list[tuple[VirtualProcessor, float]]] = {}  # by `_busy`
        self._woken: list[VirtualProcessor] = []
        self._returning: set[VirtualProcessor] = set()  # these begin again where they were
        self._level = 0.0  # what is left over has been shared up to here: ms by usable weight
        self.lps = [LogicalProcessor(number) for number in range(lps)]
        for lp in self.lps:
            lp.due = partial(self._lp_due, lp)
        self.vps: list[VirtualProcessor] = []
        self._limited = False  # whether any VP has a limit
        self.changed = False

    def add(self, vp: VirtualProcessor) -> None:
        """Take an idle VP in; its first LP is the one of its number, so that equals spread alike."""
        vp.home = self.lps[vp.number % len(self.lps)]
        vp.due = partial(self._look_again, vp)
        vp.refill(0, self._window)
        if vp.reserve:
            vp.late_from = (self._window - INSTANT) * vp.reserve
            vp.late_until = (self._window - SHORTEST_TURN_MS) * vp.reserve
            vp.claim_from = SHORTEST_SAVED_MS * vp.reserve - INSTANT
            vp.claim_until = INSTANT
        vp.bit = 1 << len(self.vps)
        self.vps.append(vp)
        self._limited |= vp.limit < 1.0

    def wake(self, vp: VirtualProcessor) -> None:
        """Note that the VP has a thread again."""
        vp.idle(self._clock(), self._window)
        self._busy |= vp.bit
        if vp in self._returning:
            self._returning.discard(vp)
        else:
            self._woken.append(vp)
        self._queue(vp)

    def keep_place(self, vp: VirtualProcessor) -> None:
        """Let the VP come back from its next rest owing nothing, and owed what it was before.

        NOTE: for loads that begin again. As a newcomer, each start would bring the others level with it, and so give
        them a slice that is not reserved, which a load that goes on leaves once in seconds.
        """
        self._returning.add(vp)

    def rest(self, vp: VirtualProcessor) -> None:
        """Note that the VP has no thread; what it did not use of its claim is kept for the window."""
        if vp.lp is None:
            vp.idle(self._clock(), self._window)
            self._waiting.remove(vp)
        else:
            self.settle(vp.lp)
            vp.lp.vp = None
            vp.lp = None
        self._busy &= ~vp.bit
        vp.turn += 1
        vp.waiting = False
        vp.claim = min(vp.claim, vp.reserve * self._window)
        vp.since = self._clock()
        self.changed = True

    def take(self, lp: LogicalProcessor, duration: float, name: str, then: Callable[[], None] | None = None) -> None:
        """Take the LP from what runs there; the VP stays and waits on it, since this is short."""
        self.settle(lp)
        if not lp.taken:
            lp.taken_left = duration
        lp.taken.append((duration, name, then))
        self._arm(lp)

    def settle(self, lp: LogicalProcessor) -> None:
        """Account for what the LP did since it was last settled."""
        now = self.agenda.now
        elapsed = now - lp.since
        if elapsed <= 0.0:
            return
        if self._trace is not None:
            self._trace(TracePiece(lp.number, lp.since, now, lp.doing()))
        lp.since = now
        if lp.taken:
            lp.taken_left -= elapsed
            self._taken += elapsed
            if lp.vp is not None:
                lp.vp.claim += lp.vp.gain(self._clock())
        elif lp.vp is not None:
            lp.vp.consume(elapsed, self._clock())

    def _clock(self) -> float:
        """Return the reserve clock.

        It stands still while interrupts take the LPs, so that reserves share what they leave.
        """
        now = self.agenda.now
        if now != self._read_at:  # interrupts that begin or end now have taken nothing yet, or are in `_taken`
            taken = self._taken
            for lp in self.lps:
                if lp.taken:
                    taken += now - lp.since
            self._read_at, self._reserve_clock = now, now - taken / len(self.lps)
        return self._reserve_clock

    def settle_all(self) -> None:
        """Account for everything up to now."""
        now = self.agenda.now
        for lp in self.lps:
            if lp.since < now:
                self.settle(lp)

    def decide(self) -> None:
        """Give every LP to the VP that should have it now, and ask to be called again when that may change."""
        self.changed = False
        self.settle_all()
        if self._woken or self._busy != self._sharing:
            self._share()
        if self._limited:
            self._throttle()
        while self._waiting and (first := self._first_waiting()) is not None and self._place(*first):
            pass
        for lp in self.lps:
            self._arm(lp)

    def _share(self) -> None:
        """Weigh all that demand; who comes begins where the least served is, with nothing owed from before."""
        stayed = self._busy & self._sharing
        for vp in self._woken:
            stayed &= ~vp.bit
        served = [vp.used for vp in self.vps if vp.bit & stayed and vp.limit > vp.reserve]
        self._level = max(self._level, min(served) if served else max(vp.used for vp in self.vps))
        for vp in self._woken:
            vp.used = max(vp.used, self._level)
        self._woken.clear()
        self._sharing = self._busy
        shares = self._shares.get(self._busy)
        if shares is None:
            busy = [vp for vp in self.vps if vp.bit & self._busy]
            weights = usable_weights([Entitlement(vp.reserve, vp.limit, vp.weight) for vp in busy], len(self.lps))
            shares = self._shares[self._busy] = list(zip(busy, weights, strict=True))
        for vp, weight in shares:
            vp.usable_weight = weight

    def _queue(self, vp: VirtualProcessor) -> None:
        vp.lp = None
        vp.waiting = True
        vp.since = self._clock()
        self._waiting.append(vp)
        self._look_later(vp)
        self.changed = True

    def _throttle(self) -> None:
        for lp in self.lps:
            vp = lp.vp
            if vp is not None and vp.limit < 1.0 and self._left_of_limit(vp) <= INSTANT:
                lp.vp = None
                self._queue(vp)

    def _left_of_limit(self, vp: VirtualProcessor) -> float:
        vp.refill(int((self.agenda.now + INSTANT) / self._window), self._window)
        return vp.limit_left

    def _first_waiting(self) -> tuple[VirtualProcessor, int] | None:
        """Return the VP that runs next, with its urgency: if it outranks none that runs, no other does."""
        clock = self._clock()
        first, highest, furthest = None, NOTHING, -inf
        for vp in self._waiting:
            if vp.limit < 1.0 and self._left_of_limit(vp) <= INSTANT:
                continue
            vp.save(clock)
            urgency = vp.urgency()
            if urgency < highest:
                continue
            ahead = vp.saved() if urgency != NOTHING else -vp.used
            if urgency > highest or ahead > furthest:
                first, highest, furthest = vp, urgency, ahead
        return None if first is None else (first, highest)

    def _place(self, vp: VirtualProcessor, urgency: int) -> bool:
        """Put a waiting VP on an LP, a free one or that of one that it outranks; return whether there is one."""
        lp = self._lp_for(vp, urgency)
        if lp is None:
            return False
        other = lp.vp
        if other is not None:
            lp.vp = None
            self._queue(other)
        self._waiting.remove(vp)
        # Who runs on its claim has no slice of what is left over: that is for the least served when the claim ends.
        lp.slice_until = self.agenda.now + (SLICE_MS if urgency == NOTHING else 0.0)
        vp.waiting = False
        vp.turn += 1
        vp.lp = vp.home = lp
        lp.vp = vp
        return True

    def _lp_for(self, vp: VirtualProcessor, urgency: int) -> LogicalProcessor | None:
        """Return a free LP, or that of the weakest VP that it outranks.

        VPs rank by urgency, then by what they saved or how little they had.

        NOTE: equals on their claims do not interrupt one another, nor does anybody a slice of what is left over.
        """
        free = [lp for lp in self.lps if lp.vp is None]
        if free:
            return min(free, key=lambda lp: (bool(lp.taken), lp is not vp.home))
        now = self.agenda.now if urgency == NOTHING else inf
        weakest, lowest, strength = None, LATE + 1, 0.0
        for lp in self.lps:
            other = lp.vp
            assert other is not None
            if now < lp.slice_until - INSTANT:
                continue
            its = other.urgency()
            if its > lowest:
                continue
            defence = -other.used if its == NOTHING else other.saved() if its == LATE else 0.0
            if its < lowest or defence < strength:
                weakest, lowest, strength = lp, its, defence
        if urgency != lowest:
            return weakest if urgency > lowest else None
        if urgency == LATE:
            return weakest if vp.saved() > strength + SHORTEST_TURN_MS else None
        return weakest if urgency == NOTHING and -vp.used > strength else None

    def _arm(self, lp: LogicalProcessor) -> None:
        """Ask for the next moment at which something may change on this LP by itself."""
        delay = lp.taken_left if lp.taken else self._undisturbed(lp)
        at = self.agenda.now + max(delay, 0.0)
        if at != lp.armed_at:
            lp.turn += 1
            lp.armed_at = at
            if at != inf:
                self.agenda.at(at, lp, lp.due)

    def _undisturbed(self, lp: LogicalProcessor) -> float:
        vp = lp.vp
        if vp is None or vp.thread is None:
            return inf
        delay = vp.thread.remaining
        if vp.guest.contended:
            delay = min(delay, vp.thread.quantum)
        if self._waiting:
            if vp.claim <= INSTANT:
                now = self.agenda.now
                if lp.slice_until <= now + INSTANT:
                    lp.slice_until = now + SLICE_MS
                delay = min(delay, lp.slice_until - now)
            elif vp.reserve < 1.0:
                delay = min(delay, vp.claim / (1.0 - vp.reserve))
        if vp.limit < 1.0:
            delay = min(delay, self._left_of_limit(vp), self._to_next_window())
        return delay

    def _to_next_window(self) -> float:
        now = self.agenda.now
        return (int((now + INSTANT) / self._window) + 1) * self._window - now

    def _lp_due(self, lp: LogicalProcessor) -> None:
        lp.armed_at = inf
        self.settle(lp)
        if lp.taken:
            self._give_back(lp)
            return
        self.changed = True
        vp = lp.vp
        if vp is not None and vp.thread is not None:
            if vp.thread.remaining <= INSTANT:
                vp.guest.finished(vp)
            elif vp.guest.contended and vp.thread.quantum <= INSTANT:
                vp.guest.quantum_over(vp)

    def _give_back(self, lp: LogicalProcessor) -> None:
        _, _, then = lp.taken.popleft()
        if lp.taken:
            lp.taken_left = lp.taken[0][0]
        self._arm(lp)
        if then is not None:
            then()

    def _look_again(self, vp: VirtualProcessor) -> None:
        """Look again, unless all others run on their claims: the end of a claim is looked at by itself."""
        self._look_later(vp)
        if vp.limit < 1.0 or vp.urgency() == LATE or any(lp.vp is None or not lp.vp.claim for lp in self.lps):
            self.changed = True

    def _look_later(self, vp: VirtualProcessor) -> None:
        """Plan when a waiting VP gains urgency: as its claim grows, and in the next window if it is at its limit."""
        vp.turn += 1
        vp.save(self._clock())
        delay = inf
        if vp.reserve > 0.0:
            saved = vp.claim / vp.reserve
            delay = SHORTEST_SAVED_MS - saved
            if delay <= INSTANT:
                delay = self._window - saved
            if delay <= INSTANT:
                delay = SHORTEST_TURN_MS
            delay = max(SHORTEST_WAIT_MS, delay)
        if vp.limit < 1.0 and self._left_of_limit(vp) <= INSTANT:
            delay = min(delay, self._to_next_window())
        if delay != inf:
            self.agenda.after(delay, vp, vp.due)


QUANTUM_MS = 31.2
"""Two ticks of the 15.6 ms clock: the turn of an ordinary thread on a client Windows."""


class OperatingSystem:
    """Keeps the threads that are ready, and puts the highest on VPs."""

    def __init__(self, machine: VirtualMachine, hypervisor: HypervisorScheduler) -> None:
        shares = (machine.reserve / 100.0, machine.limit / 100.0)
        self._hypervisor = hypervisor
        self.agenda = hypervisor.agenda
        self._ready: list[tuple[int, int, Thread]] = []
        self._asked = 0
        self.contended = False
        self.vps = [
            VirtualProcessor(self, f"{machine.name}.{number}", number, shares, machine.weight)
            for number in range(machine.vps)
        ]
        for vp in self.vps:
            hypervisor.add(vp)

    def ready(self, thread: Thread) -> None:
        """Give a thread with work its last VP, an idle one or that of a lower thread; otherwise it waits."""
        last = thread.last
        if last is not None and last.thread is None:
            self._put(thread, last)
            return
        vp = next((processor for processor in self.vps if processor.thread is None), None)
        if vp is None:
            vp = min(self.vps, key=_priority)
            if _priority(vp) >= thread.priority:
                self._enqueue(thread)
                return
            self._remove(vp)
        self._put(thread, vp)

    def finished(self, vp: VirtualProcessor) -> None:
        """End the thread's work: what follows may give it more at once, otherwise the next one has the VP."""
        thread = vp.thread
        assert thread is not None
        vp.thread = None
        thread.done()
        if thread.remaining <= INSTANT:
            thread.quantum = QUANTUM_MS  # it waits now, and a thread that wakes has a whole turn
        self._fill(vp)

    def drop(self, thread: Thread) -> None:
        """Take the thread's work away, also in the middle of a job."""
        vp = next((processor for processor in self.vps if processor.thread is thread), None)
        if vp is None:
            self._ready = [entry for entry in self._ready if entry[2] is not thread]
            heapify(self._ready)
            self.contended = bool(self._ready)
            return
        if vp.lp is not None:
            self._hypervisor.settle(vp.lp)
        vp.thread = None
        self._fill(vp)

    def pause(self, thread: Thread) -> None:
        """Stop the thread; its VP keeps its place among the host's others until it comes back."""
        if thread.last is not None:
            self._hypervisor.keep_place(thread.last)
        self.drop(thread)

    def quantum_over(self, vp: VirtualProcessor) -> None:
        """End the thread's turn: the next of its priority has the VP, and it waits behind all of them."""
        thread = vp.thread
        assert thread is not None
        thread.quantum = QUANTUM_MS
        if self._ready and -self._ready[0][0] >= thread.priority:
            self._remove(vp)
            self._put_next(vp)

    def _fill(self, vp: VirtualProcessor) -> None:
        if vp.thread is None and not self._put_next(vp):
            self._hypervisor.rest(vp)

    def _put_next(self, vp: VirtualProcessor) -> bool:
        if not self._ready:
            return False
        _, _, thread = heappop(self._ready)
        self.contended = bool(self._ready)
        self._put(thread, vp)
        return True

    def _put(self, thread: Thread, vp: VirtualProcessor) -> None:
        vp.thread = thread
        if thread.quantum <= 0.0:
            thread.quantum = QUANTUM_MS
        thread.last = vp
        if vp.lp is None and not vp.waiting:
            self._hypervisor.wake(vp)
        self._hypervisor.changed = True

    def _remove(self, vp: VirtualProcessor) -> None:
        if vp.lp is not None:
            self._hypervisor.settle(vp.lp)
        if vp.thread is not None:
            self._enqueue(vp.thread)
        vp.thread = None

    def _enqueue(self, thread: Thread) -> None:
        self._asked += 1
        heappush(self._ready, (-thread.priority, self._asked, thread))
        self.contended = True


def _priority(vp: VirtualProcessor) -> int:
    return vp.thread.priority if vp.thread is not None else -1
