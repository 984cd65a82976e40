"""A packing where first fit found none: a few hosts at a time are packed anew until no partition is left over."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from random import Random

from rarms_iac.model.capacity import Capacity
from rarms_iac.model.claims import Claim
from rarms_iac.model.quantities import Bytes, LogicalProcessors
from rarms_iac.planner.packing.assignment import Assignment
from rarms_iac.planner.packing.first_fit import partial_first_fit
from rarms_iac.planner.packing.highs import Nodes, minimise
from rarms_iac.planner.packing.values import Bin, Item

HOSTS = (2, 3, 4, 5)
"""Hosts that are packed anew together."""

NODES = 20
"""Nodes of the search in one round: with more, or more hosts, fewer rounds are needed and each takes far longer."""

NOWHERE = ""
"""The host of those that are left over: everything has room there, and nothing should be."""


def find_by_repacking(items: Sequence[Item], bins: Sequence[Bin], nodes: Nodes) -> Mapping[str, str] | None:
    """Find any packing, good or not.

    Args:
        items: The partitions, by name.
        bins: The hosts, by name.
        nodes: Of the solver, in all rounds.

    Returns:
        The host of each partition; None: no packing was found.
    """
    random = Random(0)  # noqa: S311  # no secret: the same rounds for the same partitions
    host_of = partial_first_fit(items, bins)
    by_name = {item.name: item for item in items}
    names = [host.name for host in bins]
    while True:
        left_over = [item for item in items if item.name not in host_of]
        if not left_over:
            return host_of
        if nodes.remaining <= 0:
            return None
        first = random.choice(sorted({name for item in left_over for name in item.claims}))
        chosen = {first, *random.sample(names, min(len(names), random.choice(HOSTS) - 1))}
        packed_anew = [by_name[name] for name, host in host_of.items() if host in chosen]
        packed_anew += [item for item in left_over if item.claims.keys() & chosen]
        packed = _pack_as_much_as_possible(packed_anew, [host for host in bins if host.name in chosen], host_of, nodes)
        host_of = {name: host for name, host in host_of.items() if host not in chosen} | packed


def _pack_as_much_as_possible(
    items: Sequence[Item], bins: Sequence[Bin], before: Mapping[str, str], nodes: Nodes
) -> dict[str, str]:
    """Return the hosts of those partitions that find room on these hosts; who is left over is as little as possible."""
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
            claims = [claim for name, claim in items[number].claims.items() if name != NOWHERE]
            costs[variable] = (
                1
                + 1000 * max(claim.percent for claim in claims) // percent
                + 1000 * max(claim.memory for claim in claims) // memory
            )
    start = {item.name: before.get(item.name, NOWHERE) for item in items}
    answer = minimise(costs, program.rows, nodes=NODES, start=program.variables_of(start), budget=nodes)
    if answer.ones is not None and not program.forbid(answer.ones):
        start = program.host_of(answer.ones)
    return {name: host for name, host in start.items() if host != NOWHERE}
