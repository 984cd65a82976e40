"""Decisions that split a packing's search in two, and the smaller program that they leave."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from rarms_iac.planner.packing.program import Kind, Mask, Program, Sizes, members


@dataclass(frozen=True, slots=True)
class Together:
    """The two items share a host."""

    one: int
    other: int


@dataclass(frozen=True, slots=True)
class Apart:
    """The two items are on different hosts."""

    one: int
    other: int


@dataclass(frozen=True, slots=True)
class On:
    """The item is on a host of this kind."""

    item: int
    kind: int


@dataclass(frozen=True, slots=True)
class Off:
    """The item is on no host of this kind."""

    item: int
    kind: int


Decision = Together | Apart | On | Off


def other_side(decision: Decision) -> Decision:
    """What holds where the decision does not."""
    match decision:
        case Together(one, other):
            return Apart(one, other)
        case Apart(one, other):
            return Together(one, other)
        case On(item, kind):
            return Off(item, kind)
        case Off(item, kind):
            return On(item, kind)


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """A smaller program: each of its items stands for some of the whole program's."""

    program: Program
    stands_for: tuple[Mask, ...]  # by item of `program`

    def whole(self, mask: Mask) -> Mask:
        """The whole program's items of some of ours."""
        found = 0
        for item in members(mask):
            found |= self.stands_for[item]
        return found

    def ours(self, mask: Mask) -> Mask | None:
        """Our items that stand for exactly these; None where they would tear one apart or know one that we do not."""
        found = 0
        for at, items in enumerate(self.stands_for):
            if items & mask:
                if items & ~mask:
                    return None
                found |= 1 << at
                mask &= ~items
        return found if not mask else None

    def those(self, masks: Iterable[Mask]) -> Iterator[Mask]:
        """Of sets of the whole program's items those that are possible here, as ours."""
        merged = [(1 << at, group) for at, group in enumerate(self.stands_for)]
        moved = [(bit, group) for bit, group in merged if bit != group]
        keep = sum(group for bit, group in merged if bit == group)
        clashes = [(1 << at, against) for at, against in enumerate(self.program.conflicts) if against]
        for mask in masks:
            ours = mask & keep
            for bit, group in moved:
                if mask & group == group:
                    ours |= bit
                elif mask & group:
                    break
            else:
                if not any(ours & bit and ours & against for bit, against in clashes):
                    yield ours


def everything(program: Program) -> View:
    """The whole program."""
    return View(program=program, stands_for=tuple(1 << item for item in range(program.items)))


def decided(program: Program, decisions: Sequence[Decision]) -> View | None:
    """What is left under the decisions; None where they contradict each other."""
    home = list(range(program.items))
    for one in decisions:
        if isinstance(one, Together):
            new, old = home[one.one], home[one.other]
            home = [new if root == old else root for root in home]
    roots = sorted(set(home))
    groups = [sum(1 << item for item in range(program.items) if home[item] == root) for root in roots]
    at = {root: number for number, root in enumerate(roots)}
    conflicts = [0] * program.items
    for item, mask in enumerate(program.conflicts):
        conflicts[item] = mask
    forbidden: dict[int, set[int]] = {}
    for one in decisions:
        match one:
            case Apart(first, second):
                conflicts[first] |= 1 << second
                conflicts[second] |= 1 << first
            case On(item, kind):
                forbidden.setdefault(item, set()).update(set(range(len(program.kinds))) - {kind})
            case Off(item, kind):
                forbidden.setdefault(item, set()).add(kind)
            case Together():
                pass
    if any(conflicts[item] & group for group in groups for item in members(group)):
        return None
    kinds = tuple(
        _merged(kind, groups, {at[home[item]] for item, banned in forbidden.items() if number in banned})
        for number, kind in enumerate(program.kinds)
    )
    return _view(program, kinds, groups, conflicts)


def without(view: View, kind: int, mask: Mask) -> View:
    """What is left when a host of that kind takes these of the view's items."""
    program = view.program
    rest = [item for item in range(program.items) if not mask >> item & 1]
    charge = program.kinds[kind].charge + sum(
        program.kinds[kind].charges[item] for item in members(mask) if program.kinds[kind].charges
    )
    kinds = tuple(
        replace(
            _picked(one, rest),
            hosts=one.hosts[1:] if number == kind else one.hosts,
        )
        for number, one in enumerate(program.kinds)
    )
    conflicts = [sum(1 << new for new, old in enumerate(rest) if program.conflicts[item] >> old & 1) for item in rest]
    fits = program.fits
    smaller = Program(
        items=len(rest),
        kinds=kinds,
        conflicts=tuple(conflicts),
        budget=None if program.budget is None else program.budget - charge,
        fits=(lambda at, some: fits(at, sum(1 << rest[item] for item in members(some)))) if fits else None,
    )
    smaller = _listed(smaller, program.patterns, [1 << item for item in rest])
    return View(program=smaller, stands_for=tuple(view.stands_for[item] for item in rest))


def _picked(kind: Kind, items: Sequence[int]) -> Kind:
    return replace(
        kind,
        sizes=tuple(kind.sizes[item] for item in items),
        costs=tuple(kind.costs[item] for item in items),
        charges=tuple(kind.charges[item] for item in items) if kind.charges else (),
    )


def _merged(kind: Kind, groups: Sequence[Mask], banned: set[int]) -> Kind:
    """The kind as items that stand for several see it."""
    sizes: list[Sizes | None] = []
    for at, group in enumerate(groups):
        parts = [kind.sizes[item] for item in members(group)]
        whole = [part for part in parts if part is not None]
        fitting = at not in banned and len(whole) == len(parts)
        sizes.append(tuple(map(sum, zip(*whole, strict=True))) if fitting else None)
    return replace(
        kind,
        sizes=tuple(sizes),
        costs=tuple(sum(kind.costs[item] for item in members(group)) for group in groups),
        charges=tuple(sum(kind.charges[item] for item in members(group)) for group in groups) if kind.charges else (),
    )


def _view(program: Program, kinds: tuple[Kind, ...], groups: list[Mask], conflicts: list[Mask]) -> View:
    clashes = []
    for group in groups:
        against = 0
        for item in members(group):
            against |= conflicts[item]
        clashes.append(sum(1 << number for number, other in enumerate(groups) if against & other))
    fits = program.fits
    whole = {1 << number: group for number, group in enumerate(groups)}

    def fit(kind: int, mask: Mask) -> bool:
        assert fits is not None
        return fits(kind, sum(whole[1 << number] for number in members(mask)))

    smaller = Program(
        items=len(groups),
        kinds=kinds,
        conflicts=tuple(clashes),
        budget=program.budget,
        fits=fit if fits else None,
    )
    return View(program=_listed(smaller, program.patterns, groups), stands_for=tuple(groups))


def _listed(smaller: Program, patterns: Sequence[Mask] | None, groups: Sequence[Mask]) -> Program:
    """The smaller program with those of the patterns that it still allows."""
    if patterns is None:
        return smaller
    view = View(program=smaller, stands_for=tuple(groups))
    ours = (view.ours(mask) for mask in patterns)
    left = (mask for mask in ours if mask and not any(smaller.conflicts[item] & mask for item in members(mask)))
    return replace(smaller, patterns=tuple(left))
