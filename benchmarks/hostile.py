"""Hostile input is told in under 100 ms, or 500 ms where it only breaks the limit of nodes or of size."""

import sys
import tempfile
from datetime import date
from pathlib import Path

from benchmarks.timing import Figure, report, seconds
from rarms_iac.manifest.load import load_system
from tests.hostile import HOSTILE, HOSTILE_VALUES, Hostile, manifest

ROUNDS = 3
TODAY = date(2026, 1, 1)


def _figure(hostile: Hostile, path: Path) -> Figure:
    path.write_bytes(hostile.make())
    fastest = min(seconds(lambda: load_system(str(path), today=TODAY)) for _ in range(ROUNDS))
    return Figure(name=hostile.name, value=1000 * fastest, unit="ms", at_most=500 if hostile.large else 100)


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rarms.yaml"
        path.write_bytes(manifest(memory="4"))  # what is imported and built once is no cost of the input
        load_system(str(path), today=TODAY)
        return report([_figure(hostile, path) for hostile in (*HOSTILE, *HOSTILE_VALUES)])


if __name__ == "__main__":
    sys.exit(main())
