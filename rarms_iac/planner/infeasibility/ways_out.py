"""The ways out: changes of a manifest with which everything fits, each planned before it is offered."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, islice, zip_longest

from rarms_iac.model.layout import Relaxation, RelaxationKind
from rarms_iac.planner.groups import Group
from rarms_iac.planner.infeasibility.edits import Edit, Edits, RelaxationRange, VariantPlanner, smallest_edits
from rarms_iac.planner.infeasibility.relaxations import (
    apt_relaxations,
    is_lowest_measured,
    memory_relaxations,
    narrowing_relaxations,
    pair_relaxations,
    processor_relaxations,
    reserve_relaxations,
)
from rarms_iac.planner.problem import Problem
from rarms_iac.texts.messages import in_a_row, natural_order

MOST_WAYS_OUT = 4
"""More ways out than these are not read; and no more relaxations of a kind are tried alone."""


PAIRS = 30
"""Pairs that are planned alone."""


def ways_out(
    problem: Problem, conflict: Sequence[str], planner: VariantPlanner, moves: Mapping[str, str]
) -> tuple[Relaxation, ...]:
    """Find changes with which everything fits.

    Args:
        conflict: Names of the partitions that cannot share their hosts.
        planner: Plans changes of what the problem was made of.

    Returns:
        Up to `MOST_WAYS_OUT` changes that are enough, one of each kind before a second of any: moving, a lower APT,
        more of a host, a lower reserve. Before them what costs nothing: lower settings where none was measured, and
        fewer processors for components that cannot use theirs; after them what else may be enough, and has to be
        measured.
    """
    groups = sorted(problem.groups, key=lambda group: (group.criticality, natural_order(group.name)))
    memory = list(islice(memory_relaxations(problem), MOST_WAYS_OUT))
    processors = list(islice(processor_relaxations(problem), MOST_WAYS_OUT))
    kinds = (
        _moving(moves),
        _of_kind(
            chain.from_iterable(apt_relaxations(group, problem) for group in groups),
            memory,
            conflict,
            planner.searching("easier thresholds"),
        ),
        _of_kind(memory, (), conflict, planner.searching("more memory")),
        _of_kind(
            (relaxation for relaxation in processors if not relaxation.to_be_measured),
            memory,
            conflict,
            planner.searching("more logical processors"),
        ),
        _of_kind(
            chain.from_iterable(map(reserve_relaxations, groups)),
            memory,
            conflict,
            planner.searching("lower reserves"),
        ),
    )
    in_turns = (_relaxation(edits) for turn in zip_longest(*kinds, fillvalue=()) for edits in turn if edits)
    sure = list(islice(dict.fromkeys(in_turns), MOST_WAYS_OUT))
    perhaps = (
        *_combining(problem, conflict, planner.searching("combined partitions")),
        *_ways_with_more_processors(processors, planner.searching("more logical processors")),
    )
    narrowing = _narrowing(groups, problem, conflict, planner.searching("fewer virtual processors"))
    free = (*_lower_settings(problem, conflict), *narrowing)
    return (*free, *sure, *perhaps)


def _lower_settings(problem: Problem, conflict: Sequence[str]) -> Iterator[Relaxation]:
    lowest = {group.name for group in problem.groups if is_lowest_measured(group, problem)}
    names = [name for name in conflict if name in lowest]
    if names:
        change = f"No lower setting of {in_a_row(names)} was measured"
        yield Relaxation(changes=(change,), kind=RelaxationKind.LOWER_SETTINGS)


def _relaxation(edits: Edits, kind: RelaxationKind = RelaxationKind.CERTAIN) -> Relaxation:
    return Relaxation(
        changes=tuple(edit.message for edit in edits),
        levels=tuple(edit.level for edit in edits if edit.level is not None),
        kind=kind,
        hosts=tuple(dict.fromkeys(edit.host for edit in edits if edit.host)),
    )


def _moving(moves: Mapping[str, str]) -> Iterator[Edits]:
    if moves:
        names = in_a_row([f"{name} may move away from {host}" for name, host in moves.items()])
        yield (Edit(f"use `--max-disruption removal`, so that {names}", partial(replace, may_move=True)),)


def _of_kind(
    relaxations: Iterable[RelaxationRange],
    memory: Sequence[RelaxationRange],
    conflict: Sequence[str],
    planner: VariantPlanner,
) -> Sequence[Edits]:
    """Yield single relaxations of the conflict; else each of them with more memory; else all relaxations together."""
    relaxations = list(relaxations)
    in_conflict = (each for each in relaxations if not each.partitions or set(each.partitions) & set(conflict))
    alone = list(islice(in_conflict, MOST_WAYS_OUT))
    with_memory = [[*memory, each] for each in alone] if memory else []
    for tried in ([[each] for each in alone], with_memory, [[*memory, *relaxations]] if relaxations else []):
        ways = [edits for together in tried if (edits := smallest_edits(together, planner))]
        if ways:
            return ways
    return ()


def _narrowing(
    groups: Sequence[Group], problem: Problem, conflict: Sequence[str], planner: VariantPlanner
) -> Iterator[Relaxation]:
    relaxations = chain.from_iterable(narrowing_relaxations(group, problem) for group in groups)
    for edits in islice(_of_kind(relaxations, (), conflict, planner), 1):
        yield _relaxation(edits, RelaxationKind.FEWER_PROCESSORS)


def _combining(problem: Problem, conflict: Sequence[str], planner: VariantPlanner) -> Iterator[Relaxation]:
    """Yield a pair of the conflict, of the least critical first; where none is enough, several, of all partitions."""
    pairs = islice(pair_relaxations(problem, conflict), PAIRS)
    edits = next(filter(None, (smallest_edits([pair], planner) for pair in pairs)), ())
    if not edits:
        disjoint: list[RelaxationRange] = []
        for pair in pair_relaxations(problem, problem.claims.keys()):
            if not any(set(pair.partitions) & set(other.partitions) for other in disjoint):
                disjoint.append(pair)
        edits = smallest_edits(disjoint, planner)
    if edits:
        yield _relaxation(edits, RelaxationKind.COMBINING)


def _ways_with_more_processors(relaxations: Sequence[RelaxationRange], planner: VariantPlanner) -> Iterator[Relaxation]:
    ways = (smallest_edits([relaxation], planner) for relaxation in relaxations if relaxation.to_be_measured)
    for edits in islice(filter(None, ways), 1):
        yield _relaxation(edits, RelaxationKind.MORE_PROCESSORS)
