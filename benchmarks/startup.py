"""How long `rarms` takes to say something, against the bare interpreter of the same environment."""

import statistics
import sys
from pathlib import Path

from benchmarks.timing import Figure, command, interleaved, median_ratio, report

ROUNDS = 31


def main() -> int:
    rarms = str(Path(sys.executable).parent / "rarms")
    times = interleaved(
        {
            "bare": command([sys.executable, "-c", "pass"]),
            "version": command([rarms, "--version"]),
            "help": command([rarms, "--help"]),
        },
        rounds=ROUNDS,
    )
    bare = times["bare"]
    return report(
        [
            Figure(name="python -c pass", value=1000 * statistics.median(bare), unit="ms"),
            Figure(name="rarms --version / bare interpreter", value=median_ratio(times["version"], bare), at_most=2),
            Figure(name="rarms --help / bare interpreter", value=median_ratio(times["help"], bare), at_most=10),
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
