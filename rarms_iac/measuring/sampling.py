"""The samples of work that runs: from when its host has settled until there are enough, or no more.

With a load that never pauses: the host settles, a first start of the load counts, the load begins again, some windows
of the scheduler are left out, the next start counts, and so on; at the looks of `next_look` it is asked whether this is
enough.

A scheduler remembers who was late, and how much of a reserve was not used. Until that has passed, a component may have
a processor for itself, and answer in 3 ms where it will soon take 300. Response times do not show this, since they are
steady meanwhile. Consumption does: where all of a host's time is reserved or wanted, a component that wants more than
its reserve gets just its reserve. So samples count once enough time has passed and consumption has come down to that.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf

from rarms_iac.model.loads import BusyLoop, Interference
from rarms_iac.model.outcomes import TooManyFailures
from rarms_iac.model.run import Periodic
from rarms_iac.model.series import Sample, Series, columns_of
from rarms_iac.model.system import Component
from rarms_iac.providers.measuring import RunningWork
from rarms_iac.statistics.distributions import FIRST_LOOK, next_look
from rarms_iac.statistics.samples import response_times, starts_differ
from rarms_iac.statistics.steady_state import MEMORY_FACTOR, RESTART_WINDOWS, STARTS, answered_before, least_starts

PATIENCE_FACTOR = 20
"""After this many times `Settling.least_ms`, and two jobs of each component, samples count at any consumption."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Contender:
    """Components that share a partition, with a load that wants all the processor time that is not reserved."""

    components: tuple[str, ...]
    processors: float  # LPs that their partition reserves, all of its VPs together
    excess_forbids_verdict: bool  # where it still gets more than it reserves, its samples give no verdict


def wants_all_processors(load: Interference | None, logical_processors: int) -> bool:
    """Return whether a load leaves no processor idle, so that consumption shows the scheduler's behaviour.

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
            running: has the time and the consumed processor time.
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
            f"{' and '.join(contender.components)} still consumed {consumed:.3g} LP with "
            f"{contender.processors:.3g} LP reserved; the rest was unreserved processor time"
            for contender, consumed in self._excesses()
            if contender.excess_forbids_verdict
        )

    def _excesses(self) -> list[tuple[Contender, float]]:
        """Return the contenders that recently consumed more than they reserve, with what they consumed, in LPs."""
        found = []
        for contender in self.contenders:
            consumed = sum(self._recent_processors(name) for name in contender.components)
            # NOTE: a reserve that was saved up before, as much as one memory holds, is not an excess.
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


_LIMIT_GROWTH = 1.1
"""What was not enough at the limit is asked again when the limit is so many times as late."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchEnd:
    """The conditions under which `watch` ends."""

    # Asked when every component has as many samples as `next_look` says, and the scheduler's memory has passed as often
    # as it must.
    is_enough: Callable[[Mapping[str, Series]], bool]
    should_stop: Callable[[], bool]  # asked after every sample
    # Of the host's time since the work began: from then on one sample of each component is enough to ask `is_enough`,
    # and again each time the limit has grown by a tenth.
    limit_ms: float = inf
    # Whether the load must have begun `least_starts` times before `is_enough` is asked; asked from the first look on,
    # until the load has. False: the samples are no point of a curve. None: the load is never begun again.
    needs_starts: Callable[[], bool] | None = None


def watch(
    running: RunningWork, components: Iterable[Component], settling: Settling, end: WatchEnd
) -> Mapping[str, Series] | TooManyFailures | None:
    """Read the samples of these components, from when their host has settled until there are enough, or no more.

    Args:
        running: Gives the samples of all that runs.
        components: Those to look at; all else that runs is not.
        settling: Says when the host has settled; what ended before is not a sample.

    Returns:
        The series by component; `TooManyFailures`: a component's jobs failed more often than its manifest allows; None:
        an end was asked for before there were enough.

    Raises:
        HostError: the host could not run the work.
    """
    limit_ms, needs_starts = end.limit_ms, end.needs_starts
    runs = {component.name: component.run for component in components}
    allowed = {name: run.failures if run is not None else 0 for name, run in runs.items()}
    failures: dict[str, list[str]] = {name: [] for name in allowed}
    is_periodic = any(run is not None and isinstance(run.arrival, Periodic) for run in runs.values())
    seen = _Seen(
        running=running,
        names=sorted(allowed),
        settling=settling,
        restarts=needs_starts is not None,
        least_starts=least_starts(is_periodic=is_periodic),
    )
    looks_at = next_look(0)
    for name, sample in running.samples():
        if end.should_stop():
            return None
        if name not in allowed:
            continue
        if sample.failure:
            failures[name].append(sample.failure)
            if len(failures[name]) > allowed[name]:
                return TooManyFailures(component=name, failures=tuple(failures[name]), allowed=allowed[name])
        if not seen.take(name, sample):
            continue
        is_late = running.elapsed_ms() >= limit_ms
        if (least := seen.least) >= (1 if is_late else looks_at) and (
            seen.has_enough_starts or is_late or not (needs_starts and needs_starts())
        ):
            looks_at, limit_ms = next_look(least), _LIMIT_GROWTH * limit_ms if is_late else limit_ms
            if seen.counted_ms >= settling.least_ms and end.is_enough(found := seen.series()):
                return found
            seen.look()
    return None if end.should_stop() else seen.series()


@dataclass(slots=True, kw_only=True)
class _Seen:
    """The samples of each component since its host had settled, without the time right after a load began again."""

    running: RunningWork
    names: Sequence[str]
    settling: Settling
    restarts: bool
    least_starts: int
    _are_alike: bool = False  # the starts, at the last look
    _samples: dict[str, list[Sample]] = field(default_factory=dict)
    _starts: dict[str, list[int]] = field(
        default_factory=dict
    )  # by component, the samples with which later starts begin
    _cpu_ms: dict[str, float | None] = field(default_factory=dict)  # by component, in what counts
    _since: "_Moment | None" = None  # since when samples count; None: not yet, or not now
    _counted_ms: float = 0.0  # before that
    _began_anew_ms: float | None = None  # when the load did, and has not settled yet
    _unsettled: str = ""  # why they count for no verdict

    def __post_init__(self) -> None:
        for name in self.names:
            self._samples[name], self._starts[name], self._cpu_ms[name] = [], [], 0.0

    @property
    def least(self) -> int:
        """How many samples there are of each component at least."""
        return min(map(len, self._samples.values()))

    @property
    def counted_ms(self) -> float:
        """How long samples have counted."""
        return self._counted_ms + (self.running.elapsed_ms() - self._since.elapsed_ms if self._since else 0.0)

    @property
    def has_enough_starts(self) -> bool:
        """Whether the load began as often as it must."""
        return not self.restarts or len(self._starts[self.names[0]]) >= self.least_starts - 1

    def look(self) -> None:
        """Look whether the starts so far are alike: then the next ones are longer."""
        if self.restarts and self.has_enough_starts:
            self._are_alike = not any(
                starts_differ(response_times(series.samples), answered_before(series, series.starts))
                for series in self.series().values()
            )

    def take(self, name: str, sample: Sample) -> bool:
        """Take a job that ended; False: it does not count, since something has yet to settle."""
        if self._since is None:
            self._settle(name)
            return False
        began_ms = sample.began_ms - self._since.elapsed_ms + self._counted_ms
        self._samples[name].append(replace(sample, began_ms=began_ms))
        if self.restarts and self._has_start_lasted():
            self._restart_load()
        return True

    def _settle(self, name: str) -> None:
        now = self.running.elapsed_ms()
        if self._began_anew_ms is not None:
            if now >= self._began_anew_ms + RESTART_WINDOWS * self.settling.scheduler_window_ms:
                self._began_anew_ms = None
                for each in self.names:
                    self._starts[each].append(len(self._samples[each]))
                self._since = self._mark()
            return
        self.settling.record_job(self.running, name)
        self.running.count_from_now()
        if self.settling.is_over(now):
            self._unsettled = self.settling.excess_message()
            self._since = self._mark()

    def _has_start_lasted(self) -> bool:
        """Return whether a start has its part of a setting's least duration and of a first look's samples.

        Where the starts so far are alike, a start lasts an eighth of all that counts.
        """
        assert self._since is not None
        least_ms = max(self.settling.least_ms / self.least_starts, self.counted_ms / STARTS if self._are_alike else 0.0)
        if self.running.elapsed_ms() - self._since.elapsed_ms < least_ms:
            return False
        in_start = (len(self._samples[each]) - (self._starts[each] or [0])[-1] for each in self.names)
        return min(in_start) * self.least_starts >= FIRST_LOOK

    def _restart_load(self) -> None:
        if not self.running.restart_load():
            self.restarts = False
            return
        self._count_until_now()
        self._since, self._began_anew_ms = None, self.running.elapsed_ms()

    def _count_until_now(self) -> None:
        assert self._since is not None
        self._counted_ms = self.counted_ms
        self._cpu_ms = {name: self._consumed(name) for name in self.names}

    def _consumed(self, name: str) -> float | None:
        before = self._cpu_ms[name]
        if self._since is None:
            return before
        began, now = self._since.cpu_ms[name], self.running.cpu_ms(name)
        return None if before is None or began is None or now is None else before + now - began

    def _mark(self) -> "_Moment":
        cpu_ms = {name: self.running.cpu_ms(name) for name in self.names}
        return _Moment(elapsed_ms=self.running.elapsed_ms(), cpu_ms=cpu_ms)

    def series(self) -> Mapping[str, Series]:
        """Return the series of each component so far."""
        if self._since is None and self._began_anew_ms is None:
            self._unsettled, self._since = "it ended during the settling time", self._mark()
        elapsed = self.counted_ms
        return {
            name: Series(
                component=name,
                samples=columns_of(samples),
                elapsed_ms=elapsed,
                cpu_ms=self._consumed(name),
                unsettled=self._unsettled,
                starts=tuple(start for start in self._starts[name] if 0 < start < len(samples)),
            )
            for name, samples in self._samples.items()
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class _Moment:
    """The moment from which samples count, and the processor time of the components until then."""

    elapsed_ms: float
    cpu_ms: Mapping[str, float | None]  # by component
