"""Packing with the solver beside first fit alone, in one run: CPU time, packings found, packings proved.

`python -m benchmarks.packing [fleets [partitions hosts]]`; 70 fleets of 5 to 30 partitions unless said otherwise.
"""

import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
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

Answer = tuple[float, Packing | NoPacking]
"""CPU time in seconds, and what was found."""


def problem(drawn: Fleet) -> Problem:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rarms.yaml"
        path.write_text(drawn.manifest, encoding="utf-8")
        system = load(str(path), today=date(2026, 1, 1)).system
    assert system is not None
    views = {name: host_view(read_snapshot(data), "fleet") for name, data in drawn.snapshots.items()}
    return problem_of(system, FixedReservations(), views, may_move=True)


def packed(drawn: Problem) -> Answer:
    begun = time.process_time()
    found = packing.pack(drawn.items, drawn.bins)
    return time.process_time() - begun, found


def figures(name: str, answers: Sequence[Answer]) -> list[Figure]:
    seconds = [each for each, _ in answers]
    missing = 100 * sum(isinstance(found, NoPacking) for _, found in answers) / len(answers)
    not_proved = 100 * sum(not found.proven for _, found in answers) / len(answers)
    goals = (MEDIAN, WORST, NOT_PROVED) if name == "solver" else (None, None, None)
    return [
        Figure(name=f"{name}: median", value=statistics.median(seconds), unit="s", at_most=goals[0]),
        Figure(name=f"{name}: worst", value=max(seconds), unit="s", at_most=goals[1]),
        Figure(name=f"{name}: not proved", value=not_proved, unit="%", at_most=goals[2]),
        Figure(name=f"{name}: no packing", value=missing, unit="%"),
    ]


def main(words: Sequence[str]) -> int:
    number, *size = [int(word) for word in words] or [FLEETS]
    partitions, hosts = size or (0, 0)
    solver, first_fit = [], []
    for seed in range(number):
        given = problem(fleet(seed, partitions=partitions, hosts=hosts))
        with patch.object(packing, "is_installed", return_value=False):
            first_fit.append(packed(given))
        solver.append(packed(given))
    return report([*figures("solver", solver), *figures("first fit alone", first_fit)])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
