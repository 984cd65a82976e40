"""Changes of the manifest with which it would fit: a few of each kind, each planned before it is told."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import chain, islice, zip_longest

from rarms_iac.model.layout import Relaxation
from rarms_iac.planner.groups import Group
from rarms_iac.planner.infeasibility.edits import Edit, Edits, Lever, Trials, Variant, describe, smallest_edits
from rarms_iac.planner.infeasibility.levers import (
    apt_levers,
    memory_levers,
    narrowing_levers,
    pair_levers,
    processor_levers,
    reserve_levers,
)
from rarms_iac.planner.problem import Problem

OFFERED = 4
"""More ways out than these are not read; and no more levers of a kind are tried alone."""

PAIRS = 30
"""Pairs that are planned alone."""


def ways_out(problem: Problem, conflict: Sequence[str], start: Variant) -> tuple[Relaxation, ...]:
    """Find changes with which everything fits.

    Args:
        problem: What has no layout.
        conflict: Names of the partitions that cannot share their hosts.
        start: What the problem was made of.

    Returns:
        Up to `OFFERED` changes that are enough, one of each kind before a second of any: moving, a lower APT, more of a
        host, a lower reserve. Before them fewer processors for components that cannot use theirs, which costs nothing;
        after them what else may be enough, and has to be measured.
    """
    trials = Trials(start=start)
    groups = sorted(problem.groups, key=lambda group: (group.criticality, group.name))
    memory = list(islice(memory_levers(problem), OFFERED))
    processors = list(islice(processor_levers(problem), OFFERED))
    kinds = (
        _moving(problem, trials),
        _of_kind(chain.from_iterable(apt_levers(group, problem) for group in groups), memory, conflict, trials),
        _of_kind(memory, (), conflict, trials),
        _of_kind((lever for lever in processors if not lever.to_be_measured), memory, conflict, trials),
        _of_kind(chain.from_iterable(map(reserve_levers, groups)), memory, conflict, trials),
    )
    in_turns = (describe(edits) for turn in zip_longest(*kinds, fillvalue=()) for edits in turn if edits)
    sure = list(islice(dict.fromkeys(in_turns), OFFERED))
    perhaps = (*_combining(problem, conflict, trials), *_more_processors(processors, trials))
    return (
        *(Relaxation(message=way, may=True) for way in _narrowing(groups, problem, conflict, trials)),
        *(Relaxation(message=way) for way in sure),
        *(Relaxation(message=way, may=True) for way in perhaps),
    )


def _moving(problem: Problem, trials: Trials) -> Iterator[Edits]:
    edit = Edit(
        "`--max-disruption removal`, which lets partitions move to another host",
        lambda variant: replace(variant, may_move=True),
    )
    if problem.current_hosts and not trials.start.may_move and trials.fits((edit,), by_first_fit=False):
        yield (edit,)


def _of_kind(
    levers: Iterable[Lever], memory: Sequence[Lever], conflict: Sequence[str], trials: Trials
) -> Sequence[Edits]:
    """One lever of the conflict alone; where none is enough, each with more memory, and then all of them together."""
    levers = list(levers)
    alone = [lever for lever in levers if not lever.partitions or set(lever.partitions) & set(conflict)][:OFFERED]
    with_memory = [[*memory, lever] for lever in alone] if memory else []
    for tried in ([[lever] for lever in alone], with_memory, [[*memory, *levers]] if levers else []):
        ways = [edits for together in tried if (edits := smallest_edits(together, trials))]
        if ways:
            return ways
    return ()


def _narrowing(groups: Sequence[Group], problem: Problem, conflict: Sequence[str], trials: Trials) -> Iterator[str]:
    levers = chain.from_iterable(narrowing_levers(group, problem) for group in groups)
    for edits in islice(_of_kind(levers, (), conflict, trials), 1):
        yield f"fewer virtual processors may be enough, and `rarms measure` tells: {describe(edits)}"


def _combining(problem: Problem, conflict: Sequence[str], trials: Trials) -> Iterator[str]:
    """A pair of the conflict, of the least critical first; where none is enough, several, of all partitions."""
    pairs = islice(pair_levers(problem, conflict), PAIRS)
    edits = next(filter(None, (smallest_edits([pair], trials) for pair in pairs)), ())
    if not edits:
        apart: list[Lever] = []
        for pair in pair_levers(problem, problem.claims.keys()):
            if not any(set(pair.partitions) & set(other.partitions) for other in apart):
                apart.append(pair)
        edits = smallest_edits(apart, trials)
    if edits:
        yield f"combining may be enough, and `rarms tune` measures it: {describe(edits)}"


def _more_processors(levers: Sequence[Lever], trials: Trials) -> Iterator[str]:
    ways = (smallest_edits([lever], trials) for lever in levers if lever.to_be_measured)
    for edits in islice(filter(None, ways), 1):
        yield f"{describe(edits)}, may be enough: what partitions need there has to be measured (`rarms measure`)"
