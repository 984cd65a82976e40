"""The samples of work that runs: from when its host has settled until there are enough, or no more.

Beside a load that never pauses: the host settles, a first start of the load counts, the load begins anew, some windows
of the scheduler are left out, the next start counts, and so on; at the looks of `next_look` it is asked whether this is
enough.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf

from rarms_iac.measuring.settling import Settling
from rarms_iac.model.outcomes import TooManyFailures
from rarms_iac.model.run import Periodic
from rarms_iac.model.series import Sample, Series, columns_of
from rarms_iac.model.system import Component
from rarms_iac.providers.measuring import RunningWork
from rarms_iac.statistics.error_probability import FIRST_LOOK, next_look
from rarms_iac.statistics.samples import response_times, starts_differ
from rarms_iac.statistics.setting_time import RESTART_WINDOWS, STARTS, least_starts
from rarms_iac.statistics.steady_state import answered_before

_LIMIT_GROWTH = 1.1
"""What was not enough at the limit is asked again when the limit is so many times as late."""


def watch(
    running: RunningWork,
    components: Iterable[Component],
    settling: Settling,
    is_enough: Callable[[Mapping[str, Series]], bool],
    should_stop: Callable[[], bool],
    *,
    limit_ms: float = inf,
    needs_starts: Callable[[], bool] | None = None,
) -> Mapping[str, Series] | TooManyFailures | None:
    """Read the samples of these components, from when their host has settled until there are enough, or no more.

    Args:
        running: Gives the samples of all that runs.
        components: Those to look at; all else that runs is not.
        settling: Says when the host has settled; what ended before is no sample.
        is_enough: Asked when every component has as many samples as `next_look` says, and the scheduler's memory has
            passed as often as it must.
        should_stop: Asked after every sample.
        limit_ms: Of the host's time since the work began: from then on one sample of each component is enough to ask
            `is_enough`, and again each time the limit has grown by a tenth.
        needs_starts: Whether the load must have begun `least_starts` times before `is_enough` is asked; asked from the
            first look on, until the load has. False: the samples are no point of a curve. None: the load is never
            begun anew.

    Returns:
        The series by component; `TooManyFailures`: a component's jobs failed more often than its manifest allows; None:
        an end was asked for before there were enough.

    Raises:
        HostError: the host could not run the work.
    """
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
        if should_stop():
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
            if seen.counted_ms >= settling.least_ms and is_enough(found := seen.series()):
                return found
            seen.look()
    return None if should_stop() else seen.series()


@dataclass(slots=True, kw_only=True)
class _Seen:
    """What was seen of each component since its host had settled, but for when a load had just begun anew."""

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
        """Whether a start lasted its part of what a setting lasts at least, and of the samples of a first look.

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
        """The series of each component so far."""
        if self._since is None and self._began_anew_ms is None:
            self._unsettled, self._since = "it ended before its host had settled", self._mark()
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
