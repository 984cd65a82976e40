"""Few partitions for which alone there is no placement, and a certificate of it: what is so for them is so for all."""

from collections.abc import Iterator, Sequence
from itertools import islice

from rarms_iac.planner.certifying.named import certificate_of
from rarms_iac.planner.placing.first_fit import Bin, Item, cost
from rarms_iac.planner.placing.in_numbers import gave_up, in_whole_numbers
from rarms_iac.planner.placing.place import EXACT_UP_TO

LOOKED_AT = 60
"""Groups of partitions that are searched for a placement of their own, at most."""


def hosts_of(items: Sequence[Item], bins: Sequence[Bin]) -> tuple[Bin, ...]:
    """The hosts that any of the partitions may run on; all where they may run on none."""
    claimed = {name for one in items for name in one.claims}
    return tuple(one for one in bins if one.name in claimed) or tuple(bins)


def by_hosts(items: Sequence[Item]) -> Iterator[tuple[Item, ...]]:
    """Those of the partitions that must find room among few hosts, the fewest first; not all of them."""
    few = sorted({tuple(sorted(one.claims)) for one in items}, key=lambda names: (len(names), names))
    for names in few:
        some = tuple(one for one in items if one.claims.keys() <= set(names))
        if len(some) < len(items):
            yield some


def alone(items: Sequence[Item], bins: Sequence[Bin]) -> tuple[Item, ...] | None:
    """Some of the partitions for which there is no placement, and so none for all; None where none are known."""
    from rarms_iac.planner.packing.solve import ruled_out

    for some in islice(_groups(items), LOOKED_AT):
        problem = in_whole_numbers(some, hosts_of(some, bins))
        found = ruled_out(problem)
        if found is None or gave_up(problem):
            continue
        if found.proof is None or found.proof.tried:
            return some
        # Who weighs nothing is not needed: the others weigh as much without.
        weights = found.proof.weights.items
        return tuple(one for one, weight in zip(some, weights, strict=True) if weight > 0)
    return None


def _groups(items: Sequence[Item]) -> Iterator[tuple[Item, ...]]:
    """What is looked at: groups by hosts, then all; and of many the largest."""
    for group in (*by_hosts(items), tuple(items)):
        some = tuple(sorted(group, key=lambda one: one.name))
        yield some
        if len(some) > EXACT_UP_TO:
            yield tuple(sorted(sorted(some, key=_largest_first)[:EXACT_UP_TO], key=lambda one: one.name))


def _largest_first(one: Item) -> tuple[int, int, str]:
    claims = one.claims.values()
    return -min(cost(claim) for claim in claims), -min(claim.memory for claim in claims), one.name


def certified_impossible(items: Sequence[Item], bins: Sequence[Bin]) -> str:
    """JSON of a certificate that the partitions have no placement, as the checker accepted it; empty: none."""
    from rarms_iac.planner.certifying.claim import claim_of
    from rarms_iac.planner.packing.solve import ruled_out

    if not items or not bins or any(not one.claims for one in items):
        return ""
    ordered = sorted(items, key=lambda one: one.name)
    hosts = sorted(hosts_of(items, bins), key=lambda one: one.name)
    problem = in_whole_numbers(ordered, hosts)
    names = [one.name for one in ordered], [one.name for one in hosts]
    by_sums = certificate_of(problem, {"impossible": None}, *names)
    found = None if by_sums else ruled_out(problem)
    claim = None if found is None else claim_of(problem, found)
    return by_sums if claim is None else certificate_of(problem, claim, *names)
