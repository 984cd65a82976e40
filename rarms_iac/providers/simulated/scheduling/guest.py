"""The operating system of a virtual machine: strict priorities, equal threads take turns."""

from heapq import heapify, heappop, heappush

from rarms_iac.providers.simulated.scheduling.hypervisor import HypervisorScheduler
from rarms_iac.providers.simulated.scheduling.machine import VirtualMachine
from rarms_iac.providers.simulated.scheduling.processors import INSTANT, Thread, VirtualProcessor

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
