"""Settling: from when on samples count, because the host's scheduler has forgotten how the work began.

A scheduler remembers who was late, and how much of a reserve was not used. Until that has passed, a component may have
a processor for itself, and answer in 3 ms where it will soon take 300. Response times do not show this, since they are
steady meanwhile. Consumption does: where all of a host's time is reserved or wanted, a component that wants more than
its reserve gets just its reserve. So samples count once enough time has passed and consumption has come down to that.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from rarms_iac.model.loads import BusyLoop, Interference
from rarms_iac.providers.measuring import RunningWork
from rarms_iac.statistics.setting_time import MEMORY_FACTOR

PATIENCE_FACTOR = 20
"""After this many times `Settling.least_ms`, and two jobs of each component, samples count at any consumption."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Contender:
    """Components that share a partition, beside a load that wants all the processor time that is not reserved."""

    components: tuple[str, ...]
    processors: float  # LPs that their partition reserves, all of its VPs together
    excess_forbids_verdict: bool  # where it still gets more than it reserves, its samples give no verdict


def wants_all_processors(load: Interference | None, logical_processors: int) -> bool:
    """Whether a load leaves no processor idle, so that consumption shows what a scheduler does.

    Args:
        load: the interference; None: there is none.

    Returns:
        True only for busy loops on all of them.
    """
    return isinstance(load, BusyLoop) and (load.threads is None or load.threads >= logical_processors)


@dataclass(slots=True, kw_only=True)
class Settling:
    """Follows running work until its host has forgotten the start."""

    scheduler_window_ms: float  # `MeasuringHost.scheduler_memory_ms`
    contenders: Sequence[Contender] = ()
    _marks: dict[str, list[tuple[float, float]]] = field(default_factory=dict)  # by component: time, CPU time until it
    _jobs: dict[str, int] = field(default_factory=dict)  # by component: those that ended

    @property
    def least_ms(self) -> float:
        """How long it takes at least, and how long a series of samples is at least."""
        return MEMORY_FACTOR * self.scheduler_window_ms

    def record_job(self, running: RunningWork, component: str) -> None:
        """Record what a component consumed until now; to be called as each of its jobs ends.

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
        """Return whether samples count from now on; whether they can give a verdict, `excess_message` says.

        Args:
            elapsed_ms: since the work began.

        Returns:
            False: the samples so far do not count.
        """
        if elapsed_ms < self.least_ms:
            return False
        return not self._excesses() or self._gives_up_waiting(elapsed_ms)

    def excess_message(self) -> str:
        """Say why there will be no verdict; empty where there may be one.

        Returns:
            A clause that names the components, the LPs that they consumed and the LPs that are reserved.
        """
        return "; ".join(
            f"{' and '.join(contender.components)} still consumed {consumed:.3g} LP where {contender.processors:.3g} "
            "are reserved, and what is left over by others is no promise"
            for contender, consumed in self._excesses()
            if contender.excess_forbids_verdict
        )

    def _excesses(self) -> list[tuple[Contender, float]]:
        """Return the contenders that recently consumed more than they reserve, with what they consumed, in LPs."""
        found = []
        for contender in self.contenders:
            consumed = sum(self._recent_processors(name) for name in contender.components)
            # NOTE: a reserve that was saved up before, as much as one memory holds, is no excess.
            if consumed > contender.processors * (1.0 + 1.0 / MEMORY_FACTOR) + 1.0 / (10 * MEMORY_FACTOR):
                found.append((contender, consumed))
        return found

    def _recent_processors(self, component: str) -> float:
        """Return the LPs that a component consumed over the last `least_ms`, or over its last job if that is longer."""
        marks = self._marks.get(component, [])
        if len(marks) < 2:
            return 0.0
        now, consumed = marks[-1]
        since, before = marks[0]
        return (consumed - before) / (now - since) if now > since else 0.0

    def _gives_up_waiting(self, elapsed_ms: float) -> bool:
        names = [name for contender in self.contenders for name in contender.components]
        jobs = min((self._jobs.get(name, 0) for name in names), default=0)
        return elapsed_ms > PATIENCE_FACTOR * self.least_ms and jobs >= 2
