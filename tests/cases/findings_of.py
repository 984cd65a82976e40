"""The findings of a case folder as text: `rarms.yaml` with every other YAML file as an overlay, by name.

`python -m tests.cases.findings_of` writes every `expected.txt` anew; read the difference before it is committed.
"""

import contextlib
from datetime import date
from pathlib import Path

from rarms_iac.manifest.acceptance import apply_acceptances
from rarms_iac.manifest.checks import CODES, checks_beside
from rarms_iac.manifest.load import load
from rarms_iac.views.finding_forms import OutputFormat, render_findings

FINDINGS = Path(__file__).parent / "findings"
TODAY = date(2026, 11, 21)


def case_folders() -> list[Path]:
    return sorted(path.parent for path in FINDINGS.glob("*/rarms.yaml"))


def findings_of(folder: Path) -> str:
    """What `rarms validate` tells in that folder."""
    with contextlib.chdir(folder):
        overlays = sorted(path.as_posix() for path in Path().rglob("*.yaml") if path.as_posix() != "rarms.yaml")
        loaded = load("rarms.yaml", overlays, today=TODAY, checks=checks_beside(Path()))
    if loaded.system is None:
        return render_findings(OutputFormat.TEXT, loaded.diagnostics, loaded.sources)
    kept, accepted = apply_acceptances(loaded.diagnostics, loaded.system.policy, loaded.places, TODAY, codes=CODES)
    return render_findings(OutputFormat.TEXT, kept, loaded.sources, accepted=accepted)


if __name__ == "__main__":
    for case in case_folders():
        (case / "expected.txt").write_text(findings_of(case), encoding="utf-8", newline="\n")
