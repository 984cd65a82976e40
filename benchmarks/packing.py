"""Packing with the solver beside first fit alone, in one run: CPU time, packings found, packings proved.

`python -m benchmarks.packing [fleets [partitions hosts]]`; 70 fleets of 5 to 30 partitions unless said otherwise.
"""

import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from unittest.mock import patch

from benchmarks.packing_fleets import Fleet, fleet
from benchmarks.timing import Figure, report
from rarms_iac.manifest.load import load
from rarms_iac.planner.packing import pack as packing
from rarms_iac.planner.packing.values import NoPacking, Packing
from rarms_iac.planner.problem import Problem, host_view, problem_of
from rarms_iac.planner.reservations import FixedReservations
from rarms_iac.storage.snapshot_file import read_snapshot

FLEETS = 70
MEDIAN, WORST, NOT_PROVED = 0.3, 30.0, 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One fleet, packed."""

    seconds: float
    found: Packing | NoPacking


def problem(drawn: Fleet) -> Problem:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rarms.yaml"
        path.write_text(drawn.manifest, encoding="utf-8")
        system = load(str(path), today=date(2026, 1, 1)).system
    assert system is not None
    views = {name: host_view(read_snapshot(data), "fleet") for name, data in drawn.snapshots.items()}
    return problem_of(system, FixedReservations(), views, may_move=True)


def run(drawn: Problem) -> Run:
    begun = time.process_time()
    found = packing.pack(drawn.items, drawn.bins)
    return Run(seconds=time.process_time() - begun, found=found)


def missing(runs: Sequence[Run]) -> float:
    """Per cent without a packing."""
    return 100 * sum(isinstance(each.found, NoPacking) for each in runs) / len(runs)


def main(words: Sequence[str]) -> int:
    number, *size = [int(word) for word in words] or [FLEETS]
    partitions, hosts = size or (0, 0)
    solved, first = [], []
    for seed in range(number):
        drawn = fleet(seed, partitions=partitions, hosts=hosts)
        given = problem(drawn)
        with patch.object(packing, "is_installed", return_value=False):
            first.append(run(given))
        solved.append(run(given))
        print(f"{drawn.name:<15}{first[-1].seconds:>8.2f}{solved[-1].seconds:>8.2f} s", flush=True)
    median = statistics.median(each.seconds for each in solved)
    not_proved = 100 * sum(not each.found.proven for each in solved) / number
    return report(
        [
            Figure(name="median", value=median, unit="s", at_most=MEDIAN),
            Figure(name="worst", value=max(each.seconds for each in solved), unit="s", at_most=WORST),
            Figure(name="median, of first fit's", value=median / statistics.median(each.seconds for each in first)),
            Figure(name="not proved", value=not_proved, unit="%", at_most=NOT_PROVED),
            Figure(name="no packing", value=missing(solved), unit="%"),
            Figure(name="no packing by first fit alone", value=missing(first), unit="%"),
        ]
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
