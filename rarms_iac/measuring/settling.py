"""When a host has forgotten how its work began: what is seen before says nothing about the next hour.

A scheduler remembers: who was late, and what was not used of a reserve. Until that has passed, a component may have a
processor for itself, and answer in 3 ms where it will soon take 300. Its response times cannot tell, since they are
steady meanwhile; what it consumes can: where all of a host's time is reserved and wanted, whoever wants more than its
reserve gets just that. So samples count from when both have been seen: time, and consumption.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from rarms_iac.model.system import BusyLoop, Interference
from rarms_iac.providers.measuring import RunningWork

MEMORIES = 30
"""So many times the scheduler's longest memory passes before samples count, and again while they are taken."""

PATIENCE = 20
"""After so many times `Settling.least_ms`, and two jobs of each component, consumption is not waited for any longer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Contender:
    """Components of a partition beside which everybody wants all that there is."""

    components: tuple[str, ...]
    processors: float  # LPs that their partition reserves, all of its VPs together
    must_come_down: bool  # what it gets beyond that is no part of what is asked, so that there is no verdict with it


def contends_for_all(load: Interference | None, logical_processors: int) -> bool:
    """Whether a load leaves no processor idle, so that consumption shows what a scheduler does.

    Args:
        load: the interference; None: there is none.
        logical_processors: of the host.

    Returns:
        True only for busy loops on all of them.
    """
    return isinstance(load, BusyLoop) and (load.threads is None or load.threads >= logical_processors)


@dataclass(slots=True, kw_only=True)
class Settling:
    """Follows running work until its host has forgotten the start."""

    memory_ms: float  # `MeasuringHost.scheduler_memory_ms`
    contenders: Sequence[Contender] = ()
    _marks: dict[str, list[tuple[float, float]]] = field(default_factory=dict)  # by component: time, CPU time until it
    _jobs: dict[str, int] = field(default_factory=dict)  # by component: those that ended

    @property
    def least_ms(self) -> float:
        """How long it takes at least, and how long a series of samples is at least."""
        return MEMORIES * self.memory_ms

    def saw(self, running: RunningWork, component: str) -> None:
        """Take note of what a component consumed by now; to be called as each of its jobs ends.

        Args:
            running: tells the time and what was consumed.
            component: whose job ended.
        """
        consumed = running.cpu_ms(component)
        if consumed is None:
            return
        now = running.elapsed_ms()
        self._jobs[component] = self._jobs.get(component, 0) + 1
        marks = self._marks.setdefault(component, [(0.0, 0.0)])
        marks.append((now, consumed))
        while len(marks) > 2 and marks[1][0] <= now - self.least_ms:
            marks.pop(0)  # older than what is looked at

    def is_over(self, elapsed_ms: float) -> bool:
        """Whether samples count from now on: for a verdict, or (`excess`) for none.

        Args:
            elapsed_ms: since the work began.

        Returns:
            False: what is seen yet is no sample.
        """
        if elapsed_ms < self.least_ms:
            return False
        return not self._excesses() or self._is_in_vain(elapsed_ms)

    def excess(self) -> str:
        """Say why there will be no verdict; empty where there may be one.

        Returns:
            Words that name components, and LPs consumed beside LPs reserved.
        """
        return "; ".join(
            f"{' and '.join(contender.components)} still consumed {consumed:.3g} LP where {contender.processors:.3g} "
            "are reserved, and what is left over by others is no promise"
            for contender, consumed in self._excesses()
            if contender.must_come_down
        )

    def _excesses(self) -> list[tuple[Contender, float]]:
        """The contenders that consume more than is theirs, with what they consume of late, in LPs."""
        found = []
        for contender in self.contenders:
            consumed = sum(self._of_late(name) for name in contender.components)
            # A memory's worth of reserve may have been saved up before.
            if consumed > contender.processors * (1.0 + 1.0 / MEMORIES) + 1.0 / (10 * MEMORIES):
                found.append((contender, consumed))
        return found

    def _of_late(self, component: str) -> float:
        """Its consumption, in LPs, from job to job over the last `least_ms` or the last job, whichever is longer."""
        marks = self._marks.get(component, [])
        if len(marks) < 2:
            return 0.0
        now, consumed = marks[-1]
        since, before = marks[0]
        return (consumed - before) / (now - since) if now > since else 0.0

    def _is_in_vain(self, elapsed_ms: float) -> bool:
        names = [name for contender in self.contenders for name in contender.components]
        jobs = min((self._jobs.get(name, 0) for name in names), default=0)
        return elapsed_ms > PATIENCE * self.least_ms and jobs >= 2
