"""`validate` of 1,000 components against PyYAML's C loader on the same text, start-up aside."""

import sys
import tempfile
from datetime import date
from pathlib import Path

import yaml

from benchmarks.fleet import manifest
from benchmarks.timing import Figure, interleaved, median_ratio, report
from rarms_iac.manifest.load import load

ROUNDS = 15


def main() -> int:
    text = manifest(1000)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rarms.yaml"
        path.write_text(text, encoding="utf-8", newline="\n")
        loaded = load(str(path), today=date(2026, 1, 1))
        if loaded.system is None or loaded.has_errors:
            raise RuntimeError(f"the benchmark's manifest has errors: {loaded.diagnostics[:3]}")
        times = interleaved(
            {
                "yaml": lambda: yaml.load(text, yaml.CSafeLoader),  # checked text of our own
                "load": lambda: load(str(path), today=date(2026, 1, 1)),
            },
            rounds=ROUNDS,
        )
    return report(
        [
            Figure(name="lines", value=text.count("\n"), unit="lines"),
            Figure(name="PyYAML's C loader", value=1000 * min(times["yaml"]), unit="ms"),
            Figure(name="load and checks", value=1000 * min(times["load"]), unit="ms"),
            Figure(
                name="load and checks / PyYAML's C loader",
                value=median_ratio(times["load"], times["yaml"]),
                at_most=2,
            ),
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
