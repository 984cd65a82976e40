"""Branch and price: best-first, each node bounded by exact weights, split where its relaxation is undecided.

The tree that is left at the end is the proof: every leaf carries weights that bound it by the value found.
"""

import heapq
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from rarms_iac.planner.packing.columns import Effort, Relaxed, Weights, relax
from rarms_iac.planner.packing.cover import covered
from rarms_iac.planner.packing.nodes import Decision, On, Together, View, decided, everything, other_side, without
from rarms_iac.planner.packing.program import Bundles, Mask, Program, charge_of, members, value_of

_HALF = 1e-4

SECOND_THOUGHTS = 2
"""How often a dive may take another than the largest part."""

Parts = tuple[tuple[int, Mask, float], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaf:
    """Nothing below is better: so say the weights, one an item of the whole program."""

    weights: Weights


@dataclass(frozen=True, slots=True, kw_only=True)
class Contradiction:
    """Nothing is below: the decisions contradict each other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Split:
    """Either the decision holds or its other side does."""

    decision: Decision
    holds: "Tree"
    fails: "Tree"


Tree = Leaf | Contradiction | Split


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The best packing that was found, and what is known of better ones."""

    bundles: Bundles | None
    bound: int  # nothing costs less
    tree: Tree | None  # proof that nothing is better; None: not proved


def _as_it_is(_program: Program, bundles: Bundles, _target: int) -> Bundles:
    return bundles


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """When to give up: counts, so that the same input has the same answer."""

    nodes: int = 400
    certify: int = 30  # nodes for a certificate of what was proved without one
    dives: int = 60
    first_dive: int = 80  # relaxations of the first, and of each later one
    dive: int = 10
    improve: Callable[[Program, Bundles, int], Bundles] = _as_it_is  # of a packing that the first dive left unproved
    patterns: int = 7_000  # knapsacks in all
    effort: Effort = field(default_factory=Effort)


@dataclass(slots=True)
class _Node:
    decisions: tuple[Decision, ...]
    view: View | None
    bound: int = 0
    relaxed: Relaxed | None = None
    weights: Weights | None = None
    split: tuple[Decision, "_Node", "_Node"] | None = None


class Search:
    """One program's search, from a packing that is known (or none) to a proof."""

    def __init__(self, program: Program, known: Bundles | None, limits: Limits, *, ceiling: int) -> None:
        self.program = program
        self.limits = limits
        self.ceiling = ceiling  # no packing costs so much
        self.best = known
        self.upper = ceiling if known is None else value_of(program, known)
        self.pool: set[tuple[int, Mask]] = set(known or ())
        self.patterns = 0
        self.dives = 0
        self.lowest = 0  # nothing costs less: by trying all, without weights

    def run(self) -> Outcome:
        """The best packing, proved where the limits allow."""
        root = self._relaxed(_Node(decisions=(), view=everything(self.program)))
        heap: list[tuple[int, int, int]] = []
        waiting: dict[int, _Node] = {}

        def wait(node: _Node) -> None:
            number = len(numbers)
            numbers.append(number)
            waiting[number] = node
            heapq.heappush(heap, (node.bound, -len(node.decisions), number))

        numbers: list[int] = []
        wait(root)
        opened = 0
        while heap and heap[0][0] < self.upper:
            settled = self.lowest >= self.upper  # by trying all: what follows is for the certificate only
            if (
                opened >= (self.limits.certify if settled else self.limits.nodes)
                or self.patterns > self.limits.patterns
            ):
                return Outcome(bundles=self.best, bound=max(heap[0][0], self.lowest), tree=None)
            opened += 1
            node = waiting.pop(heapq.heappop(heap)[2])
            if node.relaxed is None:  # its knapsacks were too hard
                return Outcome(bundles=self.best, bound=max(node.bound, self.lowest), tree=None)
            if not settled:
                self._dive(node)
            if opened == 1 and node.bound < self.upper and node.weights is not None:
                better, self.lowest = covered(self.program, node.weights, node.bound, self.upper)
                if better is not None:
                    self._take(better)
            if opened == 1 and self.best is not None and max(self.lowest, node.bound) < self.upper:
                self._take(self.limits.improve(self.program, self.best, node.bound))
            if node.bound >= self.upper:
                wait(node)
                continue
            decision = self._undecided(node)
            if decision is None:
                return Outcome(bundles=self.best, bound=max(node.bound, self.lowest), tree=None)
            children = tuple(
                self._relaxed(
                    _Node(
                        decisions=(*node.decisions, one),
                        view=decided(self.program, (*node.decisions, one)),
                        bound=node.bound,
                        weights=node.weights,
                    )
                )
                for one in (decision, other_side(decision))
            )
            node.split = (decision, children[0], children[1])
            for child in children:
                wait(child)
        return Outcome(bundles=self.best, bound=self.upper, tree=_tree(root))

    def _relaxed(self, node: _Node) -> _Node:
        """Bound the node; the integral packing that its relaxation may be is taken."""
        if node.view is None:
            node.bound = self.ceiling
            return node
        view = node.view
        found = self._relax(view, self.upper)
        if found is None:
            return node
        node.relaxed = found
        if found.bound >= node.bound:  # otherwise what bounds its parent bounds it too
            node.bound = found.bound
            node.weights = _spread(view, found.weights, self.program.items)
        if found.bound < self.upper:
            self._offer(tuple((kind, view.whole(mask)) for kind, mask, part in found.parts if part > 1 - _HALF))
        return node

    def _relax(self, view: View, target: int) -> Relaxed | None:
        if view.program.items == 0:
            return None
        known = self._known(view)
        found = relax(view.program, known, target, max(1, self.upper), self.limits.effort)
        if found is not None:
            self.patterns += found.patterns
            self.pool.update((kind, view.whole(mask)) for kind, mask, _ in found.parts)
        return found

    def _known(self, view: View) -> Iterable[tuple[int, Mask]]:
        """Patterns of the pool that the view allows, in order."""
        for kind, mask in sorted(self.pool):
            ours = view.ours(mask)
            if ours and view.program.kinds[kind].hosts and _allowed(view.program, kind, ours):
                yield kind, ours

    def _offer(self, bundles: Bundles) -> None:
        """Take the packing if it is one and better than the best."""
        covered = 0
        for _, mask in bundles:
            if covered & mask:
                return
            covered |= mask
        if covered != (1 << self.program.items) - 1:
            return
        for at, kind in enumerate(self.program.kinds):
            if sum(one == at for one, _ in bundles) > len(kind.hosts):
                return
        if self.program.budget is not None and charge_of(self.program, bundles) != self.program.budget:
            return
        self._take(bundles)

    def _take(self, bundles: Bundles) -> None:
        value = value_of(self.program, bundles)
        if value < self.upper:
            self.best, self.upper = tuple(sorted(bundles)), value
            self.pool.update(bundles)

    def _dive(self, node: _Node) -> None:
        """Look for a packing below the node: fix the largest part, relax again, and so on, with few second thoughts."""
        if self.dives >= self.limits.dives or node.view is None or node.relaxed is None:
            return
        self.dives += 1
        steps = self.limits.first_dive if self.dives == 1 else self.limits.dive
        self._down(node.view, node.relaxed.parts, (), SECOND_THOUGHTS, steps)

    def _down(self, view: View, parts: Parts, fixed: Bundles, thoughts: int, steps: int) -> int:
        """How many steps are left after the packings below were looked for; none where one was found."""
        sure = [(kind, view.whole(mask)) for kind, mask, part in parts if part > 1 - _HALF]
        ranked = sorted(parts, key=lambda one: (-one[2], one[0], one[1]))
        choices = [sure] if sure else [[(kind, view.whole(mask))] for kind, mask, _ in ranked[: 1 + thoughts]]
        for number, chosen in enumerate(choices):
            smaller = view
            for kind, whole in chosen:
                ours = smaller.ours(whole)
                assert ours is not None, "parts that are wholly there do not overlap"
                smaller = without(smaller, kind, ours)
            taken = (*fixed, *chosen)
            spent = value_of(self.program, taken)
            if smaller.program.items == 0:
                before = self.upper
                self._offer(taken)
                return 0 if self.upper < before else steps
            if spent >= self.upper or steps <= 0:
                continue
            steps -= 1
            again = self._relax(smaller, self.upper - spent)
            if again is None or again.bound + spent >= self.upper or not again.parts:
                continue
            steps = self._down(smaller, again.parts, taken, thoughts - number, steps)
            if steps <= 0:
                return steps
        return steps

    def _undecided(self, node: _Node) -> Decision | None:
        """The pair of items, or the item and kind, about which the relaxation is most in two minds."""
        assert node.view is not None
        assert node.relaxed is not None
        pairs: dict[tuple[int, int], float] = {}
        kinds: dict[tuple[int, int], float] = {}
        for kind, mask, part in node.relaxed.parts:
            items = members(mask)
            for at, one in enumerate(items):
                kinds[one, kind] = kinds.get((one, kind), 0.0) + part
                for other in items[at + 1 :]:
                    pairs[one, other] = pairs.get((one, other), 0.0) + part
        stands_for = node.view.stands_for
        pair = min(pairs, key=lambda one: (abs(pairs[one] - 0.5), one), default=None)
        if pair is not None and _HALF < pairs[pair] < 1 - _HALF:
            return Together(_first(stands_for[pair[0]]), _first(stands_for[pair[1]]))
        place = min(kinds, key=lambda one: (abs(kinds[one] - 0.5), one), default=None)
        if place is not None and _HALF < kinds[place] < 1 - _HALF:
            return On(_first(stands_for[place[0]]), place[1])
        return None


def _first(mask: Mask) -> int:
    return (mask & -mask).bit_length() - 1


def _allowed(program: Program, at: int, mask: Mask) -> bool:
    """Whether the items may be on one host of the kind together, by what a node decided."""
    kind = program.kinds[at]
    items = members(mask)
    return not any(kind.sizes[item] is None or program.conflicts[item] & mask for item in items)


def _spread(view: View, weights: Weights, items: int) -> Weights:
    """The weights of a view's items on the first item that each stands for."""
    whole = [0] * items
    for at, weight in enumerate(weights.items):
        whole[_first(view.stands_for[at])] = weight
    return Weights(items=tuple(whole), budget=weights.budget, scale=weights.scale)


def _tree(node: _Node) -> Tree | None:
    if node.split is not None:
        decision, one, other = node.split
        holds, fails = _tree(one), _tree(other)
        return None if holds is None or fails is None else Split(decision=decision, holds=holds, fails=fails)
    if node.view is None:
        return Contradiction()
    return None if node.weights is None else Leaf(weights=node.weights)
