"""Changes of the manifest with which it would fit. Each is tried by planning it; none is guessed."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import islice
from typing import Protocol

from rarms_iac.model.layout import Relaxation
from rarms_iac.model.plan import Claim
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
from rarms_iac.planner.does_not_fit import pairs
from rarms_iac.planner.does_not_fit.relaxed_apts import one_relaxed, several_relaxed, slack_of
from rarms_iac.planner.first_fit import free_in
from rarms_iac.planner.groups import Group
from rarms_iac.planner.prediction.members import alone_in, predictor_of
from rarms_iac.planner.problem import HostView, Problem

OFFERED = 4
"""More ways out than these are not read."""

TOGETHER = 12
"""Partitions whose APTs are relaxed together at most."""

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
    """A few ways out, one of each kind before a second of any: moving, a lower APT, more of a host, a lower reserve.

    Which pair to combine stands last: it may help, and what it needs has to be measured.
    """
    few = len(problem.groups) <= TRIED_UP_TO
    kinds = [
        _moving(problem, trial),
        _apts(problem, conflict, trial) if few else iter(()),
        _larger(problem, trial),
        _lower(problem, conflict, trial) if few else iter(()),
    ]
    found = [Relaxation(says=says) for says in islice(_in_turns(kinds), OFFERED)]
    pair = _pair(problem, conflict, trial) if few else None
    return tuple([*found, Relaxation(says=pair, may=True)] if pair else found)


def _in_turns(kinds: Iterable[Iterator[str]]) -> Iterator[str]:
    """One of each in turn, until all are told; what is not asked for is not tried."""
    left = list(kinds)
    while left:
        for one in tuple(left):
            said = next(one, None)
            if said is None:
                left.remove(one)
            else:
                yield said


def _least_critical_first(problem: Problem, conflict: Sequence[str]) -> list[Group]:
    return sorted((one for one in problem.groups if one.name in conflict), key=lambda one: (one.criticality, one.name))


def _apts(problem: Problem, conflict: Sequence[str], trial: Trial) -> Iterator[str]:
    """One partition's APTs, of the least critical first; where none alone is enough, several together.

    Who is not in the smallest set that conflicts cannot help alone, but may together with one who is.
    """
    slacks = [
        slack
        for group in _least_critical_first(problem, [one.name for one in problem.groups])
        if (slack := slack_of(group, trial.system.hosts[next(iter(problem.claims[group.name]))], problem.reservations))
    ]

    def fits(system: System) -> bool:
        return trial.works(system, trial.views, moving=False)

    alone = False
    conflicting = [one for one in slacks if one.group.name in conflict]
    for said in one_relaxed(conflicting[:OFFERED], trial.system, fits):
        alone = True
        yield said
    if not alone:
        together = several_relaxed(slacks[:TOGETHER], trial.system, fits)
        if together:
            yield together


def _pair(problem: Problem, conflict: Sequence[str], trial: Trial) -> str | None:
    """On one host the two are looked at as they are there; several hosts are `rarms tune`'s to weigh."""
    if len(trial.system.hosts) != 1:
        return None
    (host,) = trial.system.hosts.values()

    def claimed(group: Group) -> Claim | None:
        return problem.claims[group.name].get(host.name)

    def fits(system: System) -> bool:
        return trial.works(system, trial.views, moving=False)

    predictor = predictor_of(alone_in(problem.groups, problem.reservations, host))
    tried = pairs.Trial(system=trial.system, host=host, claimed=claimed, fits=fits, predictor=predictor)
    return pairs.pair_to_combine(_least_critical_first(problem, conflict), tried)


def _moving(problem: Problem, trial: Trial) -> Iterator[str]:
    if problem.now and trial.works(trial.system, trial.views, moving=True):
        yield "`--max-disruption removal`, which lets partitions move to another host"


def _lower(problem: Problem, conflict: Sequence[str], trial: Trial) -> Iterator[str]:
    """One reserve lowered as little as helps, of the least critical first."""
    for group in _least_critical_first(problem, conflict)[:OFFERED]:
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
