"""The exact packing, family by family: CPU time, proofs, certificates and what checking one costs.

`python -m benchmarks.packing [instances of a family] [family ...]`; without words, the goals of 30 items on 12 hosts.
"""

import os
import statistics
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.packings import FAMILIES, HARD, Instance, instance
from benchmarks.timing import Figure, report
from rarms_iac.planner.certifying.checker import Wrong, check
from rarms_iac.planner.certifying.claim import claim_of, problem_data
from rarms_iac.planner.packing.solve import Packed, solve

EACH = 60
MEDIAN, WORST, CERTIFIED, CHECKED = 0.3, 5.0, 99.0, 0.5
HARD_SHARE = 90.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One instance, solved."""

    instance: Instance
    seconds: float
    proved: bool
    certified: bool
    checked: float


def run(one: Instance) -> Run:
    problem = one.problem
    begun = time.process_time()
    found = solve(problem)
    seconds = time.process_time() - begun
    assert isinstance(found, Packed), "what is cut out of hosts fits them"
    assert one.least is None or found.cost.value >= one.least, "nothing is below what is known"
    proved = found.cost.value == found.cost.bound and found.moves.value == found.moves.bound
    claim = claim_of(problem, found)
    begun = time.process_time()
    certified = False
    if claim is not None:
        try:
            check(problem_data(problem), claim)
            certified = True
        except Wrong as wrong:
            print(f"{one.family} {one.seed}: {wrong}")
    checked = time.process_time() - begun
    return Run(instance=one, seconds=seconds, proved=proved, certified=certified, checked=checked)


def told(family: str, runs: Sequence[Run]) -> str:
    times = sorted(one.seconds for one in runs)
    worst = max(runs, key=lambda one: one.seconds)
    return (
        f"{family:<18}{len(runs):>5}{statistics.median(times):>9.2f}{times[-1]:>9.2f} (seed {worst.instance.seed})"
        f"{sum(one.proved for one in runs):>7}{sum(one.certified for one in runs):>7}"
        f"{max(one.checked for one in runs):>9.3f}"
    )


def share(runs: Sequence[Run], within: float) -> float:
    """Per cent that are proved within so many seconds."""
    return 100 * sum(one.proved and one.seconds <= within for one in runs) / len(runs)


def main(words: Sequence[str]) -> int:
    each = int(words[0]) if words else EACH
    families = list(words[1:]) or [*FAMILIES, *HARD]
    if hasattr(os, "getloadavg"):
        print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors; times are CPU time of the process, in s")
    print("family                n   median    worst          proved  certified  checker")
    usual: list[Run] = []
    hard: list[Run] = []
    for family in families:
        runs = [run(instance(family, seed)) for seed in range(each)]
        (hard if family in HARD else usual).extend(runs)
        print(told(family, runs), flush=True)
    figures = []
    if usual:
        times = [one.seconds for one in usual]
        missing = sum(not one.proved for one in usual)
        uncertified = 100 * sum(one.proved and not one.certified for one in usual) / len(usual)
        figures += [
            Figure(name="median", value=statistics.median(times), unit="s", at_most=MEDIAN),
            Figure(name="worst", value=max(times), unit="s", at_most=WORST),
            Figure(name="not proved on both levels", value=missing, unit="", at_most=0),
            Figure(name="not certified", value=uncertified, unit="%", at_most=100 - CERTIFIED),
        ]
    if hard:
        missed = 100 - share(hard, WORST)
        figures.append(Figure(name="hard, missed in 5 s", value=missed, unit="%", at_most=100 - HARD_SHARE))
    longest = max(one.checked for one in (*usual, *hard))
    figures.append(Figure(name="longest check", value=longest, unit="s", at_most=CHECKED))
    return report(figures)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
