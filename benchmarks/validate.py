"""`validate` of 1,000 components against PyYAML's C loader on the same text, start-up aside."""

import sys
import tempfile
from datetime import date
from pathlib import Path

import yaml

from benchmarks.fleet import manifest
from benchmarks.timing import Figure, interleaved, median_ratio, report
from rarms_iac.app.requests import ManifestSource
from rarms_iac.app.validation import validate

ROUNDS = 15


def main() -> int:
    text = manifest(1000)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rarms.yaml"
        path.write_text(text, encoding="utf-8", newline="\n")
        source = ManifestSource(manifest=str(path), today=date(2026, 1, 1))
        if findings := validate([source]).findings:
            raise RuntimeError(f"the benchmark's manifest has findings: {findings[:3]}")
        times = interleaved(
            {
                "yaml": lambda: yaml.load(text, yaml.CSafeLoader),  # checked text of our own
                "validate": lambda: validate([source]),
            },
            rounds=ROUNDS,
        )
    return report(
        [
            Figure(name="lines", value=text.count("\n"), unit="lines"),
            Figure(name="PyYAML's C loader", value=1000 * min(times["yaml"]), unit="ms"),
            Figure(name="validate", value=1000 * min(times["validate"]), unit="ms"),
            Figure(
                name="validate / PyYAML's C loader",
                value=median_ratio(times["validate"], times["yaml"]),
                at_most=0.75,
            ),
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
