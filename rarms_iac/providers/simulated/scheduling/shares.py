"""What each VP of a host is due: its reserve, and by weight a part of what nobody claims (weighted max-min fairness).

The weights of a multiprocessor can be infeasible: a VP runs on one LP at a time, however much it weighs. What it cannot
use is the others' by their weights, so every weight is first lowered to what its VP can use ("weight readjustment":
Chandra, Adler, Goyal and Shenoy, Surplus Fair Scheduling, OSDI 2000). Else, who weighs too much is owed ever more.
"""

from collections.abc import Sequence
from typing import NamedTuple


class Entitlement(NamedTuple):
    """What a VP that demands is promised: reserve and limit are fractions of one LP."""

    reserve: float
    limit: float
    weight: float


def usable_weights(demanding: Sequence[Entitlement], lps: int) -> list[float]:
    """Lower each weight to what its VP can use beyond its reserve.

    Args:
        demanding: Every VP that wants to run, in any order.
        lps: How many LPs they share.

    Returns:
        The weights in the same order. By these, what the reserves leave can be shared to the last bit: each VP gets
        its reserve and weight times one and the same level, nobody passes its limit, and no LP is idle while somebody
        may still run. A VP whose limit is its reserve keeps its weight: nothing is shared with it.
    """
    level = _level(demanding, lps)
    if not level:
        return [vp.weight for vp in demanding]
    return [min(vp.weight, (vp.limit - vp.reserve) / level) if vp.limit > vp.reserve else vp.weight for vp in demanding]


def _level(demanding: Sequence[Entitlement], lps: int) -> float:
    """What a unit of weight is worth, in LPs: water rises over all VPs alike, and leaves out those at their limit."""
    remaining = lps - sum(vp.reserve for vp in demanding)
    rising = sum(vp.weight for vp in demanding)
    level = 0.0
    for full_at, vp in sorted(((vp.limit - vp.reserve) / vp.weight, vp) for vp in demanding):
        if full_at * rising >= remaining:
            return remaining / rising
        level = full_at
        remaining -= vp.limit - vp.reserve
        rising -= vp.weight
    return level
