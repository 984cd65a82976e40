"""`fmt` of 1,000 components: at most a second, and its growth to 4,000 is linear."""

import sys

from benchmarks.fleet import manifest
from benchmarks.timing import Figure, interleaved, median_ratio, report
from rarms_iac.manifest.edit.formatting import format_text

ROUNDS = 5


def main() -> int:
    small, large = manifest(1000), manifest(4000)
    times = interleaved(
        {"1,000": lambda: format_text(small, "rarms.yaml"), "4,000": lambda: format_text(large, "rarms.yaml")},
        rounds=ROUNDS,
    )
    return report(
        [
            Figure(name="fmt of 1,000 components", value=1000 * min(times["1,000"]), unit="ms", at_most=1000),
            Figure(name="fmt of 4,000 / of 1,000", value=median_ratio(times["4,000"], times["1,000"]), at_most=5),
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
