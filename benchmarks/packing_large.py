"""Beyond 30: a fleet of 500 partitions onto 50 hosts, how that grows, and equal bins whose optimum is known."""

import os
import sys
import time
from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import pairwise
from random import Random

from benchmarks.timing import Figure, report
from rarms_iac.model.capacity import Capacity
from rarms_iac.model.plan import Claim
from rarms_iac.model.quantities import Bytes, LogicalProcessors
from rarms_iac.planner import PackedSizes, pack_sizes
from rarms_iac.planner.packing.linear.master import installed
from rarms_iac.planner.placing.first_fit import Bin, Item
from rarms_iac.planner.placing.place import Found, place

SECONDS = 10.0
MIB = 1 << 20


def fleet(partitions: int) -> tuple[list[Item], list[Bin]]:
    """Ten partitions a host of 8 logical processors, two thirds of it reserved; half of them run already."""
    random = Random(partitions)
    hosts = partitions // 10
    capacity = Capacity(logical_processors=8, processors=LogicalProcessors(Fraction(8)), memory=Bytes(32 * 1024 * MIB))
    bins = [Bin(name=f"host-{at:03}", capacity=capacity) for at in range(hosts)]
    items = []
    for at in range(partitions):
        claim = Claim(processors=2, reserve=random.randint(8, 46), memory=random.randint(4, 40) * 64 * MIB)
        now = bins[random.randrange(hosts)].name if at % 2 else ""
        items.append(Item(name=f"part-{at:04}", claims={one.name: claim for one in bins}, now=now))
    return items, bins


def timed(partitions: int) -> tuple[float, Found]:
    items, bins = fleet(partitions)
    begun = time.process_time()
    found = place(items, bins)
    return time.process_time() - begun, found


def zero_waste(random: Random, bins: int) -> tuple[list[int], int]:
    sizes = []
    for _ in range(bins):
        cuts = [0, *sorted(random.sample(range(1, 1000), 3)), 1000]
        sizes += [high - low for low, high in pairwise(cuts)]
    return sizes, 1000


def triplets(random: Random, bins: int) -> tuple[list[int], int]:
    sizes = []
    for _ in range(bins):
        large = random.randint(380, 490)
        small = random.randint(250, (1000 - large) // 2)
        sizes += [large, small, 1000 - large - small]
    return sizes, 1000


def uniform(random: Random, bins: int) -> tuple[list[int], int]:
    """Sizes of 20 to 100 into bins of 150: pairs and triples that leave at most a hundredth of all bins open."""
    sizes: list[int] = []
    for _ in range(bins):
        first = random.randint(50, 100)
        rest = 150 - first
        sizes += [first, rest] if rest < 60 else [first, rest // 2, rest - rest // 2]
    spare = bins * 150 - sum(sizes)
    assert spare < 150, "one bin fewer has no room for all"
    return sizes, 150


def vectors(random: Random, bins: int) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """Four a bin, and nothing left over in either dimension."""
    sizes: list[tuple[int, int]] = []
    for _ in range(bins):
        parts = [[0, *sorted(random.sample(range(50, 951, 5), 3)), 1000] for _ in range(2)]
        sizes += [(one[1] - one[0], two[1] - two[0]) for one, two in zip(*map(pairwise, parts), strict=True)]
    return sizes, (1000, 1000)


Family = Callable[[Random, int], tuple[Sequence[int] | Sequence[tuple[int, int]], int | tuple[int, int]]]

KNOWN: dict[str, tuple[Family, float]] = {
    "four a bin, nothing wasted": (zero_waste, 4),
    "triplets": (triplets, 3),
    "uniform, 20 to 100 in 150": (uniform, 2.5),
    "2-D, nothing wasted": (vectors, 4),
}
NUMBERS = (20, 50, 100, 200, 500)


def known() -> list[Figure]:
    """Each n: bins used and bound beside the optimum, with our own linear program and with HiGHS where it is there."""
    figures = []
    for own in (True, False) if installed() else (True,):
        solver = "own" if own else "HiGHS"
        worst, above = 0.0, 0
        print(f"\n{solver:<26}    n  optimum  used  bound  CPU s")
        for family, (draw, each) in KNOWN.items():
            for number in NUMBERS:
                bins = round(number / each)
                sizes, room = draw(Random(number), bins)
                begun = time.process_time()
                packed: PackedSizes = pack_sizes(sizes, room, own=own)
                seconds = time.process_time() - begun
                worst, above = max(worst, seconds), max(above, packed.used - bins)
                assert packed.bound <= bins <= packed.used, "a bound is one"
                print(
                    f"{family:<26}{len(sizes):>5}{bins:>9}{packed.used:>6}{packed.bound:>7}{seconds:>7.2f}", flush=True
                )
        figures += [
            Figure(name=f"equal bins, {solver}: worst", value=worst, unit="s", at_most=SECONDS),
            Figure(name=f"equal bins, {solver}: most above the optimum", value=above, unit="bins"),
        ]
    return figures


def main() -> int:
    if hasattr(os, "getloadavg"):
        print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors; times are CPU time of the process")
    figures = known()
    small, _ = timed(100)
    large, found = timed(500)
    assert found.hosts is not None
    print(f"500 on 50: reserved {found.value[0]} %, bound {found.bound[0]} %; moves {found.value[1]}, {found.bound[1]}")
    return report(
        [
            *figures,
            Figure(name="500 partitions onto 50 hosts", value=large, unit="s", at_most=SECONDS),
            Figure(name="growth from 100 to 500", value=large / max(small, 1e-3)),
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
