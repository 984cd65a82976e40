"""Looking at components at work: samples become series, and somebody says when there are enough of them."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from rarms_iac.model.measurement import Sample, Series
from rarms_iac.model.system import Component
from rarms_iac.providers.measuring import Running

FIRST_LOOK = 20
"""Samples of a component before anybody looks: fewer say nothing, and early ends cause the rare large errors."""

GROWTH = 1.2
"""By how much more there is at the next look: a look costs as much as it has samples to read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """What the samples so far come to."""

    enough: bool  # no more of them are needed
    says: str  # for people


@dataclass(frozen=True, slots=True, kw_only=True)
class TooManyFailed:
    """More samples of a component failed than its `run.failures` allows."""

    component: str
    failures: tuple[str, ...]  # why each failed, in order


def watch(
    running: Running,
    components: Iterable[Component],
    look: Callable[[Mapping[str, Series]], Look],
    should_stop: Callable[[], bool],
) -> Mapping[str, Series] | TooManyFailed | None:
    """All samples of these components, by name, until `look` has enough, or there are no more.

    `look` is asked each time that every component has 20 samples and a fifth more than when it was last asked. None:
    somebody asked for an end.
    """
    allowed = {one.name: one.run.failures if one.run is not None else 0 for one in components}
    seen: dict[str, list[Sample]] = {name: [] for name in sorted(allowed)}
    failed: dict[str, list[str]] = {name: [] for name in seen}
    next_look = FIRST_LOOK
    for name, sample in running.samples():
        if should_stop():
            return None
        if name not in seen:
            continue
        seen[name].append(sample)
        if sample.failure:
            failed[name].append(sample.failure)
            if len(failed[name]) > allowed[name]:
                return TooManyFailed(component=name, failures=tuple(failed[name]))
        if (least := min(map(len, seen.values()))) >= next_look:
            next_look = max(least + 1, int(least * GROWTH))
            if look(series_of(running, seen)).enough:
                break
    return None if should_stop() else series_of(running, seen)


def series_of(running: Running, seen: Mapping[str, list[Sample]]) -> Mapping[str, Series]:
    """What was seen so far, by component name."""
    elapsed = running.elapsed_ms()
    return {
        name: Series(component=name, samples=tuple(samples), elapsed_ms=elapsed, cpu_ms=running.cpu_ms(name))
        for name, samples in seen.items()
    }
