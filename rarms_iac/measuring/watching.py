"""Looking at components at work: samples become series, and somebody says when there are enough of them."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from rarms_iac.model.measurement import Sample, Series
from rarms_iac.model.system import Component
from rarms_iac.providers.measuring import Running
from rarms_iac.statistics.verdicts import next_look


@dataclass(frozen=True, slots=True, kw_only=True)
class TooManyFailed:
    """More samples of a component failed than its `run.failures` allows."""

    component: str
    failures: tuple[str, ...]  # why each failed, in order


def watch(
    running: Running,
    components: Iterable[Component],
    is_enough: Callable[[Mapping[str, Series]], bool],
    should_stop: Callable[[], bool],
) -> Mapping[str, Series] | TooManyFailed | None:
    """All samples of these components, by name, until somebody has enough, or there are no more.

    `is_enough` is asked when every component has as many samples as `next_look` says. None: an end was asked for.
    """
    allowed = {component.name: component.run.failures if component.run is not None else 0 for component in components}
    seen: dict[str, list[Sample]] = {name: [] for name in sorted(allowed)}
    failed: dict[str, list[str]] = {name: [] for name in seen}
    looks_at = next_look(0)
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
        if (least := min(map(len, seen.values()))) >= looks_at:
            looks_at = next_look(least)
            if is_enough(series_of(running, seen)):
                break
    return None if should_stop() else series_of(running, seen)


def series_of(running: Running, seen: Mapping[str, list[Sample]]) -> Mapping[str, Series]:
    """What was seen so far, by component name."""
    elapsed = running.elapsed_ms()
    return {
        name: Series(component=name, samples=tuple(samples), elapsed_ms=elapsed, cpu_ms=running.cpu_ms(name))
        for name, samples in seen.items()
    }
