"""More of a host: memory, or logical processors, as the manifest would say it then.

What was measured on a host holds for as many logical processors as it had. So where something rests on a data log it
is not known what would fit on a larger one, and the message says what may be enough and has to be measured anew.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from rarms_iac.model.quantities import Bytes, LogicalProcessors, ProcessorTime, show_bytes
from rarms_iac.model.system import CpuWish, Host
from rarms_iac.model.wording import in_a_row
from rarms_iac.planner.does_not_fit.levers import largest
from rarms_iac.planner.does_not_fit.variants import (
    Edit,
    Edits,
    Trial,
    Variant,
    flat,
    hosts_become,
    processors_given,
    without_logs,
)
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.placing.first_fit import free_in
from rarms_iac.planner.problem import HostView, Problem
from rarms_iac.planner.reservations import rests_on_a_log

HOSTS = 4
"""Hosts, or kinds of them, of which more is tried."""

MORE_PROCESSORS = 8
_MIB = 2**20


def more_memory(problem: Problem, trial: Trial) -> Iterator[Edits]:
    """On one host, as little as helps."""
    for name, most in _could_use(problem)[:HOSTS]:
        found = _least_memory(name, most, trial)
        if found is not None:
            yield (found,)


def memory_that_is_missing(problem: Problem, trial: Trial) -> Edits:
    """What memory must be added if nothing but memory counted: on one host, the least of all; or on several."""
    light = replace(trial, start=_without_reserves(trial.start))
    if light.fits(()):
        return ()
    could = _could_use(problem)[:HOSTS]
    alone = [found for name, most in could for found in _sized_memory(name, most, light)]
    if alone:
        return (min(alone, key=lambda one: one[0])[1],)
    chosen: list[Edits] = [(_memory(light.start, name, most),) for name, most in could]
    if not light.fits(flat(chosen)):
        return ()
    for at, (name, most) in enumerate(could):
        rest = light.after(flat(chosen[:at] + chosen[at + 1 :]))
        least = None if rest.fits(()) else _least_memory(name, most, rest)
        chosen[at] = () if rest.fits(()) else chosen[at] if least is None else (least,)
    return flat(chosen)


def _could_use(problem: Problem) -> list[tuple[str, int]]:
    """Hosts by name that all who may run there would overfill, with the MiB that would then be missing."""
    found = []
    for one in problem.bins:
        claimed = sum(item.claims[one.name].memory for item in problem.items if one.name in item.claims)
        missing = claimed - free_in(one).memory
        if missing > 0:
            found.append((one.name, -(-missing // _MIB)))
    return found


def _least_memory(name: str, most: int, trial: Trial) -> Edit | None:
    return next((edit for _, edit in _sized_memory(name, most, trial)), None)


def _sized_memory(name: str, most: int, trial: Trial) -> Iterator[tuple[int, Edit]]:
    less = largest(most, lambda less: trial.fits((_memory(trial.start, name, most - less),)))
    if less is not None:
        yield most - less, _memory(trial.start, name, most - less)


def _memory(variant: Variant, name: str, mib: int) -> Edit:
    host, view = variant.system.hosts[name], variant.views.get(name, HostView())
    has = int(host.memory) if view.facts is None else min(host.memory, view.facts.memory)
    more = mib * _MIB
    if view.facts is not None:
        view = replace(view, facts=replace(view.facts, memory=max(view.facts.memory, has + more)))
    larger = replace(host, memory=Bytes(max(host.memory, has + more)))
    return hosts_become({name: larger}, {name: view}, f"{show_bytes(more)} more memory on {name}")


def _without_reserves(variant: Variant) -> Variant:
    """As if nobody reserved anything."""
    none, system = CpuWish(reserve=ProcessorTime(LogicalProcessors(Fraction(0)))), variant.system
    components = {name: replace(one, cpu=none) for name, one in system.components.items()}
    partitions = {name: replace(one, cpu=none) for name, one in system.partitions.items()}
    return replace(variant, system=replace(system, components=components, partitions=partitions))


def more_processors(trial: Trial) -> Iterator[Edits]:
    """As few as help, with every data log of a host that is not what it was left out."""
    for hosts in _kinds(trial.start)[:HOSTS]:
        number = _fewest(hosts, trial, measured_anew=False)
        if number is not None:
            yield (_processors(trial.start, hosts, number, measured_anew=False),)


@dataclass(frozen=True, slots=True, kw_only=True)
class Anew:
    """Logical processors that may be enough, and whom to give as many virtual ones as they were measured with."""

    says: str
    edits: Edits


def more_processors_and_measuring(trial: Trial) -> Anew | None:
    """The same where reservations rest on data logs: enough if everybody needs the same CR of the same processors.

    A partition has as many virtual processors as its host has logical ones, and its reservation is of each of them:
    so it would grow with its host. It does not where `processors` is given.
    """
    for hosts in _kinds(trial.start)[:HOSTS]:
        groups = _measured_there(trial.start, hosts)
        if not groups:
            continue
        open_, width = _open(groups), hosts[0].logical_processors
        given = Edit("", processors_given(open_, width))
        after = trial.after((given,))
        number = _fewest(hosts, after, measured_anew=True)
        more = None if number is None else _processors(after.start, hosts, number, measured_anew=True)
        if more is not None and after.is_planned((more,)):
            names = sorted({one.name for group in groups for one in group.members})
            fixed = f", with `processors: {width}` for {in_a_row(open_)} as now" if open_ else ""
            who = "they" if open_ == names else in_a_row(names)
            says = f"{more.says} may be enough{fixed}: what {who} then need has to be measured there (`rarms measure`)"
            return Anew(says=says, edits=(given, more))
    return None


def _kinds(variant: Variant) -> list[tuple[Host, ...]]:
    """Hosts of one platform stay alike, since they share what was measured: more of one is more of each."""
    kinds: dict[str, list[Host]] = {}
    for _, host in sorted(variant.system.hosts.items()):
        kinds.setdefault(host.platform, []).append(host)
    return [tuple(hosts) for hosts in kinds.values()]


def _measured_there(variant: Variant, hosts: Sequence[Host]) -> list[Group]:
    """Partitions that rest on a data log, where all of those may run on these hosts alone."""
    names, found = {one.name for one in hosts}, []
    for group in filter(rests_on_a_log, groups_of(variant.system)):
        limits = [set(one.hosts) for one in group.members if one.hosts is not None]
        may_run = set(variant.system.hosts).intersection(*limits)
        if may_run <= names:
            found.append(group)
        elif may_run & names:
            return []
    return found


def _open(groups: Sequence[Group]) -> list[str]:
    """Components whose partition is as wide as its host."""
    wide = [group for group in groups if group.wish.processors is None]
    return sorted(one.name for group in wide for one in group.members if one.processors is None)


def _fewest(hosts: Sequence[Host], trial: Trial, *, measured_anew: bool) -> int | None:
    def works(more: int) -> bool:
        return trial.fits((_processors(trial.start, hosts, more, measured_anew=measured_anew),))

    if not works(MORE_PROCESSORS):
        return None
    return next((more for more in range(1, MORE_PROCESSORS) if works(more)), MORE_PROCESSORS)


def _processors(variant: Variant, hosts: Sequence[Host], more: int, *, measured_anew: bool) -> Edit:
    larger, seen = _larger(variant, hosts, more)
    number = "one" if more == 1 else str(more)
    where = hosts[0].name if len(hosts) == 1 else f"each of {in_a_row([one.name for one in hosts])}"
    says = f"{number} more logical processor{'' if more == 1 else 's'} on {where}"
    edit = hosts_become(larger, seen, says)
    if measured_anew:
        return edit
    return Edit(says, lambda before: without_logs(edit.of(before), larger))


def _larger(variant: Variant, hosts: Sequence[Host], more: int) -> tuple[Mapping[str, Host], Mapping[str, HostView]]:
    """In the manifest, alike on all of them; and in fact, where they were seen."""
    has = {}
    seen = {}
    for host in hosts:
        view = variant.views.get(host.name, HostView())
        has[host.name] = host.logical_processors
        if view.facts is not None:
            has[host.name] = min(host.logical_processors, view.facts.logical_processors)
            there = max(view.facts.logical_processors, has[host.name] + more)
            seen[host.name] = replace(view, facts=replace(view.facts, logical_processors=there))
    said = max(max(one.logical_processors, has[one.name] + more) for one in hosts)
    return {one.name: replace(one, logical_processors=said) for one in hosts}, seen
