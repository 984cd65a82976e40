"""Changes of the manifest with which it would fit. Each is tried by planning it; none is guessed."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Protocol

from rarms_iac.model.layout import Relaxation
from rarms_iac.model.quantities import (
    Bytes,
    Percent,
    ShareOfHost,
    in_processors,
    show_amount,
    show_bytes,
    show_percent,
)
from rarms_iac.model.system import Component, Host, Measured, System
from rarms_iac.planner.problem import HostView, Problem
from rarms_iac.planner.search import free_in

OFFERED = 4
"""More ways out than these are not read."""

TRIED_UP_TO = 60
"""Partitions up to which single reserves are tried: each try plans everything anew."""

MORE_PROCESSORS = 8
_MIB = 2**20


class Works(Protocol):
    """Whether everything fits with this manifest on these hosts."""

    def __call__(self, system: System, views: Mapping[str, HostView], *, moving: bool) -> bool:
        """Plan it; `moving`: partitions may leave their hosts."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """What is varied, and how a variation is tried."""

    system: System
    views: Mapping[str, HostView]
    works: Works


def relaxations(problem: Problem, conflict: Sequence[str], trial: Trial) -> tuple[Relaxation, ...]:
    """A few ways out, those that cost the least first: moving, lower reserves, more memory, more processors."""
    found = [*_moving(problem, trial), *_larger(problem, trial)]
    if len(problem.groups) <= TRIED_UP_TO:
        found += _lower(problem, conflict, trial)
    return tuple(Relaxation(says=says) for says in found[:OFFERED])


def _moving(problem: Problem, trial: Trial) -> Iterator[str]:
    if problem.now and trial.works(trial.system, trial.views, moving=True):
        yield "`--max-disruption removal`, which lets partitions move to another host"


def _lower(problem: Problem, conflict: Sequence[str], trial: Trial) -> Iterator[str]:
    """One reserve lowered as little as helps, of the least critical first."""
    groups = sorted(
        (one for one in problem.groups if one.name in conflict), key=lambda one: (one.criticality, one.name)
    )
    for group in groups[:OFFERED]:
        for component in reversed(group.members):
            lowered = _lowered(component, next(iter(problem.claims[group.name])), trial)
            if lowered is not None:
                yield lowered
                break


def _lowered(component: Component, host: str, trial: Trial) -> str | None:
    reserve = component.cpu.reserve
    if reserve is None or isinstance(reserve, Measured):
        return None
    whole = trial.system.hosts[host].logical_processors
    share = int(100 * in_processors(reserve, whole) / whole)

    def with_share(percent: int) -> System:
        cpu = replace(component.cpu, reserve=ShareOfHost(Percent(Fraction(percent))))
        changed = {**trial.system.components, component.name: replace(component, cpu=cpu)}
        return replace(trial.system, components=changed)

    best = _largest(1, share - 1, lambda percent: trial.works(with_share(percent), trial.views, moving=False))
    if best is None:
        return None
    return f"{component.name} reserves {show_percent(best)} instead of {show_amount(reserve)}"


def _largest(low: int, high: int, works: Callable[[int], bool]) -> int | None:
    """The largest number that works, where every smaller one does too."""
    if high < low or not works(low):
        return None
    while low < high:
        middle = (low + high + 1) // 2
        if works(middle):
            low = middle
        else:
            high = middle - 1
    return low


def _larger(problem: Problem, trial: Trial) -> Iterator[str]:
    """More memory, more processors, on one of the first hosts: each try plans everything anew."""
    first = problem.bins[:OFFERED]
    for one in first:
        host = trial.system.hosts[one.name]
        claimed = sum(min(claim.memory for claim in item.claims.values()) for item in problem.items)
        missing = claimed - sum(max(0, free_in(other).memory) for other in problem.bins)
        if missing > 0:
            more = -(-missing // _MIB) * _MIB
            if _works_with(trial, host, memory=more):
                yield f"{show_bytes(more)} more memory on {host.name}"
    for one in first:
        host = trial.system.hosts[one.name]
        number = next(
            (more for more in range(1, MORE_PROCESSORS + 1) if _works_with(trial, host, processors=more)),
            None,
        )
        if number is not None:
            yield f"{'one' if number == 1 else number} more logical processor{'s' if number > 1 else ''} on {host.name}"


def _works_with(trial: Trial, host: Host, *, processors: int = 0, memory: int = 0) -> bool:
    """Whether it fits where the host has so much more: in the manifest and, where it was seen, in fact."""
    view = trial.views.get(host.name, HostView())
    has = (host.logical_processors, int(host.memory))
    if view.facts is not None:
        has = min(has[0], view.facts.logical_processors), min(has[1], view.facts.memory)
        facts = replace(view.facts, logical_processors=has[0] + processors, memory=has[1] + memory)
        view = replace(view, facts=facts)
    larger = replace(
        host,
        logical_processors=max(host.logical_processors, has[0] + processors),
        memory=Bytes(max(host.memory, has[1] + memory)),
    )
    system = replace(trial.system, hosts={**trial.system.hosts, host.name: larger})
    return trial.works(system, {**trial.views, host.name: view}, moving=False)
