"""Whom to combine: only where the least that they could need together would fit (DESIGN section 3).

First one pair, in the objective's order. Where no pair is enough, the best layout of all that may be, as `rarms tune`
would look at it first.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations

from rarms_iac.model.quantities import LogicalProcessors, ProcessorTime, show_percent
from rarms_iac.model.system import CpuWish, Host
from rarms_iac.model.wording import in_a_row, number
from rarms_iac.planner.combining.candidates import Candidate, Candidates, candidates_of, compound_of
from rarms_iac.planner.combining.layouts import Layouts, Objective
from rarms_iac.planner.combining.oracle import WHOLE, Coi, coi_as_measured
from rarms_iac.planner.does_not_fit.levers import largest
from rarms_iac.planner.does_not_fit.variants import Counted, Edit, Trial, Variant, edited
from rarms_iac.planner.groups import Group, may_share
from rarms_iac.planner.placing.first_fit import cost, free_in
from rarms_iac.planner.prediction.members import Predictor, alone_in, expected_of, predictor_of
from rarms_iac.planner.problem import Problem
from rarms_iac.planner.reservations import names_of, rests_on_a_log

TRIED = 30
"""Pairs that are planned, those that combine the least critical first."""

LAYOUTS = 40
"""Layouts of several compounds that are planned."""

PREDICTED = 250
"""Compounds of which is worked out what they will probably need: all that eight can be."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Compound:
    """Partitions that become one, on hosts where each needs the same."""

    groups: tuple[Group, ...]
    hosts: tuple[Host, ...]
    parts: tuple[Coi, ...]  # each as it was measured there

    @property
    def wide(self) -> int:
        """Virtual processors of the widest of them."""
        return max(one.processors for one in self.parts)

    @property
    def needs(self) -> tuple[int, ...]:
        """What each reserves, in per cent of one logical processor."""
        return tuple(one.cost for one in self.parts)

    @property
    def lowest(self) -> int:
        """What they need at least together, in per cent of each virtual processor, as `rarms tune` takes it."""
        return compound_of(self.parts).reserve

    @property
    def highest(self) -> int:
        """The most at which they still need less than apart."""
        return -(-sum(self.needs) // self.wide) - 1

    @property
    def names(self) -> tuple[str, ...]:
        """The partitions, the most critical last."""
        return tuple(one.name for one in self.groups)

    def edit(self, reserve: int) -> Edit:
        """All of them in one partition that reserves so much."""
        return Edit("", lambda before: _combined(before, self, reserve * self.wide))

    def share(self, reserve: int) -> str:
        """As a share of a host."""
        return show_percent(Fraction(reserve * self.wide, self.hosts[0].logical_processors))


def pair_to_combine(conflict: Sequence[str], problem: Problem, trial: Trial) -> str | None:
    """The best pair in the objective's order that may help, with what the two may need for it; None: there is none.

    Both are of those who conflict: with another one they would need no less.
    """
    among = [one for one in _can_share(problem) if one.name in conflict]
    for pair in list(_in_order(among))[:TRIED]:
        for compound in _compounds(pair, problem):
            edits = [compound.edit(compound.lowest)]
            if compound.lowest <= compound.highest and trial.fits(edits) and trial.is_planned(edits):
                return _told(compound, problem, trial)
    return None


def layout_to_combine(problem: Problem, trial: Trial) -> str | None:
    """The best layout at what its compounds will probably need, or else need at least, where that fits.

    None: none does, or nobody knows. Only partitions are combined whose claims are the same wherever they may run.
    """
    groups = {one.name: one for one in _can_share(problem) if len(set(problem.claims[one.name].values())) == 1}
    known = _Known(
        problem=problem,
        by_member={member: one for one in groups.values() for member in names_of(one.members)},
        cois=tuple(_coi(one, next(iter(problem.claims[one.name])), problem) for one in groups.values()),
    )
    works = Counted(works=trial.may_work, left=LAYOUTS)

    def fits(layout: Sequence[Coi]) -> bool:
        shared = [one for one in layout if one not in known.cois]
        edits = [compound.edit(one.reserve) for one, compound in zip(shared, known.compounds(layout), strict=True)]
        return works(edited(trial.start, edits))

    others = sum(min(map(cost, one.claims.values())) for one in problem.items if one.name not in groups)
    objective = Objective(
        capacity=max(0, sum(max(0, free_in(one).percent) for one in problem.bins) - others),
        fits=fits,
        minimise=problem.system.policy.minimise,
        criticalities={name: problem.system.components[name].criticality for name in known.by_member},
    )
    least = candidates_of(known.cois, known.may_share, most=WHOLE)
    likely = [_as_predicted(least, known)] if len(least.by_mask) <= PREDICTED else []
    for candidates in (*likely, least):
        layouts = Layouts(candidates=candidates, objective=objective)
        best = layouts.best()
        if best is not None:
            found = known.compounds(layouts.cois_of(best.blocks))
            if not trial.is_planned([one.edit(one.lowest) for one in found]):
                return None
            return _told(found[0], problem, trial) if len(found) == 1 else _all_told(found, problem)
    return None


def _as_predicted(candidates: Candidates, known: "_Known") -> Candidates:
    """Compounds at what they will probably need, where something predicts it."""

    def predicted(one: Candidate) -> Candidate:
        compound = known.compound(one.coi.members)
        expected = None if compound is None else _expected(compound, known.problem)
        return one if expected is None else replace(one, coi=replace(one.coi, reserve=max(one.low, expected)))

    return replace(candidates, by_mask={mask: predicted(one) for mask, one in candidates.by_mask.items()})


@dataclass(frozen=True, slots=True, kw_only=True)
class _Known:
    """Who may be combined."""

    problem: Problem
    by_member: Mapping[str, Group]
    cois: tuple[Coi, ...]

    def compounds(self, layout: Sequence[Coi]) -> list[Compound]:
        """Of a layout of those who may share."""
        found = [self.compound(one.members) for one in layout if one not in self.cois]
        return [one for one in found if one is not None]

    def compound(self, members: Sequence[str]) -> Compound | None:
        """These components in one partition; None: there is no host for all of them."""
        parts = {self.by_member[name].name: self.by_member[name] for name in members}
        ordered = sorted(parts.values(), key=lambda one: (one.criticality, one.name))
        return next(_compounds(ordered, self.problem), None)

    def may_share(self, members: Sequence[str]) -> bool:
        compound = self.compound(members)
        return compound is not None and all(may_share(*pair) for pair in combinations(compound.groups, 2))


def _can_share(problem: Problem) -> list[Group]:
    """Partitions that `rarms tune` could combine: measured, and without anything that is fixed for them alone."""

    def can(one: Group) -> bool:
        wish = one.wish
        own = (wish.memory, wish.processors, wish.cpu.limit, wish.cpu.weight)
        return rests_on_a_log(one) and all(member.apt for member in one.members) and own == (None,) * len(own)

    return [one for one in problem.groups if can(one) and problem.claims[one.name]]


def _in_order(groups: Sequence[Group]) -> Iterator[tuple[Group, Group]]:
    """Pairs that nothing forbids, by the criticalities of those who would share, then by name."""

    def key(pair: tuple[Group, Group]) -> tuple[list[int], tuple[str, ...]]:
        members = [member for group in pair for member in group.members]
        return sorted((one.criticality for one in members), reverse=True), tuple(group.name for group in pair)

    pairs = combinations(sorted(groups, key=lambda one: (one.criticality, one.name)), 2)
    yield from sorted((pair for pair in pairs if may_share(*pair)), key=key)


def _compounds(groups: Sequence[Group], problem: Problem) -> Iterator[Compound]:
    """What these would be together, on each kind of host that all of them may run on."""
    claims = [problem.claims[one.name] for one in groups]
    kinds: dict[object, list[Host]] = {}
    for name, host in sorted(problem.system.hosts.items()):
        if all(name in one and one[name].reserve for one in claims):
            alike = host.logical_processors, tuple(one[name] for one in claims)
            kinds.setdefault(alike, []).append(host)
    for hosts in kinds.values():
        parts = tuple(_coi(one, hosts[0].name, problem) for one in groups)
        yield Compound(groups=tuple(groups), hosts=tuple(hosts), parts=parts)


def _coi(group: Group, host: str, problem: Problem) -> Coi:
    return coi_as_measured(group, problem.claims[group.name][host], problem.reservations, problem.system.hosts[host])


def _combined(variant: Variant, compound: Compound, percent: int) -> Variant:
    """In one partition on one of these hosts, which reserves so much of one LP."""
    system, leader = variant.system, compound.groups[-1]
    members = tuple(member.name for group in compound.groups for member in group.members)
    reserve = ProcessorTime(LogicalProcessors(Fraction(percent, WHOLE)))
    wish = replace(leader.wish, components=members, cpu=CpuWish(reserve=reserve))
    kept = {name: one for name, one in system.partitions.items() if name not in compound.names}
    there = replace(system.components[members[0]], hosts=tuple(one.name for one in compound.hosts))
    components = {**system.components, there.name: there}
    return replace(variant, system=replace(system, partitions={**kept, leader.name: wish}, components=components))


def _told(compound: Compound, problem: Problem, trial: Trial) -> str:
    lowest, highest = compound.lowest, compound.highest
    more = largest(highest - lowest + 1, lambda more: trial.fits([compound.edit(lowest + more)])) or 0
    expected = _expected(compound, problem)
    predicted = "" if expected is None else f" (predicted: {compound.share(expected)})"
    return (
        f"combining {in_a_row(compound.names)} in one partition may be enough: "
        f"the {number(len(compound.groups))} need {compound.share(lowest)} to {compound.share(highest)} "
        f"of {_or(compound)} then{predicted}, and up to {compound.share(lowest + more)} fits (`rarms tune` measures it)"
    )


def _all_told(compounds: Sequence[Compound], problem: Problem) -> str:
    parts = []
    for one in compounds:
        expected = _expected(one, problem)
        predicted = "" if expected is None else f" (predicted: {one.share(expected)})"
        parts.append(f"{in_a_row(one.names)}: at least {one.share(one.lowest)} of {_or(one)}{predicted}")
    return "\n  - ".join(
        ["no pair is enough; combining all of these may be (`rarms tune` measures what they need)", *parts]
    )


def _expected(compound: Compound, problem: Problem) -> int | None:
    predictor: Predictor = predictor_of(alone_in(compound.groups, problem.reservations, compound.hosts[0]))
    members = names_of(member for group in compound.groups for member in group.members)
    return expected_of(predictor, members, compound.wide, compound.needs)


def _or(compound: Compound) -> str:
    return in_a_row([one.name for one in compound.hosts], "or")
