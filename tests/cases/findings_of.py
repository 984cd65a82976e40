"""The findings of a case folder as text: `rarms.yaml` with every other YAML file as an overlay, by name.

`python -m tests.cases.findings_of` writes every `expected.txt` anew; read the difference before it is committed.
"""

import contextlib
from datetime import date
from pathlib import Path

from rarms_iac.app.manifests import Validation, validate
from rarms_iac.app.requests import ManifestSource
from rarms_iac.views.console import render
from rarms_iac.views.findings_text import findings_text

FINDINGS = Path(__file__).parent / "findings"
TODAY = date(2026, 11, 21)


def case_folders() -> list[Path]:
    return sorted(path.parent for path in FINDINGS.glob("*/rarms.yaml"))


def findings_of(folder: Path) -> str:
    """What `rarms validate` tells in that folder."""
    found = _validated(folder)
    return render(findings_text(found.findings, found.sources, accepted=found.accepted))


def _validated(folder: Path) -> Validation:
    with contextlib.chdir(folder):
        overlays = sorted(path.as_posix() for path in Path().rglob("*.yaml") if path.as_posix() != "rarms.yaml")
        return validate([ManifestSource(overlays=tuple(overlays), today=TODAY)])


if __name__ == "__main__":
    for case in case_folders():
        (case / "expected.txt").write_text(findings_of(case), encoding="utf-8", newline="\n")
