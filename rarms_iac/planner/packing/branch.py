"""Branch and price: best-first, each node bounded by exact weights, split where its relaxation is undecided.

Where the root's weights alone show that nothing is better, or all that they leave was tried, they are the proof; a
bound that took decisions is one by search.
"""

import heapq
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

from rarms_iac.planner.packing.columns import Effort, Relaxed, Weights, relax
from rarms_iac.planner.packing.cover import covered
from rarms_iac.planner.packing.nearly_free import CloseFits, close_fits
from rarms_iac.planner.packing.nodes import Decision, On, Together, View, decided, everything, other_side, without
from rarms_iac.planner.packing.program import Bundles, Mask, Program, charge_of, members, value_of
from rarms_iac.planner.packing.waste import payable

_HALF = 1e-4

PENALTY = 50
"""How much dearer than the whole packing is an item that no pattern covers: weights may be that large."""

SECOND_THOUGHTS = 2
"""How often a dive may take another than the largest part."""

Parts = tuple[tuple[int, Mask, float], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Proof:
    """Nothing is better: so say the weights, one an item."""

    weights: Weights
    tried: bool = False  # and all packings of the patterns that are nearly free under them


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The best packing that was found, and what is known of better ones."""

    bundles: Bundles | None
    bound: int  # nothing costs less
    proof: Proof | None  # that nothing is better; None: not proved, or by search


def _as_it_is(_program: Program, bundles: Bundles, _target: int) -> Bundles:
    return bundles


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """When to give up: counts, so that the same input has the same answer."""

    nodes: int = 400
    cover: int = 300_000  # partial packings of patterns that are nearly free: at first, and below each decision
    cover_below: int = 20_000
    dives: int = 60
    first_dive: int = 80  # relaxations of the first, and of each later one
    dive: int = 10
    improve: Callable[[Program, Bundles, int], Bundles] = _as_it_is  # of a packing that the first dive left unproved
    patterns: int = 4_000  # knapsacks in all
    effort: Effort = field(default_factory=Effort)


@dataclass(slots=True)
class _Node:
    decisions: tuple[Decision, ...]
    view: View | None
    bound: int = 0
    relaxed: Relaxed | None = None
    weights: Weights | None = None
    tried: bool = False  # all packings that they leave
    total: int = 0  # what they bound it by, in parts of their scale


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
        self.steps = limits.cover  # for covers that are left
        self.close: tuple[CloseFits | None, ...] = ()  # empty: not looked at yet

    def run(self) -> Outcome:
        """The best packing, proved where the limits allow."""
        root = self._relaxed(_Node(decisions=(), view=everything(self.program)))
        waiting: list[tuple[int, int, int, _Node]] = [(root.bound, 0, 0, root)]
        opened = made = 0
        while waiting and waiting[0][0] < self.upper:
            node = waiting[0][3]
            if opened >= self.limits.nodes or self.patterns > self.limits.patterns or node.relaxed is None:
                return self._unproved(node)
            opened += 1
            self._dive(node)
            if opened == 1:
                self._relaxed(node, fully=True)
                self._cover(node, self.limits.cover)
                self._dive(node)
            if opened == 1 and self.best is not None and node.bound < self.upper:
                self._take(self.limits.improve(self.program, self.best, node.bound))
            heapq.heappop(waiting)
            children = [node]
            if node.bound < self.upper:
                decision = self._undecided(node)
                if decision is None:
                    return self._unproved(node)
                children = [self._child(node, one) for one in (decision, other_side(decision))]
            for child in children:
                made += 1
                heapq.heappush(waiting, (child.bound, -len(child.decisions), made, child))
        return Outcome(bundles=self.best, bound=self.upper, proof=_proof(root, self.upper))

    def _unproved(self, lowest: _Node) -> Outcome:
        return Outcome(bundles=self.best, bound=lowest.bound, proof=None)

    def _child(self, node: _Node, decision: Decision) -> _Node:
        decisions = (*node.decisions, decision)
        view = decided(self.program, decisions)
        child = _Node(decisions=decisions, view=view, bound=node.bound, weights=node.weights, total=node.total)
        self._relaxed(child)
        self._cover(child, self.limits.cover_below)
        return child

    def _cover(self, node: _Node, steps: int) -> None:
        """Try all that is below the node, if that is not too much: its weights say which patterns matter."""
        if node.view is None or node.weights is None or node.relaxed is None:
            return
        if node.bound >= self.upper or self.steps <= 0:
            return
        view, own = node.view, node.weights
        items = tuple(sum(own.items[item] for item in members(group)) for group in view.stands_for)
        weights = Weights(items=items, budget=own.budget, scale=own.scale)
        if not self.close:
            self.close = (close_fits(self.program),)
        close = self.close[0].below(view) if self.close[0] is not None else None
        found = covered(view.program, weights, node.bound, self.upper, min(steps, self.steps), close)
        self.steps -= found.steps
        node.tried = found.lowest > node.bound
        node.bound = found.lowest
        if found.bundles is not None:
            self._take(tuple((kind, view.whole(mask)) for kind, mask in found.bundles))

    def _relaxed(self, node: _Node, *, fully: bool = False) -> _Node:
        """Bound the node; the integral packing that its relaxation may be is taken."""
        if node.view is None:
            node.bound = self.ceiling
        if node.view is None or node.bound >= self.upper:
            return node
        view = node.view
        found = self._relax(view, self.upper, fully=fully)
        if found is None:
            return node
        node.relaxed = found
        node.bound = payable(self.program, max(node.bound, found.bound))
        if node.weights is None or found.total >= node.total:  # otherwise what bounds its parent bounds it too
            node.total = found.total
            node.weights = _spread(view, found.weights, self.program.items)
        if found.bound < self.upper:
            self._offer(tuple((kind, view.whole(mask)) for kind, mask, part in found.parts if part > 1 - _HALF))
        return node

    def _relax(self, view: View, target: int, *, fully: bool = False) -> Relaxed | None:
        if view.program.items == 0:
            return None
        known = self._known(view)
        penalty = PENALTY * max(1, self.upper)
        found = relax(view.program, known, target, penalty, replace(self.limits.effort, fully=fully))
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
        if self.dives >= self.limits.dives or node.view is None or node.relaxed is None or node.bound >= self.upper:
            return
        self.dives += 1
        steps = self.limits.first_dive if self.dives == 2 else self.limits.dive
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
        place = min(kinds, key=lambda one: (abs(kinds[one] - 0.5), one), default=None)
        on = place is not None and _HALF < kinds[place] < 1 - _HALF
        if pair is not None and _HALF < pairs[pair] < 1 - _HALF and not (on and self.program.budget is not None):
            return Together(_first(stands_for[pair[0]]), _first(stands_for[pair[1]]))
        if place is not None and on:
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


def _proof(root: _Node, value: int) -> Proof | None:
    """What shows the value, if no decision was needed for that."""
    if root.bound < value or root.weights is None:
        return None
    return Proof(weights=root.weights, tried=root.tried)
