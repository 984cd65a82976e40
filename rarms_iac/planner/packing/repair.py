"""A packing where first fit found none: a few hosts at a time are packed anew until nobody is left over."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from random import Random

from rarms_iac.model.capacity import Capacity
from rarms_iac.model.claims import Claim
from rarms_iac.model.quantities import Bytes, LogicalProcessors
from rarms_iac.planner.packing.assignment import Assignment
from rarms_iac.planner.packing.first_fit import first_fit_of_some
from rarms_iac.planner.packing.highs import minimise
from rarms_iac.planner.packing.values import Bin, Item

ROUNDS = 100
"""Times that some hosts are packed anew."""

HOSTS = (3, 4, 5)
"""Hosts that are packed anew together."""

NODES = 100
"""Nodes of the search in one round."""

NOWHERE = ""
"""The host of those that are left over: everything has room there, and nothing should be."""


def repaired(items: Sequence[Item], bins: Sequence[Bin]) -> Mapping[str, str] | None:
    """Find a packing, whatever it is worth.

    Args:
        items: The partitions, by name.
        bins: The hosts, by name.

    Returns:
        The packing; None: none was found in `ROUNDS` rounds.
    """
    random = Random(0)  # noqa: S311  # no secret: the same rounds for the same partitions
    hosts = first_fit_of_some(items, bins)
    by_name = {item.name: item for item in items}
    for _ in range(ROUNDS):
        left = [item for item in items if item.name not in hosts]
        if not left:
            return hosts
        allowed = sorted({name for item in left for name in item.claims})
        others = [host.name for host in bins]
        first = random.choice(allowed)
        chosen = {first, *random.sample(others, min(len(others), random.choice(HOSTS) - 1))}
        some = [by_name[name] for name, host in hosts.items() if host in chosen]
        some += [item for item in left if item.claims.keys() & chosen]
        packed = _packed(some, [host for host in bins if host.name in chosen], hosts)
        hosts = {name: host for name, host in hosts.items() if host not in chosen} | packed
    return None


def _packed(items: Sequence[Item], bins: Sequence[Bin], hosts: Mapping[str, str]) -> dict[str, str]:
    """Those of the partitions that find room on these hosts, as much of them as possible."""
    names = {host.name for host in bins}
    nothing = Claim(processors=0, reserve=0, memory=0)
    items = [
        replace(item, claims={NOWHERE: nothing} | {name: each for name, each in item.claims.items() if name in names})
        for item in sorted(items, key=lambda item: item.name)
    ]
    capacity = Capacity(logical_processors=0, processors=LogicalProcessors(Fraction(0)), memory=Bytes(0))
    program = Assignment(items, [Bin(name=NOWHERE, capacity=capacity), *bins])
    percent = 100 * max(1, *(host.capacity.logical_processors for host in bins))
    memory = max(1, *(host.capacity.memory for host in bins))
    costs = [0] * len(program.pairs)
    for variable, (number, at) in enumerate(program.pairs):
        if at == 0:
            claims = [claim for name, claim in items[number].claims.items() if name]
            costs[variable] = (
                1
                + 1000 * max(c.processors * c.reserve for c in claims) // percent
                + 1000 * max(c.memory for c in claims) // memory
            )
    start = {item.name: hosts.get(item.name, NOWHERE) for item in items}
    answer = minimise(costs, program.rows, nodes=NODES, start=program.chosen(start))
    if answer.ones is None or program.forbid(answer.ones):
        return {name: host for name, host in start.items() if host}
    return {name: host for name, host in program.hosts(answer.ones).items() if host}
