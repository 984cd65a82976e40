"""Manifests with something wrong, and exactly what is told of them."""

from pathlib import Path

import pytest

from rarms_iac.manifest.checks.violation import CHECKS
from tests.cases.findings_of import case_folders, findings_of


@pytest.mark.parametrize("folder", case_folders(), ids=lambda folder: folder.name)
def test_a_case_tells_what_it_should(folder: Path) -> None:
    expected = (folder / "expected.txt").read_text(encoding="utf-8")

    assert findings_of(folder) == expected


@pytest.mark.parametrize("folder", case_folders(), ids=lambda folder: folder.name)
def test_a_case_says_why_it_is_there(folder: Path) -> None:
    assert (folder / "WHY").read_text(encoding="utf-8").strip()


def test_every_check_has_a_case() -> None:
    told = "".join((folder / "expected.txt").read_text(encoding="utf-8") for folder in case_folders())

    assert [finding.code for finding, _ in CHECKS if f"[{finding.code}]" not in told] == []
