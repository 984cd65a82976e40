"""How far the answers of one component lie apart over seeds: where the curve is flat, only samples help.

`python -m benchmarks.spread`: 0.5 ms of work and 40 ms of waiting beside a busy loop on the simulated host,
twelve seeds for each threshold.
"""

import sys
import tempfile
from pathlib import Path

import rarms_iac as rarms
from benchmarks.timing import Figure, report
from rarms_iac.measuring.measure_request import MeasureRequest

SEEDS = range(1, 13)
MOST_APART = 3
THRESHOLDS = {"p90_response_time": 65, "mean_response_time": 45}  # ms; the mean truly takes 40.5

MANIFEST = """\
schema: rarms/v1
application: {{ name: spread }}
hosts:
  onboard: {{ logical_processors: 2, memory: 4 GiB }}
policy: {{ interference: busy-loop }}
components:
  coi:
    criticality: 1
    apt: {{ {index}: {{ at_most: {limit} ms }} }}
    processors: 1
    memory: 512 MiB
    simulation: {{ work: 0.5 ms, blocked: 40 ms }}
"""


def answer(index: str, seed: int) -> int | None:
    """Return the reservation found with a seed, in per cent; None: there is no answer."""
    with tempfile.TemporaryDirectory() as folder:
        manifest = Path(folder) / "rarms.yaml"
        manifest.write_text(MANIFEST.format(index=index, limit=THRESHOLDS[index]), encoding="utf-8")
        [result] = rarms.measure(rarms.load(str(manifest)), MeasureRequest(seed=seed)).experiments
    return result.reserve


def figures() -> list[Figure]:
    """Return the answers' spread for each threshold, with the answers."""
    rows: list[Figure] = []
    for index in THRESHOLDS:
        found = [answer(index, seed) for seed in SEEDS]
        reserves = [reserve for reserve in found if reserve is not None]
        name = f"{index}: {' '.join('none' if each is None else str(each) for each in found)}"
        rows += [
            Figure(name=f"{name}; apart", value=max(reserves) - min(reserves), unit="points", at_most=MOST_APART),
            Figure(name="  without an answer", value=found.count(None), unit="", at_most=0),
        ]
    return rows


if __name__ == "__main__":
    sys.exit(report(figures()))
