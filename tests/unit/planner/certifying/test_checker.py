"""The checker accepts what is proved and rejects what is false or not shown, whoever says it.

Whether a damaged proof still shows something is judged by trying every set of items: nothing of the checker is used.
"""

import ast
import copy
import math
from collections.abc import Iterator
from fractions import Fraction
from itertools import chain, combinations
from pathlib import Path
from random import Random
from typing import Any

import pytest

from rarms_iac.planner.certifying import checker
from rarms_iac.planner.certifying.checker import Wrong, check
from rarms_iac.planner.certifying.claim import claim_of, problem_data
from rarms_iac.planner.packing.program import Problem
from rarms_iac.planner.packing.solve import GaveUp, Impossible, Packed, solve
from tests.effort import LONG
from tests.packings import a_packing, every_packing, on_several_kinds, with_processors

DAMAGED = 10_000 if LONG else 1_500
Claim = dict[str, Any]


def test_it_is_small_and_imports_nothing_of_the_planner() -> None:
    text = Path(checker.__file__).read_text(encoding="utf-8")
    imported = {one.module for one in ast.walk(ast.parse(text)) if isinstance(one, ast.ImportFrom)}

    assert len(text.splitlines()) <= 150
    assert imported == {"bisect", "collections.abc", "functools", "itertools", "operator", "typing"}


def test_damaged_certificates_and_claims_are_rejected() -> None:
    rejected, seed = 0, 0
    kinds: dict[str, int] = {}
    while rejected < DAMAGED:
        seed += 1
        problem = (a_packing, with_processors, on_several_kinds)[seed % 3](seed)
        solved = solve(problem)
        assert not isinstance(solved, GaveUp)
        claim = claim_of(problem, solved)
        assert claim is not None
        data: Any = problem_data(problem)
        check(data, claim)
        best = solved if isinstance(solved, Packed) else None
        for name, damaged in damage(problem, claim, best, Random(seed)):
            with pytest.raises(Wrong):
                check(data, damaged)
            rejected += 1
            kinds[name] = kinds.get(name, 0) + 1

    assert len(kinds) >= 12, kinds
    assert kinds["a proof less"], kinds


def damage(problem: Problem, claim: Claim, best: Packed | None, random: Random) -> Iterator[tuple[str, Claim]]:
    """Claims that are false, or whose proof shows nothing any more."""
    if best is None:
        yield "a packing of what cannot be packed", {**packing_of(problem, random), **empty_proofs(claim)}
    else:
        yield from false_values(claim)
        yield from false_packings(problem, claim, random)
        yield from worse_packings(problem, claim, best)
        yield "impossible, and it is not", {"impossible": claim["cost_proof"] or a_leaf(problem, random)}
        yield "impossible, by sums", {"impossible": None}
        yield "impossible, with any weights", {"impossible": a_leaf(problem, random)}
        yield "impossible, with all tried", {"impossible": {**a_leaf(problem, random), "tried": True}}
    yield from torn(problem, claim, random)
    yield from weakened(problem, claim, random)


def packing_of(problem: Problem, random: Random) -> Claim:
    hosts = [random.randrange(len(problem.rooms)) for _ in range(problem.items)]
    cost = sum(problem.opening[host] for host in set(hosts))
    cost += sum(problem.costs[host][item] for item, host in enumerate(hosts))
    return {"hosts": hosts, "cost": cost, "moves": 0}


def empty_proofs(claim: Claim) -> Claim:
    return {"cost_proof": claim["impossible"], "moves_proof": claim["impossible"]}


def a_leaf(problem: Problem, random: Random) -> Claim:
    items = [random.randint(-3, 3) for _ in range(problem.items)]
    excess = [random.randint(0, 2) for _ in problem.rooms]
    return {"items": items, "excess": excess, "rates": [random.randint(-2, 2), 1], "tried": False}


def false_values(claim: Claim) -> Iterator[tuple[str, Claim]]:
    for name in ("cost", "moves"):
        for wrong in (claim[name] - 1, claim[name] + 1, -1, float(claim[name]), str(claim[name]), None, True):
            yield f"another {name}", {**claim, name: wrong}
        yield f"no {name}", {key: one for key, one in claim.items() if key != name}


def false_packings(problem: Problem, claim: Claim, random: Random) -> Iterator[tuple[str, Claim]]:
    hosts = claim["hosts"]
    at = random.randrange(len(hosts))
    for name, wrong in (
        ("an item less", hosts[:-1]),
        ("an item more", [*hosts, hosts[0]]),
        ("a host that there is not", [*hosts[:at], len(problem.rooms), *hosts[at + 1 :]]),
        ("a host before the first", [*hosts[:at], hosts[at] - len(problem.rooms), *hosts[at + 1 :]]),
        ("a host in parts", [*hosts[:at], hosts[at] + 0.5, *hosts[at + 1 :]]),
        ("no hosts", None),
    ):
        yield name, {**claim, "hosts": wrong}
    everything = set(every_packing(problem))
    for _ in range(4):
        other = packing_of(problem, random)
        where = tuple(other["hosts"])
        if not any(where == one for _, one in everything):
            yield "a packing that does not fit", {**claim, "hosts": list(where)}
            yield "a packing that does not fit, with its cost", {**claim, **other}


def worse_packings(problem: Problem, claim: Claim, best: Packed) -> Iterator[tuple[str, Claim]]:
    """Packings that fit and are not the best: whatever their proof is, it is none."""
    worse = [one for one in every_packing(problem) if one[0] > (best.cost.value, best.moves.value)]
    for (cost, moves), where in worse[:: 1 + len(worse) // 4]:
        proof = claim["cost_proof"] or claim["moves_proof"] or a_leaf(problem, Random(0))
        told = {"hosts": list(where), "cost": cost, "moves": moves}
        yield "a worse packing", {**claim, **told}
        yield "a worse packing with some proof", {**told, "cost_proof": proof, "moves_proof": proof}


def proofs(claim: Claim) -> list[str]:
    return [name for name in ("cost_proof", "moves_proof", "impossible") if claim.get(name) is not None]


def torn(problem: Problem, claim: Claim, random: Random) -> Iterator[tuple[str, Claim]]:
    """Proofs of which something is missing or of another kind."""
    for name in proofs(claim):
        if name != "impossible" or not too_much(problem):  # what sums show needs no other proof
            yield "no proof", {**claim, name: None}
        yield "a proof that is a word", {**claim, name: "proved"}
        yield "a proof that says nothing", {**claim, name: {}}
        yield "a list without proofs", {**claim, name: []}
        if isinstance(claim[name], list):
            yield "a list of words", {**claim, name: [*claim[name], "proved"]}
            yield "a list in a list", {**claim, name: [claim[name]]}
        for at in range(len(leaves(claim, name))):
            yield from torn_leaf(claim, name, at, random)


def leaves(claim: Claim, name: str) -> list[Any]:
    """The proofs that are told, one or several."""
    return claim[name] if isinstance(claim[name], list) else [claim[name]]


def with_leaf(claim: Claim, name: str, at: int, leaf: Any) -> Claim:
    """The claim with another in the place of one of its proofs."""
    if not isinstance(claim[name], list):
        return {**claim, name: leaf}
    return {**claim, name: [*claim[name][:at], leaf, *claim[name][at + 1 :]]}


def torn_leaf(claim: Claim, name: str, place: int, random: Random) -> Iterator[tuple[str, Claim]]:
    """Weights of which something is missing or of another kind."""
    leaf = leaves(claim, name)[place]
    for word in ("items", "excess", "rates"):
        rest = {key: one for key, one in leaf.items() if key != word}
        yield f"weights without {word}", with_leaf(claim, name, place, rest)
    for word, what in (("items", "weight"), ("excess", "excess"), ("rates", "rate")):
        numbers = leaf[word]
        at = random.randrange(len(numbers))
        for told, wrong in (
            (f"no {what}", None),
            (f"{what}, one less", numbers[:-1]),
            (f"{what}, one more", [*numbers, 10**9]),
            (f"{what} in parts", [*numbers[:at], 0.5, *numbers[at + 1 :]]),
            (f"{what} that is a word", [*numbers[:at], "1", *numbers[at + 1 :]]),
        ):
            yield told, with_leaf(claim, name, place, {**leaf, word: wrong})
    budget, scale = leaf["rates"]
    for wrong in (0, -scale):
        yield f"a scale of {wrong}", with_leaf(claim, name, place, {**leaf, "rates": [budget, wrong]})
    for host, more in enumerate(leaf["excess"]):
        for wrong in (-1, -more - 1, -(10**9)):
            excess = [*leaf["excess"][:host], wrong, *leaf["excess"][host + 1 :]]
            yield "a host that costs less than it does", with_leaf(claim, name, place, {**leaf, "excess": excess})


def weakened(problem: Problem, claim: Claim, random: Random) -> Iterator[tuple[str, Claim]]:
    """Other weights where nothing but weights shows the claim, so that they show nothing any more."""
    for name in proofs(claim):
        for _ in range(4):
            place = random.randrange(len(leaves(claim, name)))
            weights = copy.deepcopy(leaves(claim, name)[place])
            for at in random.sample(range(problem.items), random.randint(1, problem.items)):
                weights["items"][at] += random.choice((-1, 1)) * random.randint(1, 3 * weights["rates"][1])
            weights["rates"][1] *= random.choice((1, 1, 2))
            if random.random() < 0.5:  # told as it is, so that nothing is wrong but that it shows too little
                weights["excess"] = [max(0, -one) for one in least_by_host(problem, claim, name, weights)]
            damaged = untried(with_leaf(claim, name, place, weights), name)
            if not shows(problem, damaged, name):
                yield f"other weights in {name}", damaged
        if not shows(problem, claim, name):
            for tried in (False, None, 1, "true"):
                yield "all tried, and it does not say so", untried(claim, name, tried)
        if isinstance(claim[name], list):
            for place in range(len(claim[name])):
                fewer = untried({**claim, name: [*claim[name][:place], *claim[name][place + 1 :]]}, name)
                if not shows(problem, fewer, name):
                    yield "a proof less", fewer


def untried(claim: Claim, name: str, tried: object = False) -> Claim:
    """The claim where nothing is said to have been tried."""
    told = [{**leaf, "tried": tried} for leaf in leaves(claim, name)]
    return {**claim, name: told if isinstance(claim[name], list) else told[0]}


def shows(problem: Problem, claim: Claim, name: str) -> bool:
    """Whether the weights alone show what is claimed."""
    value = to_show(problem, claim, name)
    if not isinstance(claim[name], list):
        return bound(problem, claim, name, claim[name]) >= value
    hosts = range(len(problem.rooms))
    for leaf in claim[name]:
        if any(map(int.__gt__, map(int.__neg__, least_by_host(problem, claim, name, leaf)), leaf["excess"])):
            return False
    return all(
        any(
            sum(leaf["items"]) - sum(leaf["excess"][host] for host in some) > (value - 1) * leaf["rates"][1]
            for leaf in claim[name]
        )
        for some in chain.from_iterable(combinations(hosts, count + 1) for count in hosts)
        if sum(problem.opening[host] for host in some) == claim["cost"]
    )


def to_show(problem: Problem, claim: Claim, name: str) -> int:
    """What the weights of this proof must come to where nothing was tried."""
    values = {"impossible": 1, "moves_proof": claim.get("moves", 0)}
    return values[name] if name in values else least_price(problem, claim)


def too_much(problem: Problem) -> bool:
    """Whether the items exceed all hosts together in some dimension."""
    sizes = [[size for row in problem.sizes if (size := row[item]) is not None] for item in range(problem.items)]
    return all(sizes) and any(
        sum(min(size[d] for size in some) for some in sizes) > sum(room[d] for room in problem.rooms)
        for d in range(len(problem.rooms[0]))
    )


def least_price(problem: Problem, claim: Claim) -> int:
    """The cost that weights must show: less cannot be where no hosts of such a price have room for everything."""
    value = int(claim.get("cost", 0))
    if any(map(any, problem.costs)):
        return value
    hosts = range(len(problem.rooms))
    some = list(chain.from_iterable(combinations(hosts, count) for count in range(len(hosts) + 1)))

    def room_for(dimension: int, price: int) -> bool:
        taken = 0
        for item in range(problem.items):
            taken += min(size[dimension] for row in problem.sizes if (size := row[item]) is not None)
        paid = (one for one in some if sum(problem.opening[host] for host in one) == price)
        return any(sum(problem.rooms[host][dimension] for host in one) >= taken for one in paid)

    while value and not all(room_for(d, value - 1) for d in range(len(problem.rooms[0]))):
        value -= 1
    return value


def bound(problem: Problem, claim: Claim, name: str, weights: Any) -> float:
    """What the weights show, by trying every set of items on every host; nothing where an excess is more than told."""
    least = least_by_host(problem, claim, name, weights)
    if any(one + more < 0 for one, more in zip(least, weights["excess"], strict=True)):
        return -math.inf
    budget, scale = weights["rates"]
    total = sum(weights["items"]) - sum(weights["excess"]) + (budget * claim["cost"] if name == "moves_proof" else 0)
    return math.ceil(Fraction(total, scale))


def least_by_host(problem: Problem, claim: Claim, name: str, weights: Any) -> list[int]:
    """By host: what is left of the cost of any set of items on it once their weight is taken off, at least."""
    hosts, items = range(len(problem.rooms)), range(problem.items)
    nothing = [0] * problem.items
    moved = [[int(was not in (None, host)) for was in problem.now or [None] * problem.items] for host in hosts]
    opening: Any = problem.opening if name == "cost_proof" else [0] * len(hosts)
    costs: Any = {"cost_proof": problem.costs, "moves_proof": moved}.get(name, [nothing] * len(hosts))
    budget, scale = weights["rates"]
    found = []
    for host in hosts:
        least = 0
        for some in chain.from_iterable(combinations(items, count) for count in range(1, problem.items + 1)):
            if not on_one_host(problem, host, some):
                continue
            spent = scale * (opening[host] + sum(costs[host][at] for at in some))
            spent -= sum(weights["items"][at] for at in some)
            if name == "moves_proof":
                spent -= budget * (problem.opening[host] + sum(problem.costs[host][at] for at in some))
            least = min(least, spent)
        found.append(least)
    return found


def on_one_host(problem: Problem, host: int, some: tuple[int, ...]) -> bool:
    sizes = [size for at in some if (size := problem.sizes[host][at]) is not None]
    if len(sizes) < len(some) or any(one in some and other in some for one, other in problem.conflicts):
        return False
    if problem.fits is not None and not problem.fits(host, some):
        return False
    return all(sum(size[d] for size in sizes) <= most for d, most in enumerate(problem.rooms[host]))


def test_a_packing_that_cannot_be_is_certified_as_impossible() -> None:
    some = [
        (problem, found) for problem in map(a_packing, range(40)) if isinstance(found := solve(problem), Impossible)
    ]

    assert some
    for problem, found in some:
        claim = claim_of(problem, found)
        assert claim is not None
        check(problem_data(problem), claim)
