"""Whom to combine: a pair that would fit at the least that the two can need together (DESIGN section 3)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations, islice

from rarms_iac.model.quantities import LogicalProcessors, ProcessorTime, show_percent
from rarms_iac.model.system import CpuRequest
from rarms_iac.model.wording import in_a_row
from rarms_iac.planner.combining.candidates import compound_of
from rarms_iac.planner.combining.oracle import coi_as_measured
from rarms_iac.planner.groups import Group, may_share
from rarms_iac.planner.infeasibility.edits import Edit, Trial, Variant, with_components
from rarms_iac.planner.infeasibility.lowering import largest
from rarms_iac.planner.prediction.members import alone_in, expected_of, predictor_of
from rarms_iac.planner.problem import Problem
from rarms_iac.planner.reservations import names_of, rests_on_a_log

TRIED = 30
"""Pairs that are planned alone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """Two partitions that become one, which is called after the more critical."""

    minor: Group
    leader: Group
    hosts: tuple[str, ...]  # where both may run
    processors: int  # virtual ones, of the wider of the two
    lowest: int  # per cent of each that the two need at least together
    highest: int  # the most at which they need less than apart
    costs: tuple[int, ...]  # what each reserves now, in per cent of one logical processor

    def edit(self, reserve: int) -> Edit:
        """Put both in one partition that reserves so much."""
        members = tuple(member.name for group in (self.minor, self.leader) for member in group.members)
        cpu = CpuRequest(reserve=ProcessorTime(LogicalProcessors(Fraction(reserve * self.processors, 100))))

        def change(variant: Variant) -> Variant:
            partitions = dict(variant.system.partitions)
            partitions.pop(self.minor.name, None)
            partitions[self.leader.name] = replace(self.leader.request, components=members, cpu=cpu)
            there = replace(variant.system.components[members[0]], hosts=self.hosts)
            combined = replace(variant, system=replace(variant.system, partitions=partitions))
            return with_components(combined, {there.name: there})

        return Edit("", change)


def pairs_to_combine(problem: Problem, conflict: Sequence[str], trial: Trial) -> str | None:
    """Find the pair of the conflict, of the least critical first, that may need so little together that all fit.

    Where no pair is enough, several are combined, of all partitions.
    """
    for pair in islice(_pairs(problem, conflict), TRIED):
        processors = problem.system.hosts[pair.hosts[0]].logical_processors

        def share(reserve: int) -> str:
            return show_percent(Fraction(reserve * pair.processors, processors))  # noqa: B023

        more = largest(pair.highest - pair.lowest + 1, lambda more: trial.fits((pair.edit(pair.lowest + more),)))  # noqa: B023
        if more is not None:
            expected = _expected(pair, problem)
            predicted = "" if expected is None else f" (predicted: {share(expected)})"
            return (
                f"combining {pair.minor.name} and {pair.leader.name} in one partition may be enough: the two need "
                f"{share(pair.lowest)} to {share(pair.highest)} of {in_a_row(pair.hosts, 'or')} then{predicted}, and "
                f"up to {share(pair.lowest + more)} fits (`rarms tune` measures it)"
            )
    return _several(problem, trial)


def _several(problem: Problem, trial: Trial) -> str | None:
    """As many pairs as are enough at their least, the least critical first, and no partition in two of them."""
    chosen: list[Pair] = []
    for pair in _pairs(problem, [group.name for group in problem.groups]):
        names = {pair.minor.name, pair.leader.name}
        if any(names & {other.minor.name, other.leader.name} for other in chosen):
            continue
        chosen.append(pair)
        if trial.fits([each.edit(each.lowest) for each in chosen]):
            says = ["no pair is enough; combining all of these may be (`rarms tune` measures what they need)"]
            for each in chosen:
                width = problem.system.hosts[each.hosts[0]].logical_processors
                least = show_percent(Fraction(each.lowest * each.processors, width))
                says.append(
                    f"{each.minor.name} and {each.leader.name}: at least {least} of {in_a_row(each.hosts, 'or')}"
                )
            return "\n  - ".join(says)
    return None


def _expected(pair: Pair, problem: Problem) -> int | None:
    """What the two will probably need together, in per cent of each processor; None: nothing says so."""
    groups, host = (pair.minor, pair.leader), problem.system.hosts[pair.hosts[0]]
    predictor = predictor_of(alone_in(groups, problem.reservations, host))
    members = names_of(member for group in groups for member in group.members)
    return expected_of(predictor, members, pair.processors, pair.costs)


def _pairs(problem: Problem, conflict: Sequence[str]) -> Iterator[Pair]:
    groups = [group for group in problem.groups if group.name in conflict and rests_on_a_log(group)]
    for minor, leader in combinations(sorted(groups, key=lambda group: (group.criticality, group.name)), 2):
        claims = problem.claims[minor.name], problem.claims[leader.name]
        hosts = tuple(name for name in claims[0] if name in claims[1])
        if not hosts or not may_share(minor, leader):
            continue
        host = problem.system.hosts[hosts[0]]
        parts = [
            coi_as_measured(group, claim[host.name], problem.reservations, host)
            for group, claim in zip((minor, leader), claims, strict=True)
        ]
        together = compound_of(parts)
        yield Pair(
            minor=minor,
            leader=leader,
            hosts=hosts,
            processors=together.processors,
            lowest=together.reserve,
            highest=-(-sum(part.cost for part in parts) // together.processors) - 1,
            costs=tuple(part.cost for part in parts),
        )
