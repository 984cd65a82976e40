"""Manifests of 1,000 components, start-up aside: `validate` against PyYAML's C loader on the same text, and `fmt`.

`fmt` takes at most a second, and its growth to 4,000 components is linear.
"""

import gc
import sys
import tempfile
from datetime import date
from pathlib import Path

import yaml

from benchmarks.timing import Figure, interleaved, median_ratio, report
from rarms_iac.app.manifests import validate
from rarms_iac.app.requests import ManifestSource
from rarms_iac.manifest.edit.formatting import format_text
from tests.robots import fleet_manifest

ROUNDS = 15
FORMATTED = 5


def main() -> int:
    text, larger = fleet_manifest(1000), fleet_manifest(4000)
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
    gc.set_threshold(50_000, 20, 20)  # as `cli.main` does before every command
    formatted = interleaved(
        {"1,000": lambda: format_text(text, "rarms.yaml"), "4,000": lambda: format_text(larger, "rarms.yaml")},
        rounds=FORMATTED,
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
            Figure(name="fmt of 1,000 components", value=1000 * min(formatted["1,000"]), unit="ms", at_most=1000),
            Figure(name="  4,000 / 1,000", value=median_ratio(formatted["4,000"], formatted["1,000"]), at_most=5),
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
