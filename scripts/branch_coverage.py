"""Prints the share of branches that the last test run took, from the data that coverage left behind."""

import json
import sys
import tempfile
from pathlib import Path

import coverage


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "coverage.json"
        measured = coverage.Coverage()
        measured.load()
        measured.json_report(outfile=str(report))
        totals = json.loads(report.read_text(encoding="utf-8"))["totals"]
    taken, branches = totals["covered_branches"], totals["num_branches"]
    share = 100 * taken / branches if branches else 100.0
    print(f"Branch coverage: {share:.1f} % ({taken} of {branches} branches)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
