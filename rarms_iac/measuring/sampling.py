"""The samples of work that runs: from when its host has settled until there are enough, or no more."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from math import inf

from rarms_iac.measuring.settling import Settling
from rarms_iac.model.outcomes import TooManyFailures
from rarms_iac.model.series import Sample, Series, columns_of
from rarms_iac.model.system import Component
from rarms_iac.providers.measuring import RunningWork
from rarms_iac.statistics.error_probability import next_look


def watch(
    running: RunningWork,
    components: Iterable[Component],
    settling: Settling,
    is_enough: Callable[[Mapping[str, Series]], bool],
    should_stop: Callable[[], bool],
    limit_ms: float = inf,
) -> Mapping[str, Series] | TooManyFailures | None:
    """Read the samples of these components, from when their host has settled until there are enough, or no more.

    Args:
        running: Gives the samples of all that runs.
        components: Those to look at; all else that runs is not.
        settling: Says when the host has settled; what ended before is no sample.
        is_enough: Asked when every component has as many samples as `next_look` says, and the scheduler's memory has
            passed as often as it must.
        should_stop: Asked after every sample.
        limit_ms: Of the host's time since the work began: from then on `is_enough` is asked at any count.

    Returns:
        The series by component; `TooManyFailures`: a component's jobs failed more often than its manifest allows; None:
        an end was asked for before there were enough.

    Raises:
        HostError: the host could not run the work.
    """
    allowed = {component.name: component.run.failures if component.run is not None else 0 for component in components}
    samples: dict[str, list[Sample]] = {name: [] for name in sorted(allowed)}
    failures: dict[str, list[str]] = {name: [] for name in samples}
    looks_at = next_look(0)
    start: _CountingStart | None = None
    for name, sample in running.samples():
        if should_stop():
            return None
        if name not in samples:
            continue
        if sample.failure:
            failures[name].append(sample.failure)
            if len(failures[name]) > allowed[name]:
                return TooManyFailures(component=name, failures=tuple(failures[name]), allowed=allowed[name])
        if start is None:
            settling.record_job(running, name)
            running.count_from_now()
            if settling.is_over(running.elapsed_ms()):
                start = _begin_counting(running, samples, settling.excess_message())
            continue
        samples[name].append(replace(sample, began_ms=sample.began_ms - start.elapsed_ms))
        is_late = running.elapsed_ms() >= limit_ms
        if (least := min(map(len, samples.values()))) >= (1 if is_late else looks_at):
            looks_at, limit_ms = next_look(least), _LATER * limit_ms if is_late else limit_ms
            seen = _series(running, samples, start)
            if running.elapsed_ms() - start.elapsed_ms >= settling.least_ms and is_enough(seen):
                return seen
    if should_stop():
        return None
    return _series(running, samples, start or _begin_counting(running, samples, "it ended before its host had settled"))


_LATER = 1.1
"""What was not enough at the limit is asked again after so many times as long."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _CountingStart:
    """Where samples begin to count."""

    elapsed_ms: float
    cpu_ms: Mapping[str, float | None]  # by component
    unsettled: str  # why they count for no verdict


def _begin_counting(running: RunningWork, names: Iterable[str], unsettled: str) -> _CountingStart:
    return _CountingStart(
        elapsed_ms=running.elapsed_ms(), cpu_ms={name: running.cpu_ms(name) for name in names}, unsettled=unsettled
    )


def _series(running: RunningWork, samples: Mapping[str, list[Sample]], start: _CountingStart) -> Mapping[str, Series]:
    elapsed = running.elapsed_ms() - start.elapsed_ms
    return {
        name: Series(
            component=name,
            samples=columns_of(seen),
            elapsed_ms=elapsed,
            cpu_ms=_consumed_since(running.cpu_ms(name), start.cpu_ms[name]),
            unsettled=start.unsettled,
        )
        for name, seen in samples.items()
    }


def _consumed_since(now: float | None, before: float | None) -> float | None:
    return None if now is None or before is None else now - before
