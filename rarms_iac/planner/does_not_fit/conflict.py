"""Why there is no layout: a smallest set that conflicts, and what was tried and helps (DESIGN section 3)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from rarms_iac.model.layout import Cause, Infeasible
from rarms_iac.planner import findings
from rarms_iac.planner.does_not_fit.relaxations import relaxations
from rarms_iac.planner.does_not_fit.room import exceeds, memory_of
from rarms_iac.planner.does_not_fit.sentences import find_no_room, memory_exceeds, processors_exceed
from rarms_iac.planner.does_not_fit.smaller import certified_impossible, hosts_of
from rarms_iac.planner.does_not_fit.smallest import smallest
from rarms_iac.planner.does_not_fit.variants import Trial
from rarms_iac.planner.placing.first_fit import Bin, Item, cost, free_in
from rarms_iac.planner.problem import Problem


def explained(answer: Infeasible, problem: Problem, trial: Trial) -> Infeasible:
    """The same answer with its conflict, its causes and ways out; each way out was planned and fits."""
    if answer.causes:
        return answer
    found = _conflict(problem.items, problem.bins)
    certificate = _certificate(found.names, problem) if answer.proven or found.proven else ""
    return replace(
        answer,
        proven=answer.proven or found.proven,
        conflict=found.names,
        causes=found.causes,
        relaxations=relaxations(problem, found.names, trial),
        certificate=certificate,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Conflict:
    """Partitions that do not fit together, why, and whether that is proved by looking at them."""

    names: tuple[str, ...]
    causes: tuple[Cause, ...]
    proven: bool


def _certificate(names: Sequence[str], problem: Problem) -> str:
    """Of the partitions that conflict; of all of them where those have none."""
    few = [one for one in problem.items if one.name in names]
    return certified_impossible(few, problem.bins) or certified_impossible(problem.items, problem.bins)


def _conflict(items: Sequence[Item], bins: Sequence[Bin]) -> _Conflict:
    """Who is in the way of whom; where processors and memory are both too little, of each by itself."""
    kinds = [list(items)]
    if exceeds(items, bins, cost) and exceeds(items, bins, memory_of):
        kinds = [[_needing(one, processors=True) for one in items], [_needing(one, processors=False) for one in items]]
    by_name = {one.name: one for one in items}
    found = [smallest(some, bins) for some in kinds]
    chosen = [tuple(by_name[each.name] for each in one.items) for one in found]
    causes = [
        _cause([by_name[one.name] for one in some], hosts_of(some, bins), memory=at == 1)
        for at, some in enumerate(chosen)
    ]
    names = sorted({one.name for some in chosen for one in some})
    return _Conflict(names=tuple(names), causes=tuple(causes), proven=all(one.proven for one in found))


def _needing(one: Item, *, processors: bool) -> Item:
    """The same as if it needed nothing but processors, or nothing but memory."""
    nothing = {"memory": 0} if processors else {"reserve": 0}
    return replace(one, claims={name: replace(claim, **nothing) for name, claim in one.claims.items()})


def _cause(chosen: Sequence[Item], bins: Sequence[Bin], *, memory: bool) -> Cause:
    """What is too little for them: a sum, the memory first where that is asked for; or room host by host."""
    least = sum(min(map(cost, one.claims.values())) for one in chosen)
    bytes_ = sum(min(map(memory_of, one.claims.values())) for one in chosen)
    if least > sum(max(0, free_in(one).percent) for one in bins) and not memory:
        return Cause(what=_where(bins), says=processors_exceed(chosen, bins), code=findings.RESERVATIONS.code)
    if bytes_ > sum(max(0, free_in(one).memory) for one in bins):
        return Cause(what=_where(bins), says=memory_exceeds(chosen, bins), code=findings.MEMORY.code)
    code = findings.PACKING.code if len(bins) == 1 else findings.PLACEMENT.code
    return Cause(what=_where(bins), says=find_no_room(chosen, bins), code=code)


def _where(bins: Sequence[Bin]) -> str:
    return f"host/{bins[0].name}" if bins else "application"
