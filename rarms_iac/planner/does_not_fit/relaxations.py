"""Changes of the manifest with which it would fit. Each is tried by planning it; none is guessed."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import islice

from rarms_iac.model.layout import Relaxation
from rarms_iac.planner.does_not_fit.larger import (
    memory_that_is_missing,
    more_memory,
    more_processors,
    more_processors_and_measuring,
)
from rarms_iac.planner.does_not_fit.levers import Lever, apts_of, one_lowered, reserves_of, several_lowered
from rarms_iac.planner.does_not_fit.pairs import layout_to_combine, pair_to_combine
from rarms_iac.planner.does_not_fit.unmeasured import to_be_measured_elsewhere
from rarms_iac.planner.does_not_fit.variants import Counted, Edit, Edits, Trial, Variant, told
from rarms_iac.planner.groups import Group
from rarms_iac.planner.problem import Problem

OFFERED = 4
"""More ways out than these are not read."""

TRIED_UP_TO = 60
"""Partitions up to which single reserves are tried: each try plans everything anew."""

TRIALS = 400
"""Plans that are made in all: then nothing more is offered."""


def relaxations(problem: Problem, conflict: Sequence[str], trial: Trial) -> tuple[Relaxation, ...]:
    """A few ways out, one of each kind before a second of any: moving, a lower APT, more of a host, a lower reserve.

    Where no single change is enough, several that are together. What may help and has to be measured stands last.
    """
    counted = replace(trial, may_work=Counted(works=trial.may_work, left=TRIALS))
    few = len(problem.groups) <= TRIED_UP_TO

    def planned(ways: Iterator[Edits]) -> list[Edits]:
        return list(islice((one for one in ways if trial.is_planned(one)), OFFERED))

    found = planned(_in_turns(_single(problem, conflict, counted, few=few)))
    found = found or planned(_together(problem, conflict, counted, few=few))
    may = list(_perhaps(problem, conflict, counted)) if few else []
    may += [one for one in (to_be_measured_elsewhere(problem, conflict),) if one]
    return (*(Relaxation(says=told(one)) for one in found), *(Relaxation(says=one, may=True) for one in may))


def _in_turns(kinds: Iterable[Iterator[Edits]]) -> Iterator[Edits]:
    """One of each in turn, until all are told; what is not asked for is not tried."""
    left = list(kinds)
    while left:
        for one in tuple(left):
            said = next(one, None)
            if said is None:
                left.remove(one)
            else:
                yield said


def _single(problem: Problem, conflict: Sequence[str], trial: Trial, *, few: bool) -> list[Iterator[Edits]]:
    kinds = [_moving(problem, trial)]
    if few:
        kinds.append(_lowered(lambda one: apts_of(one, problem), problem, conflict, trial))
    kinds += [more_memory(problem, trial), more_processors(trial)]
    if few:
        kinds.append(_lowered(reserves_of, problem, conflict, trial))
    return kinds


def _moving(problem: Problem, trial: Trial) -> Iterator[Edits]:
    edit = Edit("`--max-disruption removal`, which lets partitions move to another host", _may_move)
    if problem.now and not trial.start.may_move and trial.fits((edit,)):
        yield (edit,)


def _may_move(variant: Variant) -> Variant:
    return replace(variant, may_move=True)


def _lowered(
    levers_of: Callable[[Group], Iterator[Lever]], problem: Problem, conflict: Sequence[str], trial: Trial
) -> Iterator[Edits]:
    """One partition's, of the least critical first; where none alone is enough, several together.

    Who is not in the set that conflicts cannot help alone, but may together with one who is.
    """
    groups = _least_critical_first(problem)
    alone = False
    for group in [one for one in groups if one.name in conflict][:OFFERED]:
        found = next((edits for lever in levers_of(group) if (edits := one_lowered(lever, trial))), None)
        if found:
            alone = True
            yield found
    if not alone:
        several = several_lowered([lever for group in groups for lever in levers_of(group)], trial)
        if several:
            yield several


def _together(problem: Problem, conflict: Sequence[str], trial: Trial, *, few: bool) -> Iterator[Edits]:
    """Several changes of different kinds: more memory if that is missing, with each kind that then helps alone."""
    memory = memory_that_is_missing(problem, trial)
    rest = trial.after(memory)
    if memory and rest.fits(()):
        yield memory
        return
    nothing = True
    if memory:
        for edits in islice(_in_turns(_single(problem, conflict, rest, few=few)), OFFERED):
            nothing = False
            yield (*memory, *edits)
    if nothing and few:
        levers = [lever for one in _least_critical_first(problem) for lever in _levers(one, problem)]
        several = several_lowered(levers, rest)
        if several:
            yield (*memory, *several)


def _levers(group: Group, problem: Problem) -> Iterator[Lever]:
    yield from apts_of(group, problem)
    yield from reserves_of(group)


def _least_critical_first(problem: Problem) -> list[Group]:
    return sorted(problem.groups, key=lambda one: (one.criticality, one.name))


def _perhaps(problem: Problem, conflict: Sequence[str], trial: Trial) -> Iterator[str]:
    combined = pair_to_combine(conflict, problem, trial) or layout_to_combine(problem, trial)
    if combined:
        yield combined
    anew = more_processors_and_measuring(trial)
    if anew is not None:
        yield anew.says
