"""Changes of the manifest with which it would fit: a few of each kind, each planned before it is told."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import islice

from rarms_iac.model.layout import Relaxation
from rarms_iac.model.quantities import Bytes, show_bytes
from rarms_iac.model.system import Host
from rarms_iac.model.wording import in_a_row
from rarms_iac.planner import findings
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.infeasibility.edits import Edit, Edits, Trial, Variant, describe, larger_hosts, with_components
from rarms_iac.planner.infeasibility.lowering import (
    Lever,
    apt_levers,
    largest,
    lowered,
    reserve_levers,
    several_lowered,
)
from rarms_iac.planner.infeasibility.pairs import pairs_to_combine
from rarms_iac.planner.packing.values import free_in
from rarms_iac.planner.problem import HostView, Problem, by_name
from rarms_iac.planner.reservations import NotMeasured, rests_on_a_log

OFFERED = 4
"""More ways out than these are not read; and no more hosts, or partitions of a conflict, are tried for one."""

MORE_PROCESSORS = 8
_MIB = 2**20


def ways_out(problem: Problem, conflict: Sequence[str], trial: Trial) -> tuple[Relaxation, ...]:
    """Find changes with which everything fits.

    Args:
        problem: What has no layout.
        conflict: Names of the partitions that cannot share their hosts.
        trial: Plans changed manifests, and ends the search.

    Returns:
        Up to `OFFERED` changes that are enough, one of each kind before a second of any: moving, a lower APT, more of a
        host, a lower reserve; where no single one is enough, more memory with another. Then those that may help and
        have to be measured.
    """
    single = list(islice(_in_turns(_single(problem, conflict, trial)), OFFERED))
    if not single:
        memory = next((edits for edits in _more_memory(problem, trial, processors_too=True)), ())
        rest = _in_turns(_single(problem, conflict, trial.after(memory))) if memory else iter(())
        single = [(*memory, *edits) for edits in islice(rest, OFFERED)]
    perhaps = [
        *filter(None, [pairs_to_combine(problem, conflict, trial)]),
        *islice(_more_processors_to_measure(trial), 1),
        *_to_measure_elsewhere(problem, conflict),
    ]
    sure = [Relaxation(says=describe(edits)) for edits in single]
    return (*sure, *(Relaxation(says=message, may=True) for message in perhaps))


def _in_turns(kinds: Iterable[Iterator[Edits]]) -> Iterator[Edits]:
    waiting = list(kinds)
    while waiting:
        for kind in tuple(waiting):
            edits = next(kind, None)
            if edits is None:
                waiting.remove(kind)
            else:
                yield edits


def _single(problem: Problem, conflict: Sequence[str], trial: Trial) -> list[Iterator[Edits]]:
    return [
        _moving(problem, trial),
        _lowered(lambda group: apt_levers(group, problem), problem, conflict, trial),
        _more_memory(problem, trial),
        _more_processors(trial),
        _lowered(reserve_levers, problem, conflict, trial),
    ]


def _moving(problem: Problem, trial: Trial) -> Iterator[Edits]:
    edit = Edit(
        "`--max-disruption removal`, which lets partitions move to another host",
        lambda start: replace(start, may_move=True),
    )
    if problem.now and not trial.start.may_move and trial.fits((edit,), by_first_fit=False):
        yield (edit,)


def _lowered(
    levers_of: Callable[[Group], Iterator[Lever]], problem: Problem, conflict: Sequence[str], trial: Trial
) -> Iterator[Edits]:
    """One partition's of the conflict, the least critical first; where none alone is enough, several together."""
    groups = sorted(problem.groups, key=lambda group: (group.criticality, group.name))
    alone = False
    for group in [group for group in groups if group.name in conflict][:OFFERED]:
        edits = next((found for lever in levers_of(group) if (found := lowered(lever, trial))), None)
        if edits:
            alone = True
            yield edits
    if not alone:
        several = several_lowered([lever for group in groups for lever in levers_of(group)], trial)
        if several:
            yield several


def _more_memory(problem: Problem, trial: Trial, *, processors_too: bool = False) -> Iterator[Edits]:
    """On one host as little as helps; where processors lack too, as much as all who may run there claim."""
    for host in problem.bins[:OFFERED]:
        claimed = sum(item.claims[host.name].memory for item in problem.items if host.name in item.claims)
        most = -(-(claimed - free_in(host).memory) // _MIB)
        if processors_too and most > 0:
            yield (_memory(trial.start, host.name, most),)
        elif most > 0:
            less = largest(most, lambda less: trial.fits((_memory(trial.start, host.name, most - less),)))  # noqa: B023
            if less is not None:
                yield (_memory(trial.start, host.name, most - less),)


def _memory(variant: Variant, name: str, mib: int) -> Edit:
    host, view = variant.system.hosts[name], variant.views.get(name, HostView())
    there = int(host.memory) if view.facts is None else min(host.memory, view.facts.memory)
    more = Bytes(there + mib * _MIB)
    if view.facts is not None:
        view = replace(view, facts=replace(view.facts, memory=max(view.facts.memory, more)))
    after = replace(host, memory=max(host.memory, more))
    return larger_hosts(f"{show_bytes(mib * _MIB)} more memory on {name}", {name: after}, {name: view}, logs_hold=True)


def _more_processors(trial: Trial) -> Iterator[Edits]:
    """As few as help, where nothing that was measured on fewer is believed."""
    for hosts in _hosts_by_platform(trial.start):
        edit = _fewest_processors(hosts, trial, logs_hold=False)
        if edit is not None:
            yield (edit,)


def _more_processors_to_measure(trial: Trial) -> Iterator[str]:
    """The same where reservations rest on logs, if everybody needs the same CR of as many processors as now."""
    for hosts in _hosts_by_platform(trial.start):
        groups = [group for group in groups_of(trial.start.system) if rests_on_a_log(group)]
        width = hosts[0].logical_processors
        wide = sorted(
            member.name
            for group in groups
            for member in group.members
            if group.request.processors is None and member.processors is None
        )
        components = trial.start.system.components
        given = {name: replace(components[name], processors=width) for name in wide}
        after = trial.after((Edit("", lambda variant: with_components(variant, given)),))  # noqa: B023
        edit = _fewest_processors(hosts, after, logs_hold=True) if groups else None
        if edit is not None:
            fixed = f", with `processors: {width}` for {in_a_row(wide)} as now" if wide else ""
            yield f"{edit.message} may be enough{fixed}: what they then need has to be measured there (`rarms measure`)"


def _hosts_by_platform(variant: Variant) -> list[tuple[Host, ...]]:
    """Hosts by platform: they share what was measured, so that more of one is more of each."""
    platforms: dict[str, list[Host]] = {}
    for host in by_name(variant.system.hosts):
        platforms.setdefault(host.platform, []).append(host)
    return [tuple(hosts) for hosts in platforms.values()][:OFFERED]


def _fewest_processors(hosts: Sequence[Host], trial: Trial, *, logs_hold: bool) -> Edit | None:
    edits = [_processors(trial.start, hosts, more, logs_hold=logs_hold) for more in range(1, MORE_PROCESSORS + 1)]
    return next((edit for edit in edits if trial.fits((edit,))), None) if trial.fits(edits[-1:]) else None


def _processors(variant: Variant, hosts: Sequence[Host], more: int, *, logs_hold: bool) -> Edit:
    after, views = {}, {}
    for host in hosts:
        view = variant.views.get(host.name, HostView())
        there = host.logical_processors
        if view.facts is not None:
            there = min(there, view.facts.logical_processors)
            many = max(view.facts.logical_processors, there + more)
            views[host.name] = replace(view, facts=replace(view.facts, logical_processors=many))
        after[host.name] = replace(host, logical_processors=max(host.logical_processors, there + more))
    where = hosts[0].name if len(hosts) == 1 else f"each of {in_a_row([host.name for host in hosts])}"
    added = "one more logical processor" if more == 1 else f"{more} more logical processors"
    return larger_hosts(f"{added} on {where}", after, views, logs_hold=logs_hold)


def _to_measure_elsewhere(problem: Problem, conflict: Sequence[str]) -> Iterator[str]:
    """Hosts that nobody of the conflict may use yet, only because nothing was measured there."""

    def is_unknown(group: Group, host: Host) -> bool:
        if host.name in problem.claims[group.name] or not rests_on_a_log(group):
            return False
        if any(member.hosts is not None and host.name not in member.hosts for member in group.members):
            return False
        answer = problem.reservations.reservation(group.members, host)
        return isinstance(answer, NotMeasured) and answer.code == findings.UNMEASURED.code

    groups = [group for group in problem.groups if group.name in conflict]
    hosts = [host.name for host in by_name(problem.system.hosts) if any(is_unknown(group, host) for group in groups)]
    if hosts:
        options = " ".join(f"--host {name}" for name in hosts)
        yield f"measuring on {in_a_row(hosts)} may help: nothing says what they need there (`rarms measure {options}`)"
