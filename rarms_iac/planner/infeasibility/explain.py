"""Why there is no layout: who cannot share which hosts, by how much, and what would fit."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import chain, islice, zip_longest
from types import MappingProxyType

from rarms_iac.model.claims import load_of
from rarms_iac.model.diagnostics import Facts
from rarms_iac.model.layout import Cause, Infeasible, Layout, Relaxation, RelaxationKind
from rarms_iac.model.quantities import show_bytes, show_lp_percent, show_percent, show_processors
from rarms_iac.model.wording import in_a_row, list_names, number
from rarms_iac.planner import planning_findings
from rarms_iac.planner.groups import Group
from rarms_iac.planner.infeasibility.conflict import Conflict, conflicts, evident_conflicts
from rarms_iac.planner.infeasibility.edits import Edit, Edits, RelaxationRange, Trials, Variant, smallest_edits
from rarms_iac.planner.infeasibility.relaxations import (
    apt_relaxations,
    memory_relaxations,
    narrowing_relaxations,
    pair_relaxations,
    processor_relaxations,
    reserve_relaxations,
)
from rarms_iac.planner.packing.pack import can_pack
from rarms_iac.planner.packing.values import Bin, Item, free_in, free_on, is_move, least_cost, least_memory
from rarms_iac.planner.problem import Problem, problem_of, solve

MOST_NAMES = 12
"""Names in a sentence; more are counted."""

MOST_WAYS_OUT = 4
"""More ways out than these are not read; and no more relaxations of a kind are tried alone."""

PAIRS = 30
"""Pairs that are planned alone."""


def explain(answer: Infeasible, problem: Problem, start: Variant) -> Infeasible:
    """Add to an answer without causes who conflicts, why, and what would fit.

    Args:
        answer: What `solve` said.
        problem: What was solved.
        start: What the problem was made of: changes of it are planned.

    Returns:
        The same answer with causes, the names of who conflicts, and up to a few ways out, each planned before it is
            offered.
    """
    found = conflicts(problem.items, problem.bins, proven=answer.proven)
    needed = moves_needed(start)
    causes = [_cause(conflict, problem) for conflict in found]
    if needed:
        causes[0] = replace(
            causes[0],
            message=f"{causes[0].message} Only where partitions are now forbids a layout: {_describe_moves(needed)}.",
            values={**causes[0].values, "would_move": tuple(needed)},
        )
    names = sorted({item.name for conflict in found for item in conflict.items})
    return replace(
        answer,
        proven=answer.proven or all(conflict.proven for conflict in found),
        conflict=tuple(names),
        causes=tuple(causes),
        relaxations=ways_out(problem, names, start, needed),
    )


def moves_needed(start: Variant) -> Mapping[str, str]:
    """Find partitions whose present hosts alone leave no layout.

    Args:
        start: What has no layout.

    Returns:
        The host that each of them would have to leave, by name; none where moving is allowed already, or does not help.
    """
    if start.may_move or not any(view.present for view in start.views.values()):
        return {}
    problem = problem_of(start.system, start.reservations, start.views, may_move=True)
    answer = solve(problem)
    if not isinstance(answer, Layout):
        return {}
    placed = {partition.name: partition.host for partition in answer.partitions}
    moving = [item.name for item in problem.items if is_move(item, placed[item.name])]
    for name in tuple(moving):
        others = [other for other in moving if other != name]
        items = [item if item.name in others else _staying(item) for item in problem.items]
        if can_pack(items, problem.bins):
            moving = others
    return {item.name: item.current_host for item in problem.items if item.name in moving}


def _staying(item: Item) -> Item:
    """The partition where it is; one that is nowhere, or may not stay, keeps its choice."""
    current = item.current_host
    return replace(item, claims={current: item.claims[current]}) if current in item.claims else item


def _describe_moves(needed: Mapping[str, str]) -> str:
    """As in: vision would have to leave onboard."""
    return in_a_row([f"{name} would have to leave {host}" for name, host in needed.items()])


def evident_causes(problem: Problem) -> tuple[Cause, ...]:
    """Name what cannot fit, as far as sums and single hosts show it.

    Args:
        problem: Partitions without any claim do not count.

    Returns:
        Causes without advice; none where it takes a search to say more.
    """
    items = [item for item in problem.items if item.claims]
    return tuple(_cause(conflict, problem) for conflict in evident_conflicts(items, problem.bins))


def _cause(conflict: Conflict, problem: Problem) -> Cause:
    names = list_names((item.name for item in conflict.items), MOST_NAMES)
    cannot_share = f"{names} cannot share {list_names((host.name for host in conflict.bins), MOST_NAMES)}"
    match conflict.lacking:
        case "processors":
            finding, message = planning_findings.RESERVATIONS, _processors_exceed(conflict, problem)
        case "memory":
            finding, message = planning_findings.MEMORY, _memory_exceeds(conflict, problem)
        case _ if len(conflict.bins) == 1:
            finding, places = planning_findings.PACKING, _places(conflict.bins[0])
            reason = f"each virtual processor needs its whole reserve on one of the {places}"
            message = f"{cannot_share}: {reason}, and there is no way to place them."
        case _:
            finding = planning_findings.PLACEMENT
            reason = "together these have enough, but each partition needs room on one of them"
            message = f"{cannot_share}: {reason}."
    if conflict.proven and not conflict.smallest:
        message += " Whether fewer of them conflict was not searched to the end."
    if conflict.lacking != "memory":
        message += "".join(_describe_smt(conflict, host) for host in conflict.bins)
    free = free_on(conflict.bins)
    values: Facts = {
        "partitions": tuple(item.name for item in conflict.items),
        "hosts": tuple(host.name for host in conflict.bins),
        "needs_lp": sum(map(least_cost, conflict.items)) / 100,
        "has_lp": float(free.processors),
        "needs_memory_bytes": sum(map(least_memory, conflict.items)),
        "has_memory_bytes": free.memory,
    }
    return Cause(address=f"host/{conflict.bins[0].name}", message=message, code=finding.code, values=values)


def _describe_smt(conflict: Conflict, host: Bin) -> str:
    """What it costs there that a core never runs two machines; empty where it costs nothing."""
    claims = [*host.foreign_claims, *(item.claims[host.name] for item in conflict.items if host.name in item.claims)]
    idle = load_of(claims).idle_processors
    if not idle:
        return ""
    return (
        f" The core scheduler of {host.name} runs one machine on a core at a time: of its "
        f"{_logical_processors(host)}, {number(host.capacity.cores)} cores, {show_processors(idle)} "
        "would stand idle beside machines with an odd number of virtual processors or without SMT of their own. Even "
        "numbers of `processors`, and HwThreadCountPerCore 0, avoid that."
    )


def _processors_exceed(conflict: Conflict, problem: Problem) -> str:
    """As in: FDP 70 %, SRP 30 % and PPP 20 % need 120 % of the two logical processors."""
    if len(conflict.bins) > 1:
        return _sum_exceeds(conflict, problem, least_cost, show_lp_percent, free_on(conflict.bins).percent)
    host = conflict.bins[0]
    whole = host.capacity.logical_processors

    def share(percent: int | Fraction) -> str:
        return show_percent(Fraction(percent) / whole)

    promised = (
        (100 * (whole - host.capacity.processors), "kept for the host"),
        (load_of(host.foreign_claims).percent, "taken by unmanaged machines"),
    )
    parts = [f"{share(amount)} {purpose}" for amount, purpose in promised if amount]
    note = f"; {share(max(0, free_in(host).percent))} is free beside {in_a_row(parts)}" if parts else ""
    message = f"{_needs(conflict, least_cost, share)} of the {_logical_processors(host)}{note}."
    return f"{message}{_all_together(conflict, problem, least_cost, share)}"


def _memory_exceeds(conflict: Conflict, problem: Problem) -> str:
    return _sum_exceeds(conflict, problem, least_memory, show_bytes, free_on(conflict.bins).memory)


def _sum_exceeds(
    conflict: Conflict, problem: Problem, need: Callable[[Item], int], show: Callable[[int], str], free: int
) -> str:
    """As in: FDP 3 GiB and SRP 2 GiB need 5 GiB; onboard has 4 GiB to promise."""
    hosts = list_names((host.name for host in conflict.bins), MOST_NAMES)
    verb = "has" if len(conflict.bins) == 1 else "have"
    together = _all_together(conflict, problem, need, show)
    return f"{_needs(conflict, need, show)}; {hosts} {verb} {show(free)} to promise.{together}"


def _all_together(conflict: Conflict, problem: Problem, need: Callable[[Item], int], show: Callable[[int], str]) -> str:
    """The sum of all partitions, where others need the same hosts: ways out count them, and a conflict leaves them out.

    Nothing where all are in the conflict, or where some may run disjoint.
    """
    if len(conflict.items) == len(problem.items) or len(conflict.bins) < len(problem.bins):
        return ""
    both = "Both" if len(problem.items) == 2 else f"All {number(len(problem.items))}"
    return f" {both} partitions together need {show(sum(map(need, problem.items)))}."


def _needs(conflict: Conflict, need: Callable[[Item], int], show: Callable[[int], str]) -> str:
    ordered = sorted(conflict.items, key=lambda item: (-need(item), item.name))
    shares = list_names((f"{item.name} {show(need(item))}" for item in ordered), MOST_NAMES)
    return f"{shares} {'needs' if len(ordered) == 1 else 'need'} {show(sum(map(need, ordered)))}"


def _logical_processors(host: Bin) -> str:
    many = host.capacity.logical_processors
    return f"{number(many)} logical processor{'' if many == 1 else 's'}"


def _places(host: Bin) -> str:
    """What virtual processors are laid onto: `two logical processors`, `four cores`."""
    return _logical_processors(host) if host.capacity.sharing.threads == 1 else f"{number(host.capacity.cores)} cores"


def ways_out(
    problem: Problem, conflict: Sequence[str], start: Variant, moves: Mapping[str, str] = MappingProxyType({})
) -> tuple[Relaxation, ...]:
    """Find changes with which everything fits.

    Args:
        problem: What has no layout.
        conflict: Names of the partitions that cannot share their hosts.
        start: What the problem was made of.
        moves: As of `moves_needed`.

    Returns:
        Up to `MOST_WAYS_OUT` changes that are enough, one of each kind before a second of any: moving, a lower APT,
        more of a host, a lower reserve. Before them fewer processors for components that cannot use theirs, which costs
        nothing; after them what else may be enough, and has to be measured.
    """
    trials = Trials(start=start)
    groups = sorted(problem.groups, key=lambda group: (group.criticality, group.name))
    memory = list(islice(memory_relaxations(problem), MOST_WAYS_OUT))
    processors = list(islice(processor_relaxations(problem), MOST_WAYS_OUT))
    kinds = (
        _moving(moves),
        _of_kind(chain.from_iterable(apt_relaxations(group, problem) for group in groups), memory, conflict, trials),
        _of_kind(memory, (), conflict, trials),
        _of_kind((relaxation for relaxation in processors if not relaxation.to_be_measured), memory, conflict, trials),
        _of_kind(chain.from_iterable(map(reserve_relaxations, groups)), memory, conflict, trials),
    )
    in_turns = (_relaxation(edits) for turn in zip_longest(*kinds, fillvalue=()) for edits in turn if edits)
    sure = list(islice(dict.fromkeys(in_turns), MOST_WAYS_OUT))
    perhaps = (*_combining(problem, conflict, trials), *_ways_with_more_processors(processors, trials))
    return (*_narrowing(groups, problem, conflict, trials), *sure, *perhaps)


def _relaxation(edits: Edits, kind: RelaxationKind = RelaxationKind.CERTAIN, host: str = "") -> Relaxation:
    return Relaxation(
        changes=tuple(edit.message for edit in edits),
        levels=tuple(edit.level for edit in edits if edit.level is not None),
        kind=kind,
        host=host,
    )


def _moving(moves: Mapping[str, str]) -> Iterator[Edits]:
    if moves:
        names = in_a_row([f"{name} move away from {host}" for name, host in moves.items()])
        yield (Edit(f"`--max-disruption removal`, which lets {names}", partial(replace, may_move=True)),)


def _of_kind(
    relaxations: Iterable[RelaxationRange], memory: Sequence[RelaxationRange], conflict: Sequence[str], trials: Trials
) -> Sequence[Edits]:
    """One relaxation of the conflict alone; where none is enough, each with more memory, then all together."""
    relaxations = list(relaxations)
    in_conflict = (each for each in relaxations if not each.partitions or set(each.partitions) & set(conflict))
    alone = list(islice(in_conflict, MOST_WAYS_OUT))
    with_memory = [[*memory, each] for each in alone] if memory else []
    for tried in ([[each] for each in alone], with_memory, [[*memory, *relaxations]] if relaxations else []):
        ways = [edits for together in tried if (edits := smallest_edits(together, trials))]
        if ways:
            return ways
    return ()


def _narrowing(
    groups: Sequence[Group], problem: Problem, conflict: Sequence[str], trials: Trials
) -> Iterator[Relaxation]:
    relaxations = chain.from_iterable(narrowing_relaxations(group, problem) for group in groups)
    for edits in islice(_of_kind(relaxations, (), conflict, trials), 1):
        yield _relaxation(edits, RelaxationKind.FEWER_PROCESSORS)


def _combining(problem: Problem, conflict: Sequence[str], trials: Trials) -> Iterator[Relaxation]:
    """A pair of the conflict, of the least critical first; where none is enough, several, of all partitions."""
    pairs = islice(pair_relaxations(problem, conflict), PAIRS)
    tried = ((smallest_edits([pair], trials), pair.host) for pair in pairs)
    edits, host = next((way for way in tried if way[0]), ((), ""))
    if not edits:
        disjoint: list[RelaxationRange] = []
        for pair in pair_relaxations(problem, problem.claims.keys()):
            if not any(set(pair.partitions) & set(other.partitions) for other in disjoint):
                disjoint.append(pair)
        edits, host = smallest_edits(disjoint, trials), disjoint[0].host if disjoint else ""
    if edits:
        yield _relaxation(edits, RelaxationKind.COMBINING, host)


def _ways_with_more_processors(relaxations: Sequence[RelaxationRange], trials: Trials) -> Iterator[Relaxation]:
    ways = (smallest_edits([relaxation], trials) for relaxation in relaxations if relaxation.to_be_measured)
    for edits in islice(filter(None, ways), 1):
        yield _relaxation(edits, RelaxationKind.MORE_PROCESSORS)
